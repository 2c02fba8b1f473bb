"""The map's own ways: on land with what is remembered of it, in the air, and from one to the other."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.config import RobotConfig
from labr_autonomy.modes.energy import EnergyModel
from labr_autonomy.perception.driving_kernels import CELL_M
from labr_autonomy.perception.fields import Bits, Field2
from labr_autonomy.perception.memory import Memory
from labr_autonomy.perception.rolling_map import RollingMap
from labr_autonomy.planner import routes
from labr_autonomy.planner.hops import Hops
from labr_autonomy.planner.kept_ways import KeptWays
from labr_autonomy.planner.messages import PlanRequest
from labr_autonomy.planner.places import AT_END_M, UNDER_M, column_field, flight_layer
from labr_autonomy.planner.refusals import Refusals
from labr_autonomy.planner.take_off import offers_by_air
from labr_autonomy.refine.search import GOAL_SNAP_M, CostToGo
from labr_autonomy.types import Array, Mode

UNDER_GOAL_M = 2.5  # how far from below an air goal out of the map's reach the drive may end
ROUTE_MARGIN_M = 0.06  # beyond the hard clearance, so that the refiner can follow with ease
NARROW_MARGIN_M = 0.01  # and so that it can follow at all
NEARLY_M = 0.03  # a gap that is narrower than that by so much may prove wide enough from close by
REFUSED_M = 0.4  # round a place where it had no room to take off
STANDS_MPS = 0.05
NEAREST_M = 0.2  # of the end of a way the refiner stops
TIGHT_M = 0.12  # as near as this to obstacles leads a way when there is no other


class MapWays:
    """What is searched, and what is kept of it between cycles.

    Args:
        config: The robot.
        seen: The rolling map.
        land_hard_m: Least distance of the robot's middle to obstacles when it drives.
        air_hard_m: The same when it flies.
        memory: Whether searches know what left the rolling map.
    """

    near: Field2  # the driving plan round the robot, as the last search saw it

    def __init__(
        self, config: RobotConfig, seen: RollingMap, land_hard_m: float, air_hard_m: float, *, memory: bool
    ) -> None:
        self._config, self._map = config, seen
        self._land_hard_m, self._air_hard_m = land_hard_m, air_hard_m
        self._energy = EnergyModel.of(config)
        self._land, self._air = KeptWays(), KeptWays()
        self._memory = Memory(2.0 * CELL_M) if memory else None
        self._no_take_off = Refusals(REFUSED_M)
        self.hops = Hops(config, seen, air_hard_m, self._no_take_off)

    def reset(self) -> None:
        """Another goal, or the robot was moved: forget what was planned and refused."""
        self._no_take_off.reset()
        self.hops.reset()

    def on_land(self, request: PlanRequest, closed: tuple[Array, ...] = ()) -> CostToGo:
        """To a goal on land, or to where a flight to it or to one in the air is best begun.

        Args:
            request: Of the cycle.
            closed: Places (2,) that were tried in vain.
        """
        goal = request.goal_m

        def search() -> CostToGo:
            self.near = self._map.land_field(request.body_pose, request.floor_z_m)
            if self._memory is not None:
                place_m, sure = request.body_pose.position_m, self._map.driving.surely_free()
                self._memory.remember(self.near.coarser(), place_m, self._map.walls(), sure)
            nearly_m = self._land_hard_m - NEARLY_M
            ways = self._search(request, nearly_m, closed)
            if request.goal_in_air or request.mode is Mode.AIR:
                return ways
            plan, _ = self._plan(goal)
            return self.hops.on_land(
                request, plan, ways, lambda offers: self._search(request, nearly_m, closed, offers)
            )

        tried = float(len(closed)), float(len(self._no_take_off))
        asked = float(goal[0]), float(goal[1]), float(request.mode is Mode.AIR), *tried
        return self._land.of(asked, request.start_s, search)

    def through_gaps(self, request: PlanRequest, closed: tuple[Array, ...]) -> CostToGo:
        """Ways on land that may pass gaps which are too tight, but for closed places."""
        return self._search(request, TIGHT_M, closed)

    def in_air(self, request: PlanRequest, goal_m: Array, height_m: float) -> CostToGo:
        """At a height of the body in odom, as if the robot drove there."""

        def search() -> CostToGo:
            layer = flight_layer(self._map, self._config, request.body_pose, height_m)
            return CostToGo(layer, goal_m[:2], self._air_hard_m)

        level = round((height_m - self._config.body.below_m - UNDER_M) / self._map.cell_m)
        return self._air.of((float(goal_m[0]), float(goal_m[1]), level), request.start_s, search)

    def hop_planned(self, request: PlanRequest, ways: CostToGo) -> bool:
        """Whether the way to a goal on land takes off at its end."""
        return request.mode is Mode.LAND and self.hops.planned(ways, request.body_pose.position_m)

    def lift_off_m(self, request: PlanRequest, ways: CostToGo) -> float:
        """How far it drives before it leaves the floor; inf if it does not."""
        leaves = request.goal_in_air or self.hop_planned(request, ways)
        way = ways.path(request.body_pose.position_m[:2]) if leaves else None
        return math.inf if way is None else routes.length_m(way)

    def drive_ends(self, request: PlanRequest, ways: CostToGo) -> bool:
        """Driving on costs more than it saves."""
        here = request.body_pose.position_m[:2]
        leaves = request.goal_in_air or self.hop_planned(request, ways)
        end = ways.end(here) if leaves else None
        return end is not None and float(np.hypot(*(end - here))) < AT_END_M

    def refuse_take_off(self, request: PlanRequest, ways: CostToGo, room_above: bool) -> None:
        """Look whether it stands where it is to take off and has no room: then it drives to the next best."""
        stands = request.mode is Mode.LAND and abs(request.motion.speed_mps) < STANDS_MPS
        waits = stands and not room_above and self.drive_ends(request, ways)
        end = ways.end(request.body_pose.position_m[:2]) if waits else None
        self._no_take_off.step(waits, end, request.start_s)

    def nearest(self, request: PlanRequest, ways: CostToGo) -> bool:
        """Whether it is where the way to a goal on land ends: there, or as near as there is room for it."""
        here = request.body_pose.position_m[:2]
        if request.mode is not Mode.LAND or request.goal_in_air or self.hop_planned(request, ways):
            return False
        end = ways.end(here)
        return end is not None and float(np.hypot(*(end - here))) < NEAREST_M

    def probe(self, request: PlanRequest) -> str | None:
        """Whether the wheels could get to the place that is asked about, as far as the map knows."""
        place = request.probe_m
        if place is None:
            return None
        plan, likely = self._plan(place)
        ways = CostToGo(plan, place[:2], self._land_hard_m + NARROW_MARGIN_M, likely=likely)
        if math.isfinite(ways.cost_m(request.body_pose.position_m[:2])):
            return ""
        if float(plan.lookup(place[None, :2])[0]) <= self._land_hard_m:
            return f"the place is in an obstacle, more than {GOAL_SNAP_M:g} m from floor that can be reached"
        return "the map shows no way there that is wide enough for the robot"

    def drawn(self) -> NDArray[np.float32]:
        """What hinders driving round the robot, (n, 2) odom."""
        return np.asarray(self.near.surface_points(), dtype=np.float32)

    def _search(
        self,
        request: PlanRequest,
        tight_m: float,
        closed: tuple[Array, ...],
        offers: Array | None = None,
    ) -> CostToGo:
        goal, hard_m = request.goal_m, self._land_hard_m
        plan, likely = self._plan(goal)
        if request.goal_in_air and self.near.contains(goal[None, :2])[0]:
            air = self.in_air(request, goal, float(goal[2]))
            column, radius_m = column_field(self._map, self._config, request, request.lift_to_m)
            offers = offers_by_air(plan, air, column, radius_m, goal, self._energy, self._no_take_off)
        return CostToGo(
            plan,
            goal[:2],
            hard_m + NARROW_MARGIN_M,
            reach_m=UNDER_GOAL_M if request.goal_in_air else GOAL_SNAP_M,
            roomy_m=hard_m + ROUTE_MARGIN_M,
            tight_m=tight_m,
            closed=closed,
            likely=likely,
            offers=offers,
        )

    def _plan(self, goal_m: Array) -> tuple[Field2, Bits | None]:
        """What searches on land go by, and where it is likely solid though unknown."""
        return (self.near.coarser(), None) if self._memory is None else self._memory.plan(goal_m)
