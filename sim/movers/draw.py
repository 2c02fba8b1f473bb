"""Draws movers by seed, on tracks across a way and clear of all walls. Frame: odom; metres."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from labr_autonomy.config import Body
from labr_autonomy.types import Array
from sim.movers.mover import Mover, Shape
from sim.worlds.surface import Surface
from sim.worlds.surface_kernels import clear_of

SPEED_MPS = (0.6, 1.5)  # a stroll, and what the robot must bear (people walk at 1.2 to 1.5 m/s)
PAUSE_S = (2.0, 5.0)
REACH_M = (1.2, 4.0)  # to either side of the way
LENGTH_M = 1.5  # of a track, at least
SLANT_RAD = math.radians(40.0)  # off square to the way at most
START_CLEAR_M = 1.5  # of a track to the robot's start and goals: they are not fought for
WALL_M = 0.08  # beside the mover
PASS_M = 0.2  # beside a mover at the end of its track, for the robot to pass it
TURN_S = 0.3  # at an end without that room
APART_M = 0.1  # between movers
STEP_M = 0.1
STAIR_M = 0.06  # a floor that jumps by more between two steps is another floor
ANKLE_M = 0.10  # what is lower does not stop a mover
TRIES = 120  # for each mover
PERSON_SHARE = 2.0 / 3.0
PERSON = Shape("person", (0.25, 0.25), 1.75)
BOX_HALF_M = (0.2, 0.45)  # each way
BOX_HEIGHT_M = (0.5, 1.2)
_STREAM = 0x4D  # of random numbers, so that movers share none with world, task or noise


def draw_movers(
    count: int,
    seed: int,
    way_m: Array,
    places_m: Sequence[tuple[float, float, float]],
    surface: Surface,
    body: Body,
) -> tuple[Mover, ...]:
    """At most `count` movers; fewer where the world has no room for more.

    Args:
        count: How many are wanted.
        seed: Same seed, same movers.
        way_m: (n, 3) floor points of the likely way, odom.
        places_m: Start and goals, which no track comes near.
        surface: The world's triangles.
        body: The robot's outline.
    """
    if count <= 0 or len(way_m) < 3:
        return ()
    rng = np.random.default_rng([seed, _STREAM])
    kept: list[Mover] = []
    for _ in range(TRIES * count):
        found = _draw(rng, way_m, np.array(places_m)[:, :2], surface, body)
        if found is not None and all(_apart(found, other) for other in kept):
            kept.append(found)
            if len(kept) == count:
                break
    return tuple(kept)


def _draw(
    rng: np.random.Generator, way_m: Array, places_xy_m: Array, surface: Surface, body: Body
) -> Mover | None:
    """One mover, or None where the drawn track does not fit."""
    shape = _draw_shape(rng)
    i = int(rng.integers(1, len(way_m) - 1))
    slant, (right_m, left_m) = rng.uniform(-SLANT_RAD, SLANT_RAD), rng.uniform(*REACH_M, 2)
    speed, pause, share, forth = rng.uniform(*SPEED_MPS), rng.uniform(*PAUSE_S), rng.random(), rng.random()
    ahead = way_m[min(i + 3, len(way_m) - 1)] - way_m[max(i - 3, 0)]
    heading = math.atan2(float(ahead[1]), float(ahead[0])) + 0.5 * math.pi + slant
    across = np.array([math.cos(heading), math.sin(heading)])
    left = _walkable(way_m[i], across, left_m, shape, surface)
    right = _walkable(way_m[i], -across, right_m, shape, surface)
    if len(left) < 2 or len(right) < 2 or STEP_M * (len(left) + len(right) - 2) < LENGTH_M:
        return None
    floor = np.concatenate([right[:0:-1], left])
    low, high = STEP_M * (len(right) - 1), STEP_M * (len(left) - 1)
    first, last = way_m[i, :2] - low * across, way_m[i, :2] + high * across
    beside_m = shape.radius_m + body.radius_m + PASS_M
    passed = [_gap_m(end, way_m) >= beside_m for end in (first, last)]
    if not any(passed):
        return None
    if min(_beside_m(place, first, last) for place in places_xy_m) < START_CLEAR_M + shape.radius_m:
        return None
    return Mover(
        shape,
        ((float(first[0]), float(first[1])), (float(last[0]), float(last[1]))),
        tuple(round(float(z), 4) for z in floor),
        float(speed),
        (float(pause) if passed[0] else TURN_S, float(pause) if passed[1] else TURN_S),
        float(share * (low + high)),
        bool(forth < 0.5),
    )


def _draw_shape(rng: np.random.Generator) -> Shape:
    kind, long, wide, height = rng.random(4)
    if kind < PERSON_SHARE:
        return PERSON
    low, high = BOX_HALF_M
    half = (low + long * (high - low), low + wide * (high - low))
    return Shape("box", half, BOX_HEIGHT_M[0] + height * (BOX_HEIGHT_M[1] - BOX_HEIGHT_M[0]))


def _walkable(from_m: Array, direction: Array, reach_m: float, shape: Shape, surface: Surface) -> Array:
    """Heights of the floor at steps from a point on it, as far as the mover can go, (n,) odom."""
    away = STEP_M * np.arange(round(reach_m / STEP_M) + 1)
    xy = from_m[:2] + away[:, None] * direction
    floor = surface.floors_below(xy, float(from_m[2]) + 0.5)
    known = np.isfinite(floor)
    even = np.where(known, floor, 1e6)  # where there is none, it jumps
    jumps = np.abs(np.diff(even, prepend=from_m[2])) > STAIR_M
    low = floor + ANKLE_M
    clear = np.zeros(len(xy), bool)
    clear[known] = clear_of(
        *surface.index,
        xy[known],
        shape.radius_m,
        low[known],
        floor[known] + shape.height_m,
        True,
        WALL_M,
        np.zeros((int(known.sum()), 2)),
    )
    stops = np.flatnonzero(jumps | ~clear)
    free: Array = floor[: int(stops[0])] if len(stops) else floor
    return free


def _gap_m(point_m: Array, way_m: Array) -> float:
    return float(np.hypot(*(way_m[:, :2] - point_m).T).min())


def _beside_m(point_m: Array, first_m: Array, last_m: Array) -> float:
    """Distance of a point from a segment, (2,) each."""
    step = last_m - first_m
    share = float(np.clip((point_m - first_m) @ step / (step @ step), 0.0, 1.0))
    return float(np.hypot(*(first_m + share * step - point_m)))


def _apart(a: Mover, b: Mover) -> bool:
    """Whether two tracks never bring their movers together."""
    ends_a, ends_b = np.array(a.ends_m), np.array(b.ends_m)
    needed = a.shape.radius_m + b.shape.radius_m + APART_M
    if _cross(ends_a, ends_b):
        return False
    gaps = [_beside_m(p, *ends_b) for p in ends_a] + [_beside_m(p, *ends_a) for p in ends_b]
    return min(gaps) >= needed


def _cross(a: Array, b: Array) -> bool:
    """Whether two segments (2, 2) cross."""

    def side(p: Array, q: Array, r: Array) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    apart_b = side(a[0], a[1], b[0]) * side(a[0], a[1], b[1]) < 0.0
    return apart_b and side(b[0], b[1], a[0]) * side(b[0], b[1], a[1]) < 0.0
