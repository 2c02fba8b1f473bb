"""How fast a path may be followed, and trajectories cut to what is still ahead."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numba
import numpy as np

from labr_autonomy.refine.check import Verdict, dense_check
from labr_autonomy.refine.reference import CREEP_MPS, MARGIN_M, Path, first_unknown
from labr_autonomy.refine.values import DistanceField
from labr_autonomy.types import Array, Source, Trajectory

BLIND_M = 0.6  # unknown as close to the outline as this is taken as free, on land and in the air: it is bold


@dataclass(frozen=True, slots=True)
class Made:
    """A trajectory and what the check said; `trajectory` is None where there is none that may leave."""

    trajectory: Trajectory | None
    nearest_m: float
    why: str


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def braked(caps: Any, spacing: float, deceleration: float) -> Any:
    """Speeds (n,) at most `caps` from which each later cap can be kept; at rest at the last."""
    out = caps.copy()
    out[-1] = 0.0
    for i in range(len(out) - 2, -1, -1):
        out[i] = min(out[i], math.sqrt(out[i + 1] ** 2 + 2.0 * deceleration * spacing))
    return out


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def gained(caps: Any, spacing: float, acceleration: float, first: float) -> Any:
    """Speeds (n,) at most `caps` that can be reached from the speed `first`."""
    out = caps.copy()
    out[0] = max(first, 0.0)
    for i in range(1, len(out)):
        out[i] = min(out[i], math.sqrt(out[i - 1] ** 2 + 2.0 * acceleration * spacing))
    return out


def unknown_caps(points_m: Array, arcs_m: Array, field: DistanceField, radius_m: float, a: float) -> Array:
    """Speed caps (n,) that let the outline stop before the first unknown place of the path, but creep on."""
    stop_m = first_unknown(Path(points_m, blocked=False), field, radius_m + BLIND_M) - radius_m - MARGIN_M
    if not math.isfinite(stop_m):
        return np.full(len(arcs_m), np.inf)
    caps: Array = np.maximum(CREEP_MPS, np.sqrt(2.0 * a * np.maximum(stop_m - arcs_m, 0.0)))
    return caps


def remaining(plan: Trajectory, start_s: float, source: Source | None = None) -> Trajectory:
    """What is left of a trajectory from `start_s` on, on the same step; it ends at the same rest."""
    left_s = max(plan.end_s - start_s, 0.0)
    steps = max(1, math.ceil(left_s / plan.step_s - 1e-6))
    times = start_s + plan.step_s * np.arange(steps + 1)
    grid = plan.start_s + plan.step_s * np.arange(len(plan.yaw_rad))

    def at(values: Array) -> Array:
        if values.ndim == 1:
            out: Array = np.interp(times, grid, values)
            return out
        return np.stack([np.interp(times, grid, column) for column in values.T], axis=1)

    return replace(
        plan,
        start_s=start_s,
        position_m=at(plan.position_m),
        velocity_mps=at(plan.velocity_mps),
        acceleration_mps2=at(plan.acceleration_mps2),
        yaw_rad=at(plan.yaw_rad),
        yaw_rate_rps=at(plan.yaw_rate_rps),
        speed_mps=at(plan.speed_mps),
        source=plan.source if source is None else source,
    )


def judged(plan: Trajectory, field: DistanceField, hard_m: float, dimensions: int) -> Verdict:
    """The dense check of a trajectory, sampled between its points as it will be followed."""
    points = plan.position_m[:, :dimensions]
    if len(points) > 1:
        halves = 0.5 * (points[1:] + points[:-1])
        points = np.insert(points, np.arange(1, len(points)), halves, axis=0)
    return dense_check(points, field, hard_m)
