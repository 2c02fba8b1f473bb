"""The oracle's route: least energy over what the robot can drive and fly, with the whole world known.

Two layers, land and air, joined where there is room to take off (Dijkstra's search, drawn towards the goal;
`shared/reference/refiner.md` has the closed form that it must agree with). Costs are those of
`modes.energy.EnergyModel`; turning costs nothing. Frame: odom; metres, joules, seconds.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.modes.energy import EnergyModel
from labr_autonomy.refine.search import farthest_cuts
from labr_autonomy.types import Array, Mode
from sim.bench import route_kernels as kernels
from sim.worlds.free_kernels import RING
from sim.worlds.free_layers import LIFT_MIN_M, STEP_M
from sim.worlds.free_space import FreeSpace

NEAR_M = 0.25  # nearer to obstacles than this a metre costs more in the search
NEAR_COST = 0.6  # by this part at the outline; not part of the energy that is reported
GAIN = 1.001  # a straight cut may cost this much of what it replaces
PLACE_SNAP_M = 0.2  # start and goal on land may be this far from a place of the grid
LOW_M = -1e9  # below everything
CELL_SNAP_M = 0.35  # and those in the air from a cell


@dataclass(frozen=True, slots=True)
class Leg:
    """A part of the route in one mode; take-off and landing lie between legs and go straight up or down."""

    mode: Mode
    points_m: Array  # (k, 3) body origin, odom; k >= 2

    @property
    def length_m(self) -> float:
        """Metres along the leg."""
        return float(np.linalg.norm(np.diff(self.points_m, axis=0), axis=1).sum())


@dataclass(frozen=True, slots=True)
class Route:
    """A whole way."""

    legs: tuple[Leg, ...]
    switches: int  # take-offs and landings
    climb_m: float  # of take-offs and in the air, up only
    rise_m: float  # vertical metres of take-offs and landings
    bound_j: float
    bound_s: float

    @property
    def land_m(self) -> float:
        """Metres driven."""
        return sum(leg.length_m for leg in self.legs if leg.mode is Mode.LAND)

    @property
    def air_m(self) -> float:
        """Metres flown, without straight up and down at take-off and landing."""
        return sum(leg.length_m for leg in self.legs if leg.mode is Mode.AIR)

    @property
    def length_m(self) -> float:
        """All metres."""
        return self.land_m + self.air_m + self.rise_m


@dataclass(frozen=True, slots=True)
class Weights:
    """What the search minimises."""

    land_m: float  # a metre driven
    air_m: float  # a metre flown
    climb_m: float  # a metre upwards, on top
    switch: float  # a take-off or a landing
    rise_m: float  # a vertical metre of either
    near: float  # extra part at the outline


class Router:
    """Routes through one world.

    Args:
        free: Where the robot can be.
        energy: What a metre costs; by default the robot's configuration.
    """

    def __init__(self, free: FreeSpace, energy: EnergyModel | None = None) -> None:
        self._free = free
        self.energy = energy or EnergyModel.of(free.config)
        self._below_m = free.config.body.below_m
        land, air = free.land, free.air
        self._xy = np.ascontiguousarray(land.xy_m)
        cell = ((self._xy - air.origin_m[:2]) / air.cell_m).astype(np.int64)
        cell = np.clip(cell, 0, np.array(air.free.shape[:2]) - 1)
        self._over = (cell[:, 0] * air.free.shape[1] + cell[:, 1]).astype(np.int32)
        self._ring = np.array([math.hypot(a, b) for a, b in RING])

    def route(
        self,
        start_m: Array,
        goal_m: Array,
        *,
        start_in_air: bool = False,
        goal_in_air: bool = False,
        lift_to_m: float = LOW_M,
    ) -> Route | None:
        """The way of least energy between two body origins (3,) odom; None where there is none.

        Args:
            start_m: Where it begins.
            goal_m: Where it ends.
            start_in_air: The robot flies at the start.
            goal_in_air: The robot is to fly at the goal.
            lift_to_m: Height in odom that every take-off must have room for, where the pilot sets one.
        """
        e = self.energy
        weights = Weights(
            land_m=e.land_j(1.0),
            air_m=e.air_j(1.0),
            climb_m=e.air_j(0.0, 1.0),
            switch=0.5 * e.transition_j(),
            rise_m=0.0,
            near=NEAR_COST,
        )
        return self._best(weights, start_m, goal_m, start_in_air, goal_in_air, lift_to_m)

    def shortest_m(
        self, start_m: Array, goal_m: Array, *, start_in_air: bool = False, goal_in_air: bool = False
    ) -> float:
        """Length of the shortest way, driven or flown, straight up and down included; inf without one."""
        metres = Weights(1.0, 1.0, 0.0, 0.0, 1.0, 0.0)
        found = self._best(metres, start_m, goal_m, start_in_air, goal_in_air)
        return math.inf if found is None else found.length_m

    def node(self, place_m: Array, in_air: bool) -> int | None:
        """Node of the search for a body origin (3,): a place, or behind all places a cell."""
        if in_air:
            cell = self._free.air.nearest(place_m, CELL_SNAP_M)
            return None if cell is None else len(self._xy) + cell
        return self._free.land.nearest(place_m[:2], float(place_m[2]) - self._below_m, PLACE_SNAP_M)

    def _best(
        self,
        w: Weights,
        start_m: Array,
        goal_m: Array,
        start_in_air: bool,
        goal_in_air: bool,
        lift_to_m: float = LOW_M,
    ) -> Route | None:
        start, goal = self.node(start_m, start_in_air), self.node(goal_m, goal_in_air)
        if start is None or goal is None:
            return None
        land, air = self._free.land, self._free.air
        cost, before = kernels.search(
            self._xy,
            land.cell_m,
            self._ring,
            land.beside,
            land.floor_z_m,
            land.room_m,
            land.top_m,
            self._over,
            self._below_m,
            LIFT_MIN_M,
            lift_to_m,
            air.free,
            air.room_m,
            air.origin_m + 0.5 * air.cell_m,
            air.cell_m,
            air.place_starts,
            air.places,
            w.land_m,
            w.air_m,
            w.climb_m,
            w.switch,
            w.rise_m,
            NEAR_M,
            w.near,
            start,
            goal,
            min(w.land_m, w.air_m),
        )
        if not math.isfinite(cost[goal]):
            return None
        nodes = [goal]
        while nodes[-1] != start:
            nodes.append(int(before[nodes[-1]]))
        return self._measured(self._legs(nodes[::-1], start_m, goal_m, w))

    # ------------------------------------------------------------------ from nodes to a line
    def _legs(self, nodes: list[int], start_m: Array, goal_m: Array, w: Weights) -> tuple[Leg, ...]:
        """Straightened parts, split where the mode changes."""
        count = len(self._xy)
        in_air = np.array(nodes) >= count
        ends = [0, *(np.flatnonzero(np.diff(in_air.astype(int))) + 1), len(nodes)]
        legs = []
        for number, (a, b) in enumerate(pairwise(ends)):
            points = self._points(np.array(nodes[a:b]))
            first, last = number == 0, b == len(nodes)
            flying = bool(in_air[a])
            if not first and flying:  # the air begins and ends straight over its places
                points = np.vstack([[*self._xy[nodes[a - 1]], points[0, 2]], points])
            if not last and flying:
                points = np.vstack([points, [*self._xy[nodes[b]], points[-1, 2]]])
            if first:
                points = np.vstack([start_m, points])
            if last:
                points = np.vstack([points, goal_m])
            if len(points) == 1:
                points = np.vstack([points, points])
            legs.append(Leg(Mode.AIR if flying else Mode.LAND, self._pulled(points, flying, w.near)))
        return tuple(legs)

    def _points(self, nodes: NDArray[np.int64]) -> Array:
        """Body origins at nodes of one layer, (k, 3)."""
        land, air, count = self._free.land, self._free.air, len(self._xy)
        if nodes[0] < count:
            return np.column_stack([self._xy[nodes], land.floor_z_m[nodes] + self._below_m])
        index = np.column_stack(np.unravel_index(nodes - count, air.free.shape))
        return air.centres_m(index)

    def _pulled(self, points: Array, flying: bool, near: float) -> Array:
        """Corners only: straight cuts that stay free and cost no more than what they replace."""
        land, air = self._free.land, self._free.air
        cut: Callable[[Array, Array], float]
        if flying:

            def cut(a: Array, b: Array) -> float:
                return float(
                    kernels.air_cut(a, b, air.origin_m, air.cell_m, air.free, air.room_m, NEAR_M, near)
                )
        else:
            drop = np.array([0.0, 0.0, self._below_m])

            def cut(a: Array, b: Array) -> float:
                return float(
                    kernels.land_cut(
                        a - drop,
                        b - drop,
                        land.origin_m,
                        land.cell_m,
                        land.shape[1],
                        land.starts,
                        land.floor_z_m,
                        land.room_m,
                        STEP_M,
                        self._free.slope_max,
                        NEAR_M,
                        near,
                    )
                )

        for _ in range(2):  # forwards, then what that left backwards
            points = _pull(points, cut)[::-1]
        return points

    def _measured(self, legs: tuple[Leg, ...]) -> Route:
        e = self.energy
        rise = climb = 0.0
        for one, two in pairwise(legs):
            step = float(two.points_m[0, 2] - one.points_m[-1, 2])
            rise += abs(step)
            climb += max(step, 0.0)
        for leg in legs:
            if leg.mode is Mode.AIR:
                climb += float(np.maximum(np.diff(leg.points_m[:, 2]), 0.0).sum())
        switches = len(legs) - 1
        land_m = sum(leg.length_m for leg in legs if leg.mode is Mode.LAND)
        air_m = sum(leg.length_m for leg in legs if leg.mode is Mode.AIR)
        joules = e.land_j(land_m) + e.air_j(air_m, climb) + 0.5 * switches * e.transition_j()
        seconds = land_m / e.land_speed_mps + air_m / e.air_speed_mps + 0.5 * switches * e.transition_s
        return Route(legs, switches, climb, rise, joules, seconds)


def _pull(points: Array, cut: Callable[[Array, Array], float]) -> Array:
    """One greedy pass of straight cuts along a line (k, 3); the direct neighbour is always accepted."""
    single = [cut(a, b) for a, b in pairwise(points)]
    plain = np.linalg.norm(np.diff(points, axis=0), axis=1)
    spent = np.concatenate([[0.0], np.cumsum(np.where(np.isfinite(single), single, 2.0 * plain))])

    def passes(i: int, j: int) -> bool:
        return bool(cut(points[i], points[j]) <= GAIN * (spent[j] - spent[i]) + 1e-9)

    out: Array = points[farthest_cuts(len(points), passes)]
    return out
