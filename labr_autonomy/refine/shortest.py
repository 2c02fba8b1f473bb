"""Compiled shortest ways on a grid: Dijkstra from some cells over their eight neighbours, with buckets.

Cells wait in buckets as wide as the cheapest step (R. Dial, "Algorithm 360: Shortest-path forest with
topological ordering", 1969): no step leads into the bucket it starts from, so the cells of one bucket are
final in any order and no heap is needed.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Cells = NDArray[np.int32]

_DIAGONAL = math.sqrt(2.0)
_NARROWER = 1.0 - 1e-9  # so that no rounding puts a step of the least cost into its own bucket


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _extremes(price: Any, cost: Any) -> tuple[float, float]:
    """Least and highest price among the cells that may be entered and the one to reach."""
    least, most = np.inf, 0.0
    for k in range(len(price)):
        if cost[k] >= 0.0:
            least, most = min(least, price[k]), max(most, price[k])
    return least, most


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _without_border(cost: Any, towards: Any, nx: int, ny: int) -> tuple[Any, Any]:
    """Costs and next cells of the grid itself, inf and -1 where there is no way."""
    row = ny + 2
    costs, ways = np.full(nx * ny, np.inf), np.full(nx * ny, -1, np.int32)
    for i in range(nx):
        for j in range(ny):
            k = (i + 1) * row + j + 1
            if cost[k] >= 0.0:
                costs[i * ny + j] = cost[k]
            if towards[k] >= 0:
                ways[i * ny + j] = (towards[k] // row - 1) * ny + towards[k] % row - 1
    return costs, ways


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _unlink(heads: Any, before: Any, after: Any, bucket: int, item: int) -> None:
    """Take a cell out of its bucket's list."""
    if before[item] >= 0:
        after[before[item]] = after[item]
    else:
        heads[bucket] = after[item]
    if after[item] >= 0:
        before[after[item]] = before[item]


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _link(heads: Any, before: Any, after: Any, bucket: int, item: int) -> None:
    """Put a cell in front of its bucket's list."""
    first = heads[bucket]
    before[item], after[item] = -1, first
    if first >= 0:
        before[first] = item
    heads[bucket] = item


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _move(heads: Any, before: Any, after: Any, bucket_of: Any, item: int, bucket: int) -> int:
    """Put a cell into a bucket's list, taking it out of its old one; 1 if it was in none."""
    fresh = bucket_of[item] < 0
    if not fresh:
        _unlink(heads, before, after, bucket_of[item], item)
    bucket_of[item] = bucket
    _link(heads, before, after, bucket, item)
    return 1 if fresh else 0


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def costs_from(
    free: NDArray[np.bool_], price: Floats, ends: NDArray[np.int64], offers: Floats
) -> tuple[Floats, Cells]:
    """Least cost from every cell to where the ways may end, and the next cell on the way there.

    Args:
        free: (nx, ny) cells that may be entered.
        price: (nx, ny) cost of one cell's edge length in each cell, above 0; a step pays the mean of
            both ends.
        ends: (k,) flat indices of cells at which a way may end; they need not be free.
        offers: (k,) what ending there costs, in rising order.

    Returns:
        Cost (nx * ny,), inf where there is no way, and the next cell (nx * ny,), -1 where a way ends and
        where there is none.
    """
    nx, ny = free.shape
    row = ny + 2  # a border of cells that are not free spares every neighbour its two tests
    n = (nx + 2) * row
    cost, halves = np.full(n, -np.inf), np.zeros(n)  # nothing is cheaper than what is not free
    for i in range(nx):
        for j in range(ny):
            k = (i + 1) * row + j + 1
            halves[k] = 0.5 * price[i, j]
            if free[i, j]:
                cost[k] = np.inf
    for end in ends:
        cost[(end // ny + 1) * row + end % ny + 1] = np.inf
    least, most = _extremes(halves, cost)
    per_bucket = 0.5 / (least * _NARROWER)
    count = int(2.0 * _DIAGONAL * most * per_bucket) + 2  # the farthest that a step leads, and round again
    heads = np.full(count, -1, np.int32)
    before, after, bucket_of = np.empty(n, np.int32), np.empty(n, np.int32), np.full(n, -1, np.int32)
    towards = np.full(n, -1, np.int32)
    offsets = (-row - 1, -row, -row + 1, -1, 1, row - 1, row, row + 1)
    lengths = (_DIAGONAL, 1.0, _DIAGONAL, 1.0, 1.0, _DIAGONAL, 1.0, _DIAGONAL)
    waiting, bucket, taken = 0, 0, 0  # `bucket` counts on; its list is that of the remainder
    while waiting > 0 or taken < len(ends):
        if waiting == 0:
            bucket = int(offers[taken] * per_bucket)
        while taken < len(ends) and int(offers[taken] * per_bucket) <= bucket:
            end = (ends[taken] // ny + 1) * row + ends[taken] % ny + 1
            if offers[taken] < cost[end]:
                cost[end], towards[end] = offers[taken], -1
                waiting += _move(heads, before, after, bucket_of, end, bucket % count)
            taken += 1
        here = heads[bucket % count]
        if here < 0:
            bucket += 1
            continue
        _unlink(heads, before, after, bucket % count, here)
        bucket_of[here] = -1
        waiting -= 1
        for k in range(8):
            there = here + offsets[k]
            total = cost[here] + lengths[k] * (halves[here] + halves[there])
            if total >= cost[there]:  # so are all that are final
                continue
            cost[there], towards[there] = total, here
            waiting += _move(heads, before, after, bucket_of, there, int(total * per_bucket) % count)
    costs, ways = _without_border(cost, towards, nx, ny)
    return costs, ways


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def cut_cost(cells: NDArray[np.int64], begin: int, end: int, free: NDArray[np.bool_], price: Floats) -> float:
    """Cost of going straight from one cell of a way to a later one, inf where that is not free.

    Args:
        cells: (k, 2) the way.
        begin: Number of the first cell.
        end: Number of the other.
        free: (nx, ny) cells that may be entered.
        price: (nx, ny) as for `costs_from`.
    """
    x, y = cells[begin, 0], cells[begin, 1]
    dx, dy = cells[end, 0] - x, cells[end, 1] - y
    length = math.sqrt(dx * dx + dy * dy)
    steps = max(2, math.ceil(2.0 * length) + 1)
    total = 0.0
    for k in range(steps):
        share = k / (steps - 1)
        i, j = math.floor(x + share * dx + 0.5), math.floor(y + share * dy + 0.5)
        if not free[i, j]:
            return math.inf
        total += price[i, j]
    return length * total / steps


def warm_up() -> None:
    """Compile or load the kernels, so that the first search of a flight is not late."""
    free, price = np.ones((3, 3), np.bool_), np.ones((3, 3))
    costs_from(free, price, np.array([4]), np.zeros(1))
    cut_cost(np.zeros((2, 2), np.int64), 0, 1, free, price)
