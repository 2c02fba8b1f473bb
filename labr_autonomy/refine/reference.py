"""Key points to a timed reference: drop what is behind, push it free, cut it where blocked, time it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from labr_autonomy.refine.values import STEP_S, STEPS, DistanceField
from labr_autonomy.types import Array

PITCH_M = 0.1  # spacing of the geometric path
CHECK_M = 0.05  # spacing of its clearance check: half a cell of the map
ROUNDS = 15  # of pushing
PUSH_M = 0.06  # most that one round moves a point
ACCELERATION_PART = 0.8  # of the limit is planned along the reference; the rest is left to follow it
CREEP_MPS = 0.25  # unknown space never slows the robot below this, so that it still goes and looks
END_M = 0.15  # an end that was pushed farther than this is not where the key points lead
BLIND_LAND_M = 0.6  # nearer to the outline than this the camera, low above the floor, may not have seen it
BLIND_AIR_M = 0.15  # its least distance is 0.3 m, and it looks out of the outline
MARGIN_M = 0.1  # left between the outline and the first unknown cell after stopping


@dataclass(frozen=True, slots=True)
class Path:
    """Geometry of the reference."""

    points_m: Array  # (n, d) from the robot on, at most PITCH_M apart
    blocked: bool  # the key points go on, but through an obstacle

    @property
    def length_m(self) -> float:
        """Arc length [m]."""
        return float(_steps(self.points_m).sum())

    def at(self, arc_m: float) -> Array:
        """Point at an arc length, clamped to the ends, (d,)."""
        point: Array = along(self.points_m, np.array([arc_m]))[0]
        return point


def to_key_points(path_m: Array, count: int = 5, spacing_m: float = 0.8) -> Array:
    """Up to `count` points every `spacing_m` along a path (k, d); the last is its end if it is reached.

    The start of the path is not among them. Fewer points are returned for a path shorter than their span.
    """
    path = np.asarray(path_m, dtype=float)
    length = float(_steps(path).sum())
    arcs = np.linspace(spacing_m, spacing_m * count, count)
    arcs = arcs[arcs < length - 1e-9]
    if len(arcs) < count:
        arcs = np.append(arcs, length)
    return along(path, arcs)


def along(points_m: Array, arcs_m: Array) -> Array:
    """Points (n, d) at arc lengths (n,) of a polyline, clamped to its ends."""
    reached = np.concatenate([[0.0], np.cumsum(_steps(points_m))])
    return np.stack([np.interp(arcs_m, reached, column) for column in points_m.T], axis=1)


def shape(start: Array, key_points_m: Array, field: DistanceField, hard_m: float, aim_m: float) -> Path:
    """The path from `start` (d,) along the key points (n, d), pushed out of obstacles.

    Args:
        start: Where the body's centre is.
        key_points_m: What to follow; may run through obstacles, as the network gives no guarantee.
        field: The map.
        hard_m: Distance of the centre to obstacles that may not be undercut.
        aim_m: Distance to push to where there is room.

    Returns:
        The free part. It is cut, and marked as blocked, at the first place that pushing could not free; it
        is blocked as well where its end had to be pushed away.
    """
    raw = np.vstack([start, _ahead(start, key_points_m)])
    length = float(_steps(raw).sum())
    if length < 1e-6:
        return Path(np.vstack([start, start]), blocked=False)
    points = along(raw, np.linspace(0.0, length, max(2, math.ceil(length / PITCH_M) + 1)))
    end = points[-1].copy()
    points = _pushed(points, field, hard_m, aim_m)
    short = float(np.linalg.norm(points[-1] - end)) > END_M
    fine = along(points, np.arange(0.0, float(_steps(points).sum()) + CHECK_M, CHECK_M))
    distance = field.lookup(fine)
    best = np.maximum.accumulate(distance)
    bad = distance < np.minimum(hard_m, best - 0.02)  # a start too close to something may leave it
    bad[0] = False
    if not bad.any():
        return Path(points, blocked=short)
    cut = max(2, int(bad.argmax()))
    return Path(fine[:cut], blocked=True)


def _ahead(start: Array, key_points_m: Array) -> Array:
    """The key points without those that the robot has already passed."""
    points = np.asarray(key_points_m, dtype=float)
    if len(points) < 2:
        return points
    leg, base = np.diff(points, axis=0), points[:-1]
    part = np.einsum("ij,ij->i", start - base, leg) / np.maximum(np.einsum("ij,ij->i", leg, leg), 1e-9)
    foot = base + np.clip(part, 0.0, 1.0)[:, None] * leg
    gap = np.linalg.norm(foot - start, axis=1)
    i = int(gap.argmin())
    if part[i] <= 0.0 or gap[i] > 0.5:  # before the leg's start, or too far from the path to tell
        return points[i:] if gap[i] <= 0.5 else points
    return points[i + 1 :]


def _pushed(points: Array, field: DistanceField, hard_m: float, aim_m: float) -> Array:
    """Points moved up the distance gradient to `aim_m`, lightly smoothed; free ends stay."""
    points = points.copy()
    keep_end = bool(field.lookup(points[-1:])[0] >= hard_m)
    for _ in range(ROUNDS):
        distance = field.lookup(points)
        low = distance < aim_m
        low[0] = False
        if keep_end:
            low[-1] = False
        if not low.any():
            break
        uphill = field.gradient(points[low])
        size = np.linalg.norm(uphill, axis=1, keepdims=True)
        # on the ridge between two walls the gradient vanishes: stay there
        step = np.minimum(aim_m - distance[low], PUSH_M)[:, None] * np.where(
            size > 0.3, uphill / np.maximum(size, 1e-6), 0.0
        )
        points[low] += step
        points[1:-1] = 0.5 * points[1:-1] + 0.25 * (points[:-2] + points[2:])
    return points


@dataclass(frozen=True, slots=True)
class Pace:
    """How fast the reference may be followed."""

    speed_mps: float
    acceleration_mps2: float
    radius_m: float  # of the outline
    blind_m: float  # unknown as close to the outline as this is taken as free: the camera cannot see there


def timed(path: Path, speed0_mps: float, pace: Pace, field: DistanceField) -> Array:
    """Reference positions (STEPS + 1, d), one every STEP_S, at rest at the end of the path.

    Unknown space: the speed along the path is limited so that the outline can stop MARGIN_M before the
    first place of the path that the map does not know, but never below CREEP_MPS; unknown places within
    `blind_m` of the robot's present outline count as free. Only the path's own line is looked at.
    """
    length = path.length_m
    unknown_m = first_unknown(path, field, pace.radius_m + pace.blind_m)
    stop_m = unknown_m - pace.radius_m - MARGIN_M
    a = ACCELERATION_PART * pace.acceleration_mps2
    arcs = np.empty(STEPS + 1)
    s, v = 0.0, min(max(speed0_mps, 0.0), pace.speed_mps)
    for k in range(STEPS + 1):
        arcs[k] = s
        allowed = min(pace.speed_mps, math.sqrt(2.0 * a * max(0.0, length - s)))
        if math.isfinite(stop_m):
            allowed = min(allowed, max(CREEP_MPS, math.sqrt(2.0 * a * max(0.0, stop_m - s))))
        faster = min(v + a * STEP_S, allowed)
        s = min(s + 0.5 * (v + faster) * STEP_S, length)
        v = faster
    return along(path.points_m, arcs)


def first_unknown(path: Path, field: DistanceField, blind_m: float) -> float:
    """Arc length of the first place on the path that the map does not know [m]; infinite if there is none.

    Places as near to its beginning as `blind_m` do not count.
    """
    arcs = np.arange(0.0, path.length_m + CHECK_M, CHECK_M)
    places = along(path.points_m, arcs)
    near = np.linalg.norm(places - places[0], axis=1) <= blind_m
    unknown = ~(field.is_known(places) | near)
    return float(arcs[unknown.argmax()]) if unknown.any() else math.inf


def _steps(points: Array) -> Array:
    out: Array = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return out
