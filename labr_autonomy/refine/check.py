"""The dense check: what decides whether a trajectory may leave the refiner."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from labr_autonomy.refine.values import DistanceField
from labr_autonomy.types import Array

GIVE_M = 0.01  # of clearance gained that may be lost again while leaving an obstacle (ripple of the map)
EXACT_M = 1e-3
STILL_M = 0.02  # a robot that moves less than this stands
AWAY_M = 0.005  # that the end must be farther from the obstacle than the start, if it moves


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the check found."""

    free: bool
    nearest_m: float  # least distance of the body's centre to an obstacle
    over: str = ""  # the limit that is broken, a sentence

    @property
    def may_leave(self) -> bool:
        """Free of obstacles and within every limit."""
        return self.free and not self.over


def dense_check(points: Array, field: DistanceField, hard_m: float) -> Verdict:
    """Check dense positions (n, d) of a trajectory against the map.

    Everywhere the centre must keep `hard_m` from obstacles. A start that is already closer may not come
    closer still, may not lose what it has gained, and must end farther away if it moves at all.
    """
    distance = field.lookup(points)
    nearest = float(distance.min())
    start = float(distance[0])
    if start >= hard_m:
        return Verdict(nearest >= hard_m - EXACT_M, nearest)
    best = np.maximum.accumulate(distance)
    best[best <= start + GIVE_M] = start + GIVE_M - EXACT_M  # at the start itself nothing may be lost
    kept = bool((distance >= np.minimum(hard_m, best - GIVE_M)).all())
    moved = float(np.linalg.norm(points - points[0], axis=1).max())
    left = moved < STILL_M or float(distance[-1]) > start + AWAY_M
    return Verdict(kept and left, nearest)
