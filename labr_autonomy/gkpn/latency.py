"""How long networks take in ONNX Runtime, in turns, so that all meet the same machine."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from labr_autonomy.clock import SystemClock
from labr_autonomy.gkpn.runtime import Runtime, start
from labr_autonomy.types import Array

WARM_RUNS = 3  # of each network before its first round
RUNS = 10  # of each network in a round
SKIPPED = 2  # first runs of a turn, in which the caches still hold another network


def latencies_ms(
    models: Mapping[str, bytes], threads: int, rounds: int, on_round: Callable[[], None] = lambda: None
) -> dict[str, Array]:
    """Time of single plans [ms] by network.

    Args:
        models: ONNX files by name; inputs as of `gkpn.onnx_file`.
        threads: Of each session.
        rounds: Turns that each network has.
        on_round: Called after each round.
    """
    ready = {name: start(model, threads) for name, model in models.items()}
    feeds = {name: _feed(one) for name, one in ready.items()}
    for name, one in ready.items():
        for _ in range(WARM_RUNS):
            one.run(feeds[name])
    times: dict[str, list[float]] = {name: [] for name in ready}
    for _ in range(rounds):
        for name, one in ready.items():
            times[name] += list(_turn(one, feeds[name]))[SKIPPED:]
        on_round()
    return {name: np.array(values) for name, values in times.items()}


def _turn(one: Runtime, feed: dict[str, Any]) -> Iterator[float]:
    clock = SystemClock()
    for _ in range(SKIPPED + RUNS):
        began_s = clock.now_s()
        one.run(feed)
        yield 1e3 * (clock.now_s() - began_s)


def _feed(one: Runtime) -> dict[str, Any]:
    """Depths like those of a room, and zeros elsewhere: the time does not depend on what is seen."""
    rng = np.random.default_rng(0)
    values = {name: np.zeros(shape, np.float32) for name, shape in one.inputs.items()}
    values["depth"] = rng.uniform(0.3, 10.0, values["depth"].shape).astype(np.float32)
    values["goal"][:] = [3.0, 0.5, 0.2]
    return values
