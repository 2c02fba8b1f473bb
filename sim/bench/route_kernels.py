"""Compiled search over the places to stand and the cells to fly in, and straight cuts through both."""

from __future__ import annotations

import heapq
import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from sim.worlds.free_kernels import at_height

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def _price(room: float, near_m: float, near_cost: float) -> float:
    """Factor on a metre where the outline has `room` to spare."""
    return 1.0 + near_cost * max(0.0, 1.0 - room / near_m)


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def _away(target: Floats, x: float, y: float, z: float, cost_m: float) -> float:
    """Least cost from a point to the target."""
    return cost_m * math.sqrt((target[0] - x) ** 2 + (target[1] - y) ** 2 + (target[2] - z) ** 2)


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def search(  # noqa: C901 - two kinds of nodes and what joins them, in one loop
    land_xy: Floats,
    land_cell: float,
    ring: Floats,
    beside: Ints,
    floor_z: Floats,
    land_room: Any,
    top: Any,
    over: Ints,
    body_z: float,
    lift_min: float,
    lift_to: float,
    free: Any,
    air_room: Any,
    low: Floats,
    air_cell: float,
    place_starts: Ints,
    places: Ints,
    land_j_m: float,
    air_j_m: float,
    climb_j_m: float,
    switch_j: float,
    rise_j_m: float,
    near_m: float,
    near_cost: float,
    start: int,
    goal: int,
    pull_j_m: float,
) -> tuple[Floats, NDArray[np.int64]]:
    """A* from `start` until `goal` is settled. Nodes: places, then air cells.

    Args:
        land_xy: (n, 2) every place.
        land_cell: Distance of neighbouring columns [m].
        ring: (8,) distance to each neighbour in columns.
        beside: (n, 8) neighbours of every place.
        floor_z: (n,) floor of every place.
        land_room: (n,) clearance of every place.
        top: (n,) height to which the body may lift off there.
        over: (n,) air column over every place.
        body_z: Body origin above the floor when it stands.
        lift_min: Least height of a hop above that.
        lift_to: A take-off must have room up to this height and ends no lower than half a cell below it.
        free: (nx, ny, nz) cells to fly in.
        air_room: (nx, ny, nz) clearance in them.
        low: (3,) middle of the first cell.
        air_cell: Edge of a cell.
        place_starts: (nx * ny + 1,) where the places under an air column begin in `places`.
        places: Places by air column.
        land_j_m: Cost of a metre driven.
        air_j_m: Cost of a metre flown.
        climb_j_m: Cost of a metre climbed, on top.
        switch_j: Cost of a take-off or a landing.
        rise_j_m: Cost of a metre between floor and cell in a take-off or landing, on top.
        near_m: Clearance below which places cost more.
        near_cost: Extra factor at no clearance.
        start: Node.
        goal: Node.
        pull_j_m: Cost of a metre that no way undercuts: what the search is drawn by.

    Returns:
        Cost of every node reached, inf elsewhere, and the node before it, -1 without one.
    """
    nl = len(floor_z)
    nx, ny, nz = free.shape
    cost = np.full(nl + nx * ny * nz, math.inf)
    before = np.full(len(cost), -1, np.int64)
    done = np.zeros(len(cost), np.bool_)
    low_z = low[2]
    target = np.empty(3)
    if goal < nl:
        target[0], target[1], target[2] = land_xy[goal, 0], land_xy[goal, 1], floor_z[goal] + body_z
    else:
        cell = goal - nl
        target[0] = low[0] + (cell // (ny * nz)) * air_cell
        target[1] = low[1] + ((cell // nz) % ny) * air_cell
        target[2] = low[2] + (cell % nz) * air_cell
    cost[start] = 0.0
    heap = [(0.0, np.int64(start))]
    while len(heap) > 0:
        _, node = heapq.heappop(heap)
        if done[node]:
            continue
        done[node] = True
        if node == goal:
            break
        spent = cost[node]
        if node < nl:
            price = _price(land_room[node], near_m, near_cost)
            for d in range(8):
                other = beside[node, d]
                if other < 0:
                    continue
                way = math.hypot(ring[d] * land_cell, floor_z[other] - floor_z[node])
                factor = 0.5 * (price + _price(land_room[other], near_m, near_cost))
                then = spent + land_j_m * way * factor
                if then < cost[other]:
                    cost[other], before[other] = then, node
                    left = _away(
                        target, land_xy[other, 0], land_xy[other, 1], floor_z[other] + body_z, pull_j_m
                    )
                    heapq.heappush(heap, (then + left, np.int64(other)))
            stand = floor_z[node] + body_z
            if top[node] < lift_to:
                continue
            least = max(stand + lift_min, lift_to - 0.5 * air_cell)
            for k in range(max(0, math.ceil((least - low_z) / air_cell)), nz):
                z = low_z + k * air_cell
                if z > top[node]:
                    break
                if not free[over[node] // ny, over[node] % ny, k]:
                    continue
                other_air = np.int64(nl) + np.int64(over[node]) * nz + k
                then = spent + switch_j + (rise_j_m + climb_j_m) * (z - stand)
                if then < cost[other_air]:
                    cost[other_air], before[other_air] = then, node
                    left = _away(target, land_xy[node, 0], land_xy[node, 1], z, pull_j_m)
                    heapq.heappush(heap, (then + left, other_air))
        else:
            at = node - nl
            i, j, k = at // (ny * nz), (at // nz) % ny, at % nz
            price = _price(air_room[i, j, k], near_m, near_cost)
            for a in range(max(i - 1, 0), min(i + 1, nx - 1) + 1):
                for b in range(max(j - 1, 0), min(j + 1, ny - 1) + 1):
                    for c in range(max(k - 1, 0), min(k + 1, nz - 1) + 1):
                        if not free[a, b, c]:
                            continue
                        other_air = np.int64(nl) + (np.int64(a) * ny + b) * nz + c
                        way = air_cell * math.sqrt(float((a - i) ** 2 + (b - j) ** 2 + (c - k) ** 2))
                        factor = 0.5 * (price + _price(air_room[a, b, c], near_m, near_cost))
                        then = spent + air_j_m * way * factor + climb_j_m * air_cell * max(c - k, 0)
                        if then < cost[other_air]:
                            cost[other_air], before[other_air] = then, node
                            left = _away(
                                target,
                                low[0] + a * air_cell,
                                low[1] + b * air_cell,
                                low[2] + c * air_cell,
                                pull_j_m,
                            )
                            heapq.heappush(heap, (then + left, other_air))
            column = i * ny + j
            z = low_z + k * air_cell
            for m in range(place_starts[column], place_starts[column + 1]):
                place = places[m]
                stand = floor_z[place] + body_z
                if z < stand + lift_min or z > top[place]:
                    continue
                then = spent + switch_j + rise_j_m * (z - stand)
                if then < cost[place]:
                    cost[place], before[place] = then, node
                    left = _away(target, land_xy[place, 0], land_xy[place, 1], stand, pull_j_m)
                    heapq.heappush(heap, (then + left, np.int64(place)))
    return cost, before


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def land_cut(
    a: Floats,
    b: Floats,
    origin: Floats,
    cell: float,
    ny: int,
    starts: Ints,
    floor_z: Floats,
    room: Any,
    step: float,
    slope: float,
    near_m: float,
    near_cost: float,
) -> float:
    """Priced metres of a straight drive between floor points (3,), inf where it leaves the places."""
    flat = math.hypot(b[0] - a[0], b[1] - a[1])
    count = max(2, math.ceil(2.0 * flat / cell) + 1)
    nx = (len(starts) - 1) // ny
    z, price = a[2], 0.0
    give = step + slope * cell
    for s in range(count):
        u = s / (count - 1)
        i = math.floor((a[0] + u * (b[0] - a[0]) - origin[0]) / cell)
        j = math.floor((a[1] + u * (b[1] - a[1]) - origin[1]) / cell)
        if i < 0 or j < 0 or i >= nx or j >= ny:
            return math.inf
        k = at_height(starts, floor_z, i * ny + j, z, give)
        if k < 0:
            return math.inf
        z = floor_z[k]
        price += _price(room[k], near_m, near_cost)
    if abs(z - b[2]) > give:
        return math.inf
    return math.hypot(flat, b[2] - a[2]) * price / count


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def air_cut(
    a: Floats, b: Floats, origin: Floats, cell: float, free: Any, room: Any, near_m: float, near_cost: float
) -> float:
    """Priced metres of a straight flight between points (3,), inf where it leaves the free cells."""
    length = math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)
    count = max(2, math.ceil(3.0 * length / cell) + 1)
    nx, ny, nz = free.shape
    price = 0.0
    for s in range(count):
        u = s / (count - 1)
        i = math.floor((a[0] + u * (b[0] - a[0]) - origin[0]) / cell)
        j = math.floor((a[1] + u * (b[1] - a[1]) - origin[1]) / cell)
        k = math.floor((a[2] + u * (b[2] - a[2]) - origin[2]) / cell)
        if i < 0 or j < 0 or k < 0 or i >= nx or j >= ny or k >= nz or not free[i, j, k]:
            return math.inf
        price += _price(room[i, j, k], near_m, near_cost)
    return length * price / count
