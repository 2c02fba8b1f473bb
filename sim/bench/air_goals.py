"""Goals in the air: how much of the way is driven, and how far from the goal the robot takes off."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from labr_autonomy.types import Array
from sim.bench import statistics
from sim.lockstep.trial import TrialResult

NEAR_M = 3.0  # a take-off within this of the goal is near it, on the level


def driven_share(result: TrialResult) -> float:
    """Metres on wheels over all metres of a trial; nan for a robot that did not move."""
    whole_m = result.land_m + result.air_m
    return result.land_m / whole_m if whole_m > 0.0 else math.nan


def take_off_m(result: TrialResult, goal_m: Array) -> float:
    """Distance on the level from the goal (2|3,) to where the last flight began [m]; nan without a flight."""
    track = np.array(result.track, dtype=float)
    if not len(track):
        return math.nan
    flying = track[:, 4] > 0.0
    began = np.flatnonzero(flying & ~np.concatenate([[False], flying[:-1]]))
    if not len(began):
        return math.nan
    return float(np.hypot(*(track[began[-1], 1:3] - np.asarray(goal_m[:2], float))))


def figures(results: Sequence[TrialResult], goals_m: Sequence[Array]) -> dict[str, Any]:
    """A row's figures over trials that reached their goals in the air.

    Args:
        results: Of the trials.
        goals_m: (n, 3) odom, in the same order.

    Returns:
        Medians, and the share of take-offs within `NEAR_M`; None where there is no trial.
    """
    shares = [driven_share(r) for r in results]
    starts = [take_off_m(r, goal) for r, goal in zip(results, goals_m, strict=True)]
    starts = [s for s in starts if math.isfinite(s)]
    return {
        "driven_share_air_pct_p50": 100.0 * float(np.median(shares)) if shares else None,
        "take_off_m_p50": float(np.median(starts)) if starts else None,
        "take_off_m_max": max(starts, default=None),
        "take_off_near_pct": statistics.share_pct([s <= NEAR_M for s in starts]),
    }
