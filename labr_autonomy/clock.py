"""Time, injected. Nothing else in the project reads a clock or sleeps."""

from __future__ import annotations

import asyncio
import time
from typing import Protocol


class Clock(Protocol):
    """A monotonic clock that tasks can wait on."""

    def now_s(self) -> float:
        """Seconds on a monotonic scale."""
        ...

    async def sleep_until(self, due_s: float) -> None:
        """Return at `due_s` or at once when it has passed."""
        ...


class SystemClock:
    """The machine's monotonic clock; the same scale in every process of this machine."""

    def now_s(self) -> float:
        """CLOCK_MONOTONIC [s]."""
        return time.monotonic()

    async def sleep_until(self, due_s: float) -> None:
        """Wait on the running event loop until `due_s`."""
        await asyncio.sleep(max(0.0, due_s - time.monotonic()))


def cpu_s() -> float:
    """CPU time of this process [s], for figures of cost."""
    return time.process_time()


def utc_s() -> float:
    """Wall clock [s since the epoch], for file names and log headers only."""
    return time.time()


def pause_s(duration_s: float) -> None:
    """Block the calling thread; for processes with a loop of their own, never in the executive."""
    time.sleep(max(0.0, duration_s))


class Ticker:
    """Drift-free ticks: `due = start + k * period`; ticks that were missed are skipped, never bunched."""

    def __init__(self, clock: Clock, period_s: float) -> None:
        self._clock = clock
        self._period_s = period_s
        self._due_s = clock.now_s()
        self.missed = 0

    async def wait(self) -> float:
        """Wait for the next tick and return how late the wake-up was [s]."""
        self._due_s += self._period_s
        behind = self._clock.now_s() - self._due_s
        if behind > self._period_s:
            skipped = int(behind / self._period_s)
            self.missed += skipped
            self._due_s += skipped * self._period_s
        await self._clock.sleep_until(self._due_s)
        return max(0.0, self._clock.now_s() - self._due_s)
