"""Steps of physics in real time."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator

from labr_autonomy.clock import Clock, Ticker

BEHIND_MAX_S = 0.25  # further behind real time than this, time is let go


async def due_steps(
    clock: Clock, period_s: float, stop: asyncio.Event, log: logging.Logger
) -> AsyncIterator[list[float]]:
    """The stamps of the steps that are due, tick by tick, until `stop` is set.

    Args:
        clock: Real time.
        period_s: Of a step.
        stop: Ends it.
        log: Told when time is let go.
    """
    ticker = Ticker(clock, period_s)
    stepped_s = clock.now_s()
    while not stop.is_set():
        await ticker.wait()
        now_s = clock.now_s()
        if now_s - stepped_s > BEHIND_MAX_S:
            log.warning("fell %.0f ms behind", (now_s - stepped_s) * 1e3)
            stepped_s = now_s - period_s
        due = []
        while stepped_s + period_s <= now_s:
            stepped_s += period_s
            due.append(stepped_s)
        yield due
