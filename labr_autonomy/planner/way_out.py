"""The planner's part of the recovery (`modes.recovery`): facts from the map, paths for its actions."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from labr_autonomy.frames import yaw_of
from labr_autonomy.modes import recovery
from labr_autonomy.modes.recovery import Action
from labr_autonomy.planner.kept_ways import KeptWays
from labr_autonomy.planner.messages import PlanRequest
from labr_autonomy.refine.search import CostToGo
from labr_autonomy.types import Array

AT_GOAL_M = 0.6  # nearer than this to the goal there is nothing to recover from
TRAIL_M, TRAIL_PLACES, BACK_PLACES = 0.2, 100, 6  # of the way that it came

Search = Callable[[tuple[Array, ...]], CostToGo]


class WayOut:
    """The recovery's memory, and the way that the robot came."""

    def __init__(self) -> None:
        self.state = recovery.State()
        self._trail: list[Array] = []  # (2,) places that it drove through, the last one last
        self._ways = KeptWays()

    def reset(self) -> None:
        """Forget the attempts: there is another goal, or it is at its goal."""
        self.state = recovery.State()

    def resume(self) -> None:
        """It was carried elsewhere, by itself or by somebody: go on, with what was tried in mind."""
        self.state = recovery.resumed(self.state)

    @property
    def hops(self) -> bool:
        """Whether it is to take off and fly over what is in the way."""
        return self.state.action is Action.HOP

    @property
    def given_up(self) -> bool:
        """Whether everything was tried."""
        return self.state.action is Action.GIVE_UP

    def step(
        self, request: PlanRequest, ways: CostToGo, through: Search, may_hop: bool
    ) -> Array | float | None:
        """One cycle of a robot on its wheels.

        Args:
            request: Of the cycle.
            ways: Ordinary ways on the map.
            through: Makes ways through gaps that are too tight, but for closed places.
            may_hop: Whether a take-off has room here, and policy and battery allow one.

        Returns:
            Places (k, 2) to drive along, a heading to turn to [rad], or None to go on as usual.
        """
        here = request.body_pose.position_m[:2]
        self._follow(here)
        way, path, gap_m = math.isfinite(ways.cost_m(here)), None, None
        if float(np.hypot(*(request.goal_m[:2] - here))) < AT_GOAL_M and (way or not request.goal_in_air):
            self.reset()
            return None
        if not way or self.state.action is not Action.FOLLOW:
            tight = self._ways.of(self._asked(request), request.start_s, lambda: through(self.closed))
            path = tight.path(here)
            gap_m = None if path is None else tight.first_gap(path)
        facts = recovery.Facts(
            place_m=here.copy(),
            yaw_rad=yaw_of(request.body_pose.quaternion),
            way=way,
            tight_way=path is not None,
            gap_m=gap_m,
            ahead_m=self._ahead(request, ways),
            trail=len(self._trail) > 2,
            may_hop=may_hop,
        )
        self.state = recovery.step(self.state, facts, request.start_s)
        match self.state.action:
            case Action.LOOK:
                return self.state.heading_rad
            case Action.SQUEEZE:
                return here[None] if path is None else path[1:]
            case Action.BACK:
                return np.array(self._trail[-2 : -2 - BACK_PLACES : -1] or [here])
            case Action.HOP | Action.GIVE_UP:
                return here[None]
        return None

    def _follow(self, here: Array) -> None:
        """Note the way that it comes; where it backs off along that, take back what it has passed."""
        trail = self._trail
        if self.state.action is Action.BACK:
            while len(trail) > 1 and np.hypot(*(here - trail[-2])) < np.hypot(*(here - trail[-1])):
                trail.pop()
        elif not trail or float(np.hypot(*(here - trail[-1]))) > TRAIL_M:
            self._trail = [*trail[1 - TRAIL_PLACES :], here.copy()]

    def _ahead(self, request: PlanRequest, ways: CostToGo) -> Array | None:
        """The first gap on the ordinary way that may prove too narrow; looked for by a robot that stands."""
        stands = request.start_s - self.state.anchor_s > recovery.NO_WAY_S
        way = ways.path(request.body_pose.position_m[:2]) if stands else None
        return None if way is None else ways.first_gap(way)

    @property
    def closed(self) -> tuple[Array, ...]:
        """Places (2,) of gaps that were tried in vain."""
        return tuple(one.place_m for one in self.state.closed)

    def _asked(self, request: PlanRequest) -> tuple[float, ...]:
        return float(request.goal_m[0]), float(request.goal_m[1]), float(len(self.state.closed))
