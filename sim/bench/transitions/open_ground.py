"""An endless slope, and a planner for where nothing stands: straight to the goal by the flight's refiner."""

from __future__ import annotations

import math

import numpy as np

from labr_autonomy.config import Body, RobotConfig
from labr_autonomy.perception.fields import Field2, Field3
from labr_autonomy.planner.messages import PlanRequest, PlanResult, Timings
from labr_autonomy.refine.planner import Refiner
from labr_autonomy.refine.values import AirState, LandState
from labr_autonomy.types import DepthFrame, KeyPoints, Mode, Source, Trajectory
from sim.worlds.surface import Surface
from sim.worlds.world import make_world

HALF_M = 20.0  # of the ground, and of what the planner takes for free


def sloping_ground(east: float, north: float, body: Body) -> Surface:
    """One plane through the origin that rises by so much per metre east and north."""
    corners = np.array([[x, y] for x in (-HALF_M, HALF_M) for y in (-HALF_M, HALF_M)])
    vertices = np.column_stack([corners, corners @ np.array([east, north])])
    return Surface(make_world("slope", vertices, np.array([[0, 2, 3], [0, 3, 1]]), {}), body)


class OpenGround:
    """Plans straight to the goal over ground on which nothing stands.

    Args:
        config: The robot.
    """

    def __init__(self, config: RobotConfig) -> None:
        self._refiner = Refiner(config)
        self._previous: Trajectory | None = None
        n, low = 100, np.full(2, -HALF_M)
        nothing = np.zeros((n, n), bool)
        self._land = Field2.from_occupied(nothing, ~nothing, low, 2.0 * HALF_M / n)
        deep = np.zeros((n, n, 16), bool)
        self._air = Field3.from_occupied(deep, ~deep, np.append(low, -4.0), 2.0 * HALF_M / n)

    def cycle(self, request: PlanRequest, frame: DepthFrame | None) -> PlanResult:
        """Plan once."""
        if request.fresh or (self._previous is not None and self._previous.mode is not request.mode):
            self._previous = None
        motion, goal = request.motion, np.array(request.goal_m, dtype=float)[None]
        in_air = request.mode is Mode.AIR
        if in_air:
            air = AirState(motion.position_m, motion.velocity_mps, motion.acceleration_mps2, motion.yaw_rad)
            refined = self._refiner.air(
                air,
                goal,
                self._air,
                request.start_s,
                self._previous,
                source=Source.DIRECT,
                floor_m=request.floor_z_m,
            )
        else:
            here = motion.position_m
            land = LandState(here[:2], motion.yaw_rad, motion.speed_mps, motion.yaw_rate_rps, float(here[2]))
            refined = self._refiner.land(
                land, goal, self._land, request.start_s, self._previous, source=Source.DIRECT
            )
        self._previous = refined.trajectory
        points = KeyPoints(goal, np.array([in_air]), 0.0, Source.DIRECT)
        return PlanResult(
            sequence=request.sequence,
            frame_stamp_s=request.start_s,
            trajectory=refined.trajectory,
            network=points,
            followed=points,
            source=Source.DIRECT,
            clearance_m=math.inf,
            reason=refined.reason,
            lift_off_m=math.inf,
            land_path_ends=False,
            take_off_clear=True,
            landing_clear=True,
            timings=Timings(),
        )
