"""A* on the map's grid, flat or in space, and straight cuts through what it finds. Indices are cells."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from labr_autonomy.perception.fields import Field2, Field3
from labr_autonomy.refine.search import cell_cost
from labr_autonomy.types import Array

UNKNOWN_COST = 1.0  # optimism: what was not seen is as good as free
START_SNAP_M = 0.8
GAIN = 1.02  # a straight cut may cost this much of what it replaces
EXPANSIONS_MAX = 60_000  # then the way to the place nearest to the goal is taken

_R2, _R3 = math.sqrt(2.0), math.sqrt(3.0)


@dataclass(frozen=True, slots=True)
class Way:
    """A path on the map."""

    points_m: Array  # (k, 2|3) odom, the start first
    reached: bool  # it ends at the goal, not at the nearest place that could be found
    cost_m: float  # weighted metres


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _guess(a: int, b: int, c: int) -> float:
    """Least number of cells between two cells that are (a, b, c) apart, by straight and diagonal steps."""
    a, b, c = abs(a), abs(b), abs(c)
    high = max(a, b, c)
    low = min(a, b, c)
    middle = a + b + c - high - low
    return float(high + (_R2 - 1.0) * middle + (_R3 - _R2) * low)


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _traced(before: Any, end: int, ny: int, nz: int) -> Any:
    """Cells (k, 3) of the way to a cell, from each cell's predecessor (-1 at the start)."""
    steps = 1
    at = end
    while before[at] >= 0:
        at = before[at]
        steps += 1
    way = np.empty((steps, 3), np.int64)
    at = end
    for k in range(steps - 1, -1, -1):
        way[k, 0], way[k, 1], way[k, 2] = at // (ny * nz), (at // nz) % ny, at % nz
        at = before[at]
    return way


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def search(free: Any, price: Any, start: Any, goal: Any, greed: float, most: int) -> tuple[Any, bool, float]:
    """Cheapest way between two cells over faces, edges and corners.

    Args:
        free: (nx, ny, nz) bool.
        price: (nx, ny, nz) float32, at least 1: cost of a cell's length in each cell.
        start: (3,) int, free.
        goal: (3,) int.
        greed: Factor on the heuristic; 1 finds the cheapest way.
        most: Cells that may be expanded.

    Returns:
        Cells (k, 3) of the way, whether it reaches the goal (else it ends at the expanded cell that is
        nearest to it), and its cost in cells.
    """
    nx, ny, nz = free.shape
    size = nx * ny * nz
    cost = np.full(size, np.inf, np.float64)
    before = np.full(size, -1, np.int32)
    done = np.zeros(size, np.bool_)
    first = (start[0] * ny + start[1]) * nz + start[2]
    last = (goal[0] * ny + goal[1]) * nz + goal[2]
    cost[first] = 0.0
    nearest = first
    gap = _guess(start[0] - goal[0], start[1] - goal[1], start[2] - goal[2])
    heap = [(greed * gap, first)]
    count = 0
    while len(heap) > 0 and count < most:
        at = heapq.heappop(heap)[1]
        if done[at]:
            continue
        done[at] = True
        count += 1
        x, y, z = at // (ny * nz), (at // nz) % ny, at % nz
        away = _guess(x - goal[0], y - goal[1], z - goal[2])
        if away < gap:
            gap, nearest = away, at
        if at == last:
            break
        for u in range(max(x - 1, 0), min(x + 2, nx)):
            for v in range(max(y - 1, 0), min(y + 2, ny)):
                for w in range(max(z - 1, 0), min(z + 2, nz)):
                    to = (u * ny + v) * nz + w
                    if done[to] or not free[u, v, w]:
                        continue
                    length = math.sqrt((u - x) ** 2 + (v - y) ** 2 + (w - z) ** 2)
                    new = cost[at] + 0.5 * length * (price[x, y, z] + price[u, v, w])
                    if new < cost[to]:
                        cost[to] = new
                        before[to] = at
                        guess = _guess(u - goal[0], v - goal[1], w - goal[2])
                        heapq.heappush(heap, (new + greed * guess, to))
    end = last if done[last] else nearest
    return _traced(before, end, ny, nz), bool(done[last]), cost[end]


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _cut_costs(a: Any, b: Any, free: Any, price: Any) -> float:
    """Cost of the straight line between two cells, inf where it is not free."""
    length = math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)
    steps = max(2, math.ceil(2.0 * length) + 1)
    total = 0.0
    for k in range(steps):
        f = k / (steps - 1)
        x = math.floor(a[0] + f * (b[0] - a[0]) + 0.5)
        y = math.floor(a[1] + f * (b[1] - a[1]) + 0.5)
        z = math.floor(a[2] + f * (b[2] - a[2]) + 0.5)
        if not free[x, y, z]:
            return math.inf
        total += price[x, y, z]
    return length * total / steps


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def straightened(way: Any, free: Any, price: Any, gain: float) -> Any:
    """Indices into `way` (k, 3) of its corners: the farthest straight cuts that are free and no dearer."""
    n = len(way)
    spent = np.zeros(n)
    for k in range(1, n):
        spent[k] = spent[k - 1] + _cut_costs(way[k - 1], way[k], free, price)
    kept = [0]
    while kept[-1] < n - 1:
        i = kept[-1]
        j = n - 1
        while j > i + 1 and not _cut_costs(way[i], way[j], free, price) <= gain * (spent[j] - spent[i]):
            j -= 1
        kept.append(j)
    return np.array(kept)


def nearest_free(free: NDArray[np.bool_], cell: Array, reach: float) -> NDArray[np.int64] | None:
    """The free cell nearest to a place in cells (3,), within `reach` cells; None if there is none."""
    low = np.clip(np.floor(cell - reach).astype(int), 0, np.array(free.shape) - 1)
    high = np.clip(np.ceil(cell + reach).astype(int) + 1, 1, np.array(free.shape))
    near = np.argwhere(free[low[0] : high[0], low[1] : high[1], low[2] : high[2]]) + low
    if not len(near):
        return None
    gap = np.linalg.norm(near - cell, axis=1)
    best = int(gap.argmin())
    return near[best] if gap[best] <= reach + 0.9 else None  # half a diagonal is rounding


def way_on_map(
    field: Field2 | Field3,
    start_m: Array,
    goal_m: Array,
    radius_m: float,
    reach_m: float,
    z_range_m: tuple[float, float] = (-math.inf, math.inf),
    greed: float = 1.0,
) -> Way | None:
    """Way from a place towards a goal, both (2|3,) odom; unknown cells count as free.

    Args:
        field: The map.
        start_m: Moved to the nearest free cell within `START_SNAP_M`.
        goal_m: Where it lies outside the map, the place where the straight line leaves the map stands in.
        radius_m: Least distance of the way to obstacles.
        reach_m: How far the goal may be moved to free space.
        z_range_m: Heights that may be used (3D only), odom.
        greed: Factor on the heuristic.

    Returns:
        None without a free place near the start.
    """
    flat = field.distance_m.ndim == 2
    distance = field.distance_m[:, :, None] if flat else field.distance_m
    free = distance > radius_m
    if not flat:
        height = field.origin_m[2] + (np.arange(distance.shape[2]) + 0.5) * field.cell_m
        free &= (height >= z_range_m[0]) & (height <= z_range_m[1])
    price = cell_cost(distance, np.ones((1, 1, 1), bool), radius_m, UNKNOWN_COST)  # type: ignore[arg-type]
    size = np.array(distance.shape)

    def cell_of(place: Array) -> Array:
        u = (np.asarray(place, float) - field.origin_m) / field.cell_m - 0.5
        return np.append(u, 0.0) if flat else u

    here, there = cell_of(start_m), cell_of(goal_m)
    inside = clipped(here, there, size - 1.0)
    whole = bool(np.abs(inside - there).max() < 0.51)
    start = nearest_free(free, here, START_SNAP_M / field.cell_m)
    if start is None:
        return None
    goal = nearest_free(free, inside, reach_m / field.cell_m)
    found = goal is not None
    if goal is None:
        goal = np.rint(np.clip(inside, 0, size - 1)).astype(np.int64)
    cells, reached, cost = search(free, price, start, goal, greed, EXPANSIONS_MAX)
    corners = cells[straightened(cells, free, price, GAIN)]
    d = 2 if flat else 3
    points = field.origin_m + (corners[:, :d] + 0.5) * field.cell_m
    begin = np.asarray(start_m, float)[None]
    points = np.vstack([begin, points[1:]]) if len(points) > 1 else np.vstack([begin, points])
    exact = np.asarray(goal_m, float)
    in_cell = whole and float(np.abs(goal - there).max()) < 0.51
    if reached and in_cell and float(field.lookup(exact[None])[0]) > radius_m:
        points[-1] = exact
    return Way(points, bool(reached and found), float(cost) * field.cell_m)


def clipped(here: Array, there: Array, high: Array) -> Array:
    """`there`, or where the straight line to it from `here` leaves the box [0, high]; (n,) each."""
    step = there - here
    part = 1.0
    for at, by, top in zip(here, step, high, strict=True):
        if by > 0.0 and at + by > top:
            part = min(part, max(0.0, (top - at) / by))
        elif by < 0.0 and at + by < 0.0:
            part = min(part, max(0.0, -at / by))
    out: Array = np.clip(here + part * step, 0.0, high)
    return out
