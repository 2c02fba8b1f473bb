"""Compiled kernels of the driving layer (`driving_layer`). Lengths in metres, places in cells."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from labr_autonomy.perception.compiled import compiled
from labr_autonomy.perception.ground import BELOW, FLOOR, NOTHING, STANDS
from labr_autonomy.perception.point_distance import SPOT
from labr_autonomy.perception.raycast import add_return, return_worth, wholly_in_view

CELL_M = 0.05
HIT, MISS = 20, 2
LOWEST, HIGHEST = -20, 70
LIKELY, NEAR_M = -10, 3.0  # a cell is no surer to be free than this before rays pass it nearer than that
OCCUPIED = 30
EDGES_M = (0.05, 0.10, 0.20)  # between the heights whose evidence is kept apart: castors, legs, ...
BANDS = len(EDGES_M) + 1
NO_FLOOR = -32768  # of the heights [mm]
DROP = 6  # worth of a place where a floor is missing
FLOOR_SHARE = 0.3  # of a new height in a cell's
SPOT_SHARE = 0.1  # of a return in the mean place of its cell's returns
STEP_M = 0.10  # neighbouring floors farther apart than this are a ledge
FLOOR_TO_M = 4.0  # heights are believed up to this distance
DROP_TO_M = 3.0  # and missing floors up to this one


@compiled
def band(above_m: float) -> int:
    """Which of the heights something is at; what is outside belongs to the nearest."""
    level = 0
    for edge in EDGES_M:
        if above_m >= edge:
            level += 1
    return level


@compiled
def _carve(
    marks: Any,
    touched: Any,
    count: int,
    n: int,
    x0: float,
    y0: float,
    x1: float,
    y1: float,
    above_0: float,
    above_1: float,
    bands: Any,
    near: float,
) -> int:
    """Mark the cells between two places (floats) as passed, at the ray's heights (Amanatides-Woo 1987).

    Beyond `near`, a share of the way, rays are too far apart to tell more than that a cell is likely free.
    """
    far = 1e18
    i, j = math.floor(x0), math.floor(y0)
    dx, dy = x1 - x0, y1 - y0
    sx = 1 if dx > 0.0 else -1
    sy = 1 if dy > 0.0 else -1
    step_x = abs(1.0 / dx) if dx != 0.0 else far
    step_y = abs(1.0 / dy) if dy != 0.0 else far
    next_x = ((i + 1 - x0) if dx > 0.0 else (x0 - i)) * step_x if dx != 0.0 else far
    next_y = ((j + 1 - y0) if dy > 0.0 else (y0 - j)) * step_y if dy != 0.0 else far
    here = band(above_0)
    while 0 <= i < n and 0 <= j < n:
        leave = min(next_x, next_y, 1.0)
        there = band(above_0 + leave * (above_1 - above_0))
        for k in range(min(here, there), max(here, there) + 1):
            index = (i * n + j) * BANDS + k
            if marks[index] == 0 and (leave <= near or bands[index] > LIKELY):
                marks[index] = 1
                touched[count] = index
                count += 1
        here = there
        if leave >= 1.0:
            return count
        if next_x < next_y:
            next_x += step_x
            i += sx
        else:
            next_y += step_y
            j += sy
    return count


@compiled
def _fill(
    marks: Any, touched: Any, count: int, odds: Any, spots: Any, x: float, y: float, level: int, worth: int
) -> int:
    """Add a return to the cell of a place, and its spot to the mean of the cell's returns."""
    n = odds.shape[0]
    i, j = math.floor(x), math.floor(y)
    if not (0 <= i < n and 0 <= j < n):
        return count
    index = (i * n + j) * BANDS
    old = odds[i, j] > 0
    for k in range(BANDS):
        old |= marks[index + k] > 1
    share = SPOT_SHARE if old else 1.0
    for axis, spot in enumerate((x - i - 0.5, y - j - 0.5)):
        at = spots[i, j, axis]
        spots[i, j, axis] = round(at + share * (SPOT * spot - at))
    count = add_return(marks, touched, count, index + level, worth, HIT)
    return count


@compiled
def judge(bands: Any, odds: Any) -> None:
    """Make one evidence of that of all heights: the strongest for something, else that just above the floor.

    Rays that passed higher up say nothing of a door stop in the shadow of another. What hangs over a place
    hides it in the image instead (`cast`), and open ground shows nothing above.
    """
    for i in range(odds.shape[0]):
        for j in range(odds.shape[1]):
            most = bands[i, j, 0]
            for k in range(1, BANDS):
                most = max(most, bands[i, j, k])
            odds[i, j] = most if most > 0 else bands[i, j, 0]


@compiled
def _at_height(above_0: float, above_1: float, top_m: float) -> tuple[float, float]:
    """Part (begin, end) of a ray that runs between floor and robot's top; begin >= end where none does.

    Args:
        above_0: Height of the camera above the floor.
        above_1: Height of the return above the floor there; below 0 where the floor is missing.
        top_m: Robot's height.
    """
    begin, end = 0.0, 1.0
    fall = above_0 - above_1
    if above_0 > top_m:
        begin = (above_0 - top_m) / fall if above_1 < top_m else 2.0
    elif above_1 > top_m:
        end = (above_0 - top_m) / fall
    if above_1 < 0.0:
        end = above_0 / fall
    return begin, end


@compiled
def _take_return(
    kind: int,
    above_m: float,
    run_m: float,
    end: float,
    x: float,
    y: float,
    eye_x: float,
    eye_y: float,
    spread: float,
    floor_mm: float,
    top_m: float,
    range_m: float,
    heights: Any,
    odds: Any,
    spots: Any,
    marks: Any,
    touched: Any,
    count: int,
) -> int:
    """What a return says of its cell (x, y): its floor's height, or that something is there."""
    n = heights.shape[0]
    if kind == FLOOR and run_m <= FLOOR_TO_M:
        i, j = math.floor(x), math.floor(y)
        if 0 <= i < n and 0 <= j < n:
            old = heights[i, j]
            fresh = floor_mm if old == NO_FLOOR else old + FLOOR_SHARE * (floor_mm - old)
            heights[i, j] = round(min(max(fresh, -32000.0), 32000.0))
    elif kind == STANDS and above_m <= top_m and run_m <= range_m:
        count = _fill(
            marks, touched, count, odds, spots, x, y, band(above_m), return_worth(HIT, CELL_M, spread)
        )
    elif kind == BELOW and above_m < -STEP_M and end * run_m <= DROP_TO_M:
        at_x, at_y = eye_x + end * (x - eye_x), eye_y + end * (y - eye_y)
        count = _fill(marks, touched, count, odds, spots, at_x, at_y, 0, DROP)
    return count


@compiled
def cast(
    depth: Any,
    kinds: Any,
    floors: Any,
    optics: Any,
    rotation: Any,
    eye: Any,
    corner: Any,
    top_m: float,
    sampling: Any,
    range_m: float,
    heights: Any,
    bands: Any,
    odds: Any,
    spots: Any,
    marks: Any,
    touched: Any,
) -> int:
    """Mark what an image says, take its floors into `heights` and its returns' places into `spots`.

    See `DrivingLayer.update`.

    `corner` ends in the floor's height. Returns how many cells were touched.
    """
    h, w = depth.shape
    n = heights.shape[0]
    fx, fy, cx, cy, sigma_1 = optics
    count = 0
    ex, ey = (eye[0] - corner[0]) / CELL_M, (eye[1] - corner[1]) / CELL_M
    height = eye[2] - corner[2]
    before = np.full(w, np.inf)  # along each column: how far it is to what stands, among the rows above
    for v in range(sampling[1], h, sampling[0]):  # from the uppermost row down
        for u in range(sampling[2], w, sampling[0]):
            kind = kinds[v, u]
            if kind == NOTHING:
                continue
            z = depth[v, u]
            left, up = -(u - cx) / fx, -(v - cy) / fy
            dx = rotation[0, 0] + rotation[0, 1] * left + rotation[0, 2] * up
            dy = rotation[1, 0] + rotation[1, 1] * left + rotation[1, 2] * up
            dz = rotation[2, 0] + rotation[2, 1] * left + rotation[2, 2] * up
            flat = math.sqrt(dx * dx + dy * dy)
            run, spread = z * flat, sigma_1 * z * z * flat
            # the floor is taken as even from the robot to the return
            above = eye[2] + z * dz - floors[v, u]
            begin, end = _at_height(height, above, top_m)
            begin = max(begin, wholly_in_view(min(u, w - 1 - u), min(v, h - 1 - v), fx, fy, CELL_M) / z)
            margin = max(0.5 * CELL_M, 2.0 * spread)
            stop = max(0.0, 1.0 - margin / max(run, 1e-6)) if kind == STANDS and end == 1.0 else end
            stop = min(stop, min(range_m, before[u]) / max(run, 1e-6))  # beyond, it passes below something
            if kind == STANDS and above <= top_m:
                before[u] = min(before[u], run - margin)
            kx, ky = z * dx / CELL_M, z * dy / CELL_M
            if begin < stop:
                count = _carve(
                    marks,
                    touched,
                    count,
                    n,
                    ex + begin * kx,
                    ey + begin * ky,
                    ex + stop * kx,
                    ey + stop * ky,
                    height + begin * (above - height),
                    height + stop * (above - height),
                    bands,
                    (NEAR_M / max(run, 1e-6) - begin) / (stop - begin),
                )
            count = _take_return(
                kind,
                above,
                run,
                end,
                ex + kx,
                ey + ky,
                ex,
                ey,
                spread,
                1000.0 * floors[v, u],
                top_m,
                range_m,
                heights,
                odds,
                spots,
                marks,
                touched,
                count,
            )
    return count


@compiled
def looked_through(odds: Any, sum_max: int, out: Any) -> None:
    """Mark squares of four cells none of which holds anything and whose evidence sums up to so little."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            most, total = -128, 0
            for a in range(2):
                for b in range(2):
                    most = max(most, odds[2 * i + a, 2 * j + b])
                    total += odds[2 * i + a, 2 * j + b]
            out[i, j] = most <= 0 and total <= sum_max


@compiled
def ledges(heights: Any, step_mm: int, occupied: Any) -> None:
    """Mark cells whose floor lies more than a step off a neighbour's, two cells away at most."""
    n, m = heights.shape
    for i in range(n):
        for j in range(m):
            here = heights[i, j]
            if here == NO_FLOOR:
                continue
            for a, b in ((1, 0), (0, 1), (2, 0), (0, 2)):
                if i + a < n and j + b < m:
                    there = heights[i + a, j + b]
                    if there != NO_FLOOR and abs(here - there) > step_mm:
                        occupied[i, j] = True
                        occupied[i + a, j + b] = True
