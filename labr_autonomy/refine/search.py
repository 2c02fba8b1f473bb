"""Shortest paths on the map for when the network's key points are not usable.

Dijkstra over the 8-neighbour grid (scipy csgraph). Cells near obstacles cost more, unknown cells cost
`unknown_cost` times as much but may be crossed. The topology of a grid size is built once.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from labr_autonomy.perception.fields import Field2
from labr_autonomy.refine.reference import to_key_points
from labr_autonomy.types import Array

__all__ = ["cell_cost", "free_edges", "search_land", "snap", "straightened", "to_key_points"]

GOAL_SNAP_M = 0.5  # a goal farther from free space than this has no path
START_SNAP_M = 0.8
NEAR_COST, NEAR_M = 1.5, 0.25  # extra cost of a cell at the outline, and its decay with distance
KEEP_M = 0.05  # distance beyond the radius where the extra cost is full
ON_CELL = 0.51  # a goal this many cells from a cell's centre lies in it
GAIN = 1.02  # a straight cut may cost this much of what it replaces


def search_land(
    field: Field2, start_xy: Array, goal_xy: Array, radius_m: float, unknown_cost: float = 2.0
) -> Array | None:
    """Shortest drivable path from start to goal, (k, 2) odom with the start first; None if there is none.

    Args:
        field: The 2D map.
        start_xy: Where the robot is; moved to the nearest free cell within START_SNAP_M.
        goal_xy: Where to go; clamped into the map, then moved to the nearest free cell within GOAL_SNAP_M.
        radius_m: Least distance of the path to obstacles.
        unknown_cost: Factor on unknown cells (1 = as good as known).
    """
    distance = np.asarray(field.distance_m, dtype=float)
    free = distance > radius_m
    start = snap(field, free, start_xy, START_SNAP_M)
    inside = np.clip(goal_xy, field.origin_m + field.cell_m / 2, field.upper_m - field.cell_m / 2)
    goal = snap(field, free, inside, GOAL_SNAP_M)
    if start is None or goal is None:
        return None
    cost = cell_cost(distance, field.known, radius_m, unknown_cost)
    cells = _shortest(free, cost, start, goal)
    if cells is None:
        return None
    cells = straightened(cells, free, cost)
    path = field.origin_m + (cells + 0.5) * field.cell_m
    path[0] = start_xy
    wanted = np.asarray(goal_xy, dtype=float)
    on_cell = (
        float(np.abs(wanted - (field.origin_m + (goal + 0.5) * field.cell_m)).max()) <= ON_CELL * field.cell_m
    )
    if on_cell and float(field.lookup(wanted[None])[0]) > radius_m:
        end = wanted
    else:
        end = field.origin_m + (goal + 0.5) * field.cell_m
    return np.stack([path[0], end]) if len(path) == 1 else np.vstack([path[:-1], end])


def cell_cost(distance_m: Array, known: NDArray[np.bool_], radius_m: float, unknown_cost: float) -> Array:
    """Price of a metre in each cell: 1 far from obstacles, more near them and where nothing was seen."""
    price = 1.0 + NEAR_COST * np.exp(-np.maximum(distance_m - radius_m - KEEP_M, 0.0) / NEAR_M)
    out: Array = price * np.where(known, 1.0, unknown_cost)
    return out


def snap(field: Field2, free: NDArray[np.bool_], place: Array, reach_m: float) -> NDArray[np.int64] | None:
    """The free cell nearest to a place, (2,), or None beyond `reach_m`."""
    u = (np.asarray(place, dtype=float) - field.origin_m) / field.cell_m - 0.5
    reach = reach_m / field.cell_m
    low = np.maximum(np.floor(u - reach).astype(int), 0)
    high = np.maximum(np.ceil(u + reach).astype(int) + 1, 0)
    near = np.argwhere(free[low[0] : high[0], low[1] : high[1]]) + low
    if not len(near):
        return None
    gap = np.hypot(*(near - u).T)
    best = int(gap.argmin())
    # half a cell's diagonal is rounding, not distance
    return near[best] if gap[best] <= reach + math.sqrt(0.5) else None


@lru_cache(maxsize=4)
def _edges(shape: tuple[int, int]) -> tuple[NDArray[np.int32], NDArray[np.int32], Array]:
    """Both ends and the length in cells of every undirected edge of the grid."""
    number = np.arange(shape[0] * shape[1], dtype=np.int32).reshape(shape)
    tails, heads, lengths = [], [], []
    for (a, b), length in (
        ((np.s_[:-1, :], np.s_[1:, :]), 1.0),
        ((np.s_[:, :-1], np.s_[:, 1:]), 1.0),
        ((np.s_[:-1, :-1], np.s_[1:, 1:]), math.sqrt(2.0)),
        ((np.s_[:-1, 1:], np.s_[1:, :-1]), math.sqrt(2.0)),
    ):
        tails.append(number[a].ravel())
        heads.append(number[b].ravel())
        lengths.append(np.full(tails[-1].size, length))
    return np.concatenate(tails), np.concatenate(heads), np.concatenate(lengths)


def free_edges(free: NDArray[np.bool_], price: Array) -> tuple[NDArray[np.int32], NDArray[np.int32], Array]:
    """Both ends and the price in cells of every undirected edge between free cells."""
    tails, heads, lengths = _edges(free.shape)
    flat, each = free.ravel(), price.ravel()
    open_ = flat[tails] & flat[heads]
    tails, heads = tails[open_], heads[open_]
    return tails, heads, lengths[open_] * 0.5 * (each[tails] + each[heads])


def _shortest(
    free: NDArray[np.bool_], cost: Array, start: NDArray[np.int64], goal: NDArray[np.int64]
) -> NDArray[np.int64] | None:
    """Cells (k, 2) of the cheapest way through free cells, or None."""
    tails, heads, weight = free_edges(free, cost)
    size = free.size
    graph = csr_matrix((weight, (tails, heads)), shape=(size, size))
    first, last = (int(np.ravel_multi_index(tuple(c), free.shape)) for c in (start, goal))
    # from the goal, so that the predecessors lead from the start onwards
    reached, before = dijkstra(graph, directed=False, indices=last, return_predecessors=True)
    if not np.isfinite(reached[first]):
        return None
    way = [first]
    while way[-1] != last:
        way.append(int(before[way[-1]]))
    return np.stack(np.unravel_index(way, free.shape), axis=1)


def straightened(cells: NDArray[np.int64], free: NDArray[np.bool_], cost: Array) -> NDArray[np.int64]:
    """Corners only: straight cuts that stay free and cost no more than what they replace."""
    spans = np.hypot(*np.diff(cells, axis=0).T)
    price = cost[tuple(cells.T)]
    spent = np.concatenate([[0.0], np.cumsum(spans * 0.5 * (price[1:] + price[:-1]))])
    kept = [0]
    while kept[-1] < len(cells) - 1:
        i = kept[-1]
        j, hop = i + 1, 1
        while hop > 0:  # gallop ahead, then close in
            try_at = min(j + hop, len(cells) - 1)
            if try_at > j and _cut_ok(cells[i], cells[try_at], spent[try_at] - spent[i], free, cost):
                j, hop = try_at, hop * 2
            else:
                hop //= 2
        kept.append(j)
    return cells[kept]


def _cut_ok(
    a: NDArray[np.int64], b: NDArray[np.int64], budget: float, free: NDArray[np.bool_], cost: Array
) -> bool:
    length = math.hypot(*(b - a))
    steps = max(2, math.ceil(2.0 * length) + 1)
    line = a + np.linspace(0.0, 1.0, steps)[:, None] * (b - a)
    at = tuple(np.floor(line + 0.5).astype(int).T)
    return bool(free[at].all()) and length * float(cost[at].mean()) <= GAIN * budget
