"""Compiled shortest ways on a grid: Dijkstra from one cell over its eight neighbours, with a binary heap."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Cells = NDArray[np.int32]

_DIAGONAL = math.sqrt(2.0)


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _push(keys: Any, items: Any, size: int, key: float, item: int) -> int:
    """Sift up."""
    at = size
    while at > 0:
        above = (at - 1) >> 1
        if keys[above] <= key:
            break
        keys[at], items[at] = keys[above], items[above]
        at = above
    keys[at], items[at] = key, item
    return size + 1


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _pop(keys: Any, items: Any, size: int) -> int:
    """Take the root away and sift the last one down; returns the new size."""
    size -= 1
    key, item = keys[size], items[size]
    at = 0
    while True:
        below = 2 * at + 1
        if below >= size:
            break
        if below + 1 < size and keys[below + 1] < keys[below]:
            below += 1
        if key <= keys[below]:
            break
        keys[at], items[at] = keys[below], items[below]
        at = below
    keys[at], items[at] = key, item
    return size


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def costs_from(free: NDArray[np.bool_], price: Floats, goal: int) -> tuple[Floats, Cells]:
    """Least cost from every cell to one cell, and the next cell on the way there.

    Args:
        free: (nx, ny) cells that may be entered.
        price: (nx, ny) cost of one cell's edge length in each cell; a step pays the mean of both ends.
        goal: Flat index of the cell to reach; it need not be free.

    Returns:
        Cost (nx * ny,), inf where there is no way, and the next cell (nx * ny,), -1 at the goal and there.
    """
    nx, ny = free.shape
    cost = np.full(nx * ny, np.inf)
    after = np.full(nx * ny, -1, np.int32)
    done = np.zeros(nx * ny, np.bool_)
    keys, items = np.empty(8 * nx * ny), np.empty(8 * nx * ny, np.int32)
    cost[goal] = 0.0
    size = _push(keys, items, 0, 0.0, goal)
    while size > 0:
        here = items[0]
        size = _pop(keys, items, size)
        if done[here]:
            continue
        done[here] = True
        i, j = here // ny, here % ny
        for di in range(-1, 2):
            a = i + di
            if a < 0 or a >= nx:
                continue
            for dj in range(-1, 2):
                b = j + dj
                if (di == 0 and dj == 0) or b < 0 or b >= ny or not free[a, b]:
                    continue
                there = a * ny + b
                if done[there]:
                    continue
                length = _DIAGONAL if di != 0 and dj != 0 else 1.0
                total = cost[here] + length * 0.5 * (price[i, j] + price[a, b])
                if total < cost[there]:
                    cost[there] = total
                    after[there] = here
                    size = _push(keys, items, size, total, there)
    return cost, after


def warm_up() -> None:
    """Compile or load the kernel, so that the first search of a flight is not late."""
    costs_from(np.ones((3, 3), np.bool_), np.ones((3, 3)), 4)
