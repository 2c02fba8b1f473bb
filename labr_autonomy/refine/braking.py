"""The shortest braking along one axis that a plan on the grid can express: constant jerk in each interval."""

from __future__ import annotations

import math

import numpy as np

from labr_autonomy.refine import profile
from labr_autonomy.refine.values import STEP_S
from labr_autonomy.types import Array


def brake_axis(v0_mps: float, a0_mps2: float, limit_mps2: float, jerk_mps3: float) -> Array:
    """Accelerations at the nodes, (n + 1,), that bring (v0, a0) to rest exactly in the fewest intervals.

    The acceleration goes down as steeply as the jerk allows, to a level, and back to nothing as steeply; the
    level is the one whose sum takes away all of the velocity. The jerk is never above its limit, and the
    acceleration only where it begins above its own.

    Args:
        v0_mps: Velocity now.
        a0_mps2: Acceleration now.
        limit_mps2: Of the acceleration.
        jerk_mps3: Of the jerk.
    """
    change = jerk_mps3 * STEP_S
    fades = abs(a0_mps2) - change * np.arange(1, math.ceil(abs(a0_mps2) / change) + 1)
    left = v0_mps + STEP_S * math.copysign(0.5 * abs(a0_mps2) + float(np.maximum(fades, 0.0).sum()), a0_mps2)
    sign = math.copysign(1.0, left)
    v, a = sign * v0_mps, sign * a0_mps2  # of which the velocity must fall
    shortest = profile.duration(profile.ramp(v, a, 0.0, limit_mps2, jerk_mps3))
    steps = max(2, math.ceil(shortest / STEP_S - 1e-9), len(fades))
    while True:
        k = np.arange(1, steps)
        low = np.maximum(a - change * k, -change * (steps - k))
        high = a + change * k
        levels = np.unique(np.clip(np.concatenate([-low, -high, [0.0, limit_mps2]]), 0.0, limit_mps2))
        ends = np.minimum(np.maximum(-levels[:, None], low), high).sum(axis=1) * STEP_S + v + 0.5 * STEP_S * a
        if ends[-1] <= 1e-12:  # the velocities left over at the end, falling with the level
            break
        steps += 1
    level = float(np.interp(0.0, ends[::-1], levels[::-1]))  # exact: linear between the corners
    return sign * np.concatenate([[a], np.minimum(np.maximum(-level, low), high), [0.0]])
