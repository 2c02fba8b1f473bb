"""Shortest paths on the map for when the network's key points are not usable.

Dijkstra over the 8-neighbour grid (`shortest`). Cells near obstacles cost more, unknown cells cost
`unknown_cost` times as much but may be crossed.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from labr_autonomy.frames import wrap_pi
from labr_autonomy.perception.fields import Bits, Field2
from labr_autonomy.refine.shortest import costs_from, cut_cost
from labr_autonomy.types import Array

GOAL_SNAP_M = 0.5  # a goal farther from free space than this has no path
START_SNAP_M = 0.8
NEAR_COST, NEAR_M = 1.5, 0.25  # extra cost of a cell at the outline, and its decay with distance
KEEP_M = 0.05  # distance beyond the radius where the extra cost is full
ON_CELL = 0.51  # a goal this many cells from a cell's centre lies in it
UNKNOWN_COST = 3.0  # factor on unknown cells: cheaper, it looks into every room on the way
LIKELY_COST = 8.0  # factor on unknown cells that are likely solid
NARROW_COST = 3.0  # factor on cells that are nearer to obstacles than a way likes to be
TIGHT_COST = 20.0  # factor on cells that are nearer to obstacles than a way should be
CLOSED_M = 0.35  # round a place through which no way is to lead
GAIN = 1.02  # a straight cut may cost this much of what it replaces
LEG_M = 0.8  # a way's first direction is that to its place so far along
BEARINGS = 24  # other directions that are looked at
TAKEN_M = 0.05  # a beginning is another one when it is better by this


class CostToGo:
    """Shortest ways from everywhere on a 2D map to one goal, or to wherever ending is cheap.

    One Dijkstra, many questions. Costs are metres, weighted near obstacles and in unknown cells.

    Args:
        field: The 2D map.
        goal_xy: (2,) odom; clamped into the map, then moved to the nearest free cell within `reach_m`.
        radius_m: Least distance of a way to obstacles.
        unknown_cost: Factor on unknown cells (1 = as good as known).
        reach_m: How far the goal may be moved to free space.
        roomy_m: Ways keep this distance where the detour is short: nearer is dearer by `NARROW_COST`.
        tight_m: Ways may come as near as this to obstacles, at `TIGHT_COST`; `radius_m` when left out.
        closed: (k, 2) places that no way leads through, within `CLOSED_M`.
        likely: (nx, ny) unknown cells that are likely solid: ways past them are dearer by `LIKELY_COST`.
        offers: (nx, ny) what it costs to go on from each cell by other means [m], inf where that cannot be.
            Ways then end where they and the offer together are cheapest, not at the goal.
    """

    def __init__(
        self,
        field: Field2,
        goal_xy: Array,
        radius_m: float,
        unknown_cost: float = UNKNOWN_COST,
        reach_m: float = GOAL_SNAP_M,
        *,
        roomy_m: float = 0.0,
        tight_m: float | None = None,
        closed: Sequence[Array] = (),
        likely: Bits | None = None,
        offers: Array | None = None,
    ) -> None:
        self._field = field
        self._radius_m = radius_m
        self._goal_xy = np.asarray(goal_xy, dtype=float)
        distance = np.asarray(field.distance_m, dtype=float)
        self._free = distance > (radius_m if tight_m is None else tight_m)
        for place in closed:
            _shut(self._free, (place - field.origin_m) / field.cell_m - 0.5, CLOSED_M / field.cell_m)
        sure = _surely_known(field, radius_m)
        self._price = cell_cost(distance, sure, radius_m, unknown_cost)
        if roomy_m > radius_m:
            self._price = np.where(distance > roomy_m, self._price, NARROW_COST * self._price)
        if likely is not None:
            self._price = np.where(_within(likely, radius_m / field.cell_m), LIKELY_COST, 1.0) * self._price
        if tight_m is not None:
            self._price = np.where(distance > radius_m, self._price, TIGHT_COST * self._price)
        ends, costs = self._goal(reach_m) if offers is None else self._offered(offers)
        self._cost_m: Array = np.full(self._free.size, np.inf)
        self._before = np.full(self._free.size, -1, np.int32)
        if len(ends):  # from the ends: leads onwards
            cost, self._before = costs_from(self._free, self._price, ends, costs / field.cell_m)
            self._cost_m = cost * field.cell_m

    def _goal(self, reach_m: float) -> tuple[NDArray[np.int64], Array]:
        field = self._field
        low, high = field.origin_m + field.cell_m / 2, field.upper_m - field.cell_m / 2
        cell = snap(field, self._free, np.clip(self._goal_xy, low, high), reach_m)
        found = [] if cell is None else [np.ravel_multi_index(tuple(cell), self._free.shape)]
        return np.array(found, np.int64), np.zeros(len(found))

    def _offered(self, offers: Array) -> tuple[NDArray[np.int64], Array]:
        ends = np.flatnonzero(self._free & np.isfinite(offers))
        costs = offers.ravel()[ends]
        order = np.argsort(costs, kind="stable")
        return ends[order], costs[order]

    def _place(self, index: int) -> Array:
        """Where a way ends that ends in a cell, (2,): the goal itself if it lies there and is free."""
        field = self._field
        cell = np.array(np.unravel_index(index, self._free.shape))
        centre: Array = field.origin_m + (cell + 0.5) * field.cell_m
        in_cell = float(np.abs(self._goal_xy - centre).max()) <= ON_CELL * field.cell_m
        free = in_cell and float(field.lookup(self._goal_xy[None])[0]) > self._radius_m
        return self._goal_xy if free else centre

    def _way(self, place_xy: Array) -> list[int] | None:
        """The cells of the way from a place, None without one."""
        at = self._index(place_xy)
        if at is None or not np.isfinite(self._cost_m[at]):
            return None
        return self._onwards(at)

    def end(self, place_xy: Array) -> Array | None:
        """Where the way from a place (2,) ends, (2,) odom; None without a way."""
        way = self._way(place_xy)
        return None if way is None else self._place(way[-1])

    def _index(self, place_xy: Array) -> int | None:
        cell = snap(self._field, self._free, place_xy, START_SNAP_M)
        return None if cell is None else int(np.ravel_multi_index(tuple(cell), self._free.shape))

    def cost_m(self, place_xy: Array) -> float:
        """Weighted metres left from a place (2,) odom; inf without a way."""
        at = self._index(place_xy)
        return math.inf if at is None else float(self._cost_m[at])

    def costs_at(self, places_m: Array) -> Array:
        """Weighted metres left from the cells of places (n, 2), (n,): inf where that cell offers no way."""
        away = np.asarray(places_m, float) - self._field.origin_m
        cells = np.floor(away / self._field.cell_m).astype(int)
        inside = ((cells >= 0) & (cells < self._free.shape)).all(axis=1)
        cells = np.clip(cells, 0, np.array(self._free.shape) - 1)
        index = np.ravel_multi_index((cells[:, 0], cells[:, 1]), self._free.shape)
        out: Array = np.where(inside, self._cost_m[index], np.inf)
        return out

    def first_gap(self, path_m: Array) -> Array | None:
        """The first place (2,) where a way (k, 2) is nearer to obstacles than it should be, or None."""
        for a, b in itertools.pairwise(path_m):
            count = max(2, math.ceil(float(np.hypot(*(b - a))) / self._field.cell_m) + 1)
            places = a + (b - a) * np.linspace(0.0, 1.0, count)[:, None]
            tight = self._field.lookup(places) < self._radius_m
            if tight.any():
                place: Array = places[int(tight.argmax())]
                return place
        return None

    def path(self, start_xy: Array, heading_rad: float | None = None, turn_m: float = 0.0) -> Array | None:
        """Corners of the cheapest way, (k, 2) odom with the start first; None without a way.

        Args:
            start_xy: (2,) odom.
            heading_rad: Where the robot looks; its turns at the beginning count when this is given.
            turn_m: What turning by a radian costs, in metres driven.
        """
        way = self._way(start_xy)
        if way is None:
            return None
        if heading_rad is not None:
            way = self._begun_well(way, heading_rad, turn_m)
        cells = np.stack(np.unravel_index(way, self._free.shape), axis=1)
        cells = straightened(cells, self._free, self._price)
        path: Array = self._field.origin_m + (cells + 0.5) * self._field.cell_m
        return np.vstack([np.asarray(start_xy, dtype=float), path[1:-1], self._place(way[-1])])

    def _begun_well(self, way: list[int], heading_rad: float, turn_m: float) -> list[int]:
        """The way, or one that begins in another direction and is cheaper with the turns that each takes.

        A robot that has begun on one of two ways keeps to it while the other is not shorter by what turning
        round costs: else it would turn to and fro as each shows itself longer than it was believed to be.
        """
        reach = round(LEG_M / self._field.cell_m)
        if len(way) <= reach:
            return way
        shape = self._free.shape
        start = np.array(np.unravel_index(way[0], shape))

        def with_turns(cost_m: float, first: int, onwards: list[int]) -> float:
            places = np.stack(np.unravel_index([way[0], first, onwards[-1]], shape), axis=1)
            (ax, ay), (bx, by) = np.diff(places, axis=0)
            begins = math.atan2(ay, ax)
            turns = abs(wrap_pi(begins - heading_rad))
            if bx or by:
                turns += abs(wrap_pi(math.atan2(by, bx) - begins))
            return cost_m + turn_m * turns

        best, taken = with_turns(float(self._cost_m[way[0]]), way[reach], way[reach : 2 * reach + 1]), way
        for bearing in np.linspace(0.0, 2.0 * math.pi, BEARINGS, endpoint=False):
            cell = np.rint(start + reach * np.array([math.cos(bearing), math.sin(bearing)])).astype(int)
            if not ((cell >= 0) & (cell < shape)).all() or not self._free[cell[0], cell[1]]:
                continue
            leg_m = self._field.cell_m * cut_cost(np.stack([start, cell]), 0, 1, self._free, self._price)
            first = int(np.ravel_multi_index((cell[0], cell[1]), shape))
            cost_m = leg_m + float(self._cost_m[first])
            if cost_m >= best:
                continue
            rest = self._onwards(first)
            total = with_turns(cost_m, first, rest[: reach + 1])
            if total < best - TAKEN_M:
                best, taken = total, [way[0], *rest]
        return taken

    def _onwards(self, cell: int) -> list[int]:
        """The cells of the way from a cell, itself first."""
        way = [cell]
        while self._before[way[-1]] >= 0:
            way.append(int(self._before[way[-1]]))
        return way


def cell_cost(distance_m: Array, known: Bits, radius_m: float, unknown_cost: float) -> Array:
    """Price (nx, ny) of a metre in each cell: 1 far from obstacles, more near them and in unseen cells.

    Args:
        distance_m: (nx, ny) to obstacles.
        known: (nx, ny) cells that were seen.
        radius_m: Of the outline.
        unknown_cost: Factor on the others.
    """
    price = 1.0 + NEAR_COST * np.exp(-np.maximum(distance_m - radius_m - KEEP_M, 0.0) / NEAR_M)
    out: Array = price * np.where(known, 1.0, unknown_cost)
    return out


def snap(field: Field2, free: Bits, place: Array, reach_m: float) -> NDArray[np.int64] | None:
    """The cell (2,) of `free` (nx, ny) nearest to a place (2,) odom, or None beyond `reach_m`."""
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


def _surely_known(field: Field2, radius_m: float) -> Bits:
    """Cells whose surroundings within the radius are known, but for gaps between rays."""
    unknown = cv2.morphologyEx((~field.known).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    sure: Bits = field.known & ~_within(unknown > 0, radius_m / field.cell_m)
    return sure


def _within(cells: Bits, radius: float) -> Bits:
    """Cells whose middle is within a radius [cells] of one of some cells."""
    reach = 2 * round(radius) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))
    near: Bits = cv2.dilate(cells.astype(np.uint8), disc) > 0
    return near


def _shut(free: Bits, at: Array, radius: float) -> None:
    """Take a disc of cells out of the free ones."""
    low = np.clip(np.floor(at - radius).astype(int), 0, free.shape)
    high = np.clip(np.ceil(at + radius).astype(int) + 1, 0, free.shape)
    i, j = np.ogrid[low[0] : high[0], low[1] : high[1]]
    free[low[0] : high[0], low[1] : high[1]] &= (i - at[0]) ** 2 + (j - at[1]) ** 2 > radius**2


def straightened(cells: NDArray[np.int64], free: Bits, cost: Array) -> NDArray[np.int64]:
    """Corners (k, 2) of a way (n, 2) of cells: straight cuts that stay free and cost no more.

    `free` and `cost` are (nx, ny).
    """
    spans = np.hypot(*np.diff(cells, axis=0).T)
    price = cost[tuple(cells.T)]
    spent = np.concatenate([[0.0], np.cumsum(spans * 0.5 * (price[1:] + price[:-1]))])

    def passes(i: int, j: int) -> bool:
        return bool(cut_cost(cells, i, j, free, cost) <= GAIN * (spent[j] - spent[i]))

    return cells[farthest_cuts(len(cells), passes)]


def farthest_cuts(count: int, passes: Callable[[int, int], bool]) -> list[int]:
    """Places to keep of a way of `count`, its ends included, when it is cut short from each as far as can be.

    Args:
        count: Number of places, at least 1.
        passes: Whether the way may go straight from one place to a later one; to the next it always may.
    """
    kept = [0]
    while kept[-1] < count - 1:
        i = kept[-1]
        j, hop = i + 1, 1
        while hop > 0:  # gallop ahead, then close in
            ahead = min(j + hop, count - 1)
            if ahead > j and passes(i, ahead):
                j, hop = ahead, hop * 2
            else:
                hop //= 2
        kept.append(j)
    return kept
