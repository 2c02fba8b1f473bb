"""One figure of one link, and the load under which it was taken."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TypedDict

import numpy as np


class Row(TypedDict):
    """Times of one kind over one link."""

    channel: str  # ground or air
    endpoint: str  # who answers
    figure: str
    n: int
    lost: int  # asked and not answered
    p50_ms: float
    p99_ms: float
    max_ms: float


class Load(TypedDict):
    """What else the machine did."""

    cores: int
    load_before: float  # processes that want a core, mean of the last minute (getloadavg(3))
    load_after: float
    realtime: bool  # the measuring process was scheduled before ordinary ones


def row(channel: str, endpoint: str, figure: str, times_s: Sequence[float], lost: int) -> Row:
    """Percentiles of `times_s` [s]; NaN where nothing was answered."""
    ms = 1e3 * np.array(times_s if len(times_s) else [np.nan])
    p50, p99 = (round(float(np.percentile(ms, q)), 3) for q in (50, 99))
    return Row(
        channel=channel,
        endpoint=endpoint,
        figure=figure,
        n=len(times_s),
        lost=lost,
        p50_ms=p50,
        p99_ms=p99,
        max_ms=round(float(ms.max()), 3),
    )


def load_now() -> float:
    """Mean of the last minute."""
    return round(os.getloadavg()[0], 2)


def load_since(before: float, *, realtime: bool) -> Load:
    """The load of a measurement that began at a load of `before`."""
    return Load(cores=os.cpu_count() or 1, load_before=before, load_after=load_now(), realtime=realtime)
