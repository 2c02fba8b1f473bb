"""The benchmark's method `network`: depth image to key points, spline, fear rule and path follower.

Each image's key points become a spline, placed by the pose of that image. On land it is followed as the
baseline iPlanner's is (same follower, same rule of fear), up to the last key point before the first one in
the air; there the flight's own pilot takes off. In the air the spline is followed in space. There is no map
of obstacles, no refiner and no recovery. Goals beyond the training data are shown at its edge, and nearer
where the network fears the way there (`network`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.clock import SystemClock
from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import level_to_odom
from labr_autonomy.gkpn.infer import PlanningOnnx
from labr_autonomy.gkpn.spline import PER_SEGMENT, path_points
from labr_autonomy.modes.decision import classify, lift_off_distance_m
from labr_autonomy.planner.messages import PlanRequest, PlanResult, Timings
from labr_autonomy.types import Array, DepthFrame, KeyPoints, Mode, Source, Trajectory
from sim.bench.alone import flyer
from sim.bench.alone.network import Asked
from sim.bench.iplanner import fear, follower
from sim.bench.iplanner.planner import AFRAID

OVER_GOAL_M = 0.6  # so near in the plane, a flying robot hovers over to the goal; training has no such goals
LAND_OVER_M = 0.25  # and comes down on a goal on the floor
LOWEST_M = 0.45  # of the body above the floor in flight, unless the goal is lower or it has just lifted off
NO_IMAGE = "no image yet"


@dataclass(frozen=True, slots=True)
class Said:
    """What the network said of one image."""

    keys: KeyPoints  # odom
    path_m: Array  # (51, 3) odom, from where the image was taken through the key points

    def land_m(self) -> Array:
        """The part of the path that is driven, (k, 3) odom; a single point when the first key point is up."""
        if not self.keys.air.any():
            return self.path_m
        return self.path_m[: PER_SEGMENT * int(np.argmax(self.keys.air)) + 1]


class AlonePlanner:
    """What it remembers between cycles: the last path, and how often it was afraid.

    Args:
        config: The robot.
        network: Trained.
        drives_only: It was trained on land alone: the heights of its key points mean nothing.
    """

    def __init__(self, config: RobotConfig, network: PlanningOnnx, *, drives_only: bool = False) -> None:
        self._config = config
        self._clock = SystemClock()
        self._network = Asked(network, config)
        self._drives_only = drives_only
        self._limits = follower.FollowerLimits.of(config)
        follower.warm_up()
        flyer.warm_up()
        self._fear = fear.Fear()
        self._goal_m: Array | None = None
        self._seen = -1
        self._said: Said | None = None

    def cycle(self, request: PlanRequest, frame: DepthFrame | None) -> PlanResult:
        """Plan once; without a new frame the last path is followed on."""
        began_s = self._clock.now_s()
        if self._goal_m is None or not np.array_equal(self._goal_m, request.goal_m):
            self._goal_m = request.goal_m.copy()
            self._fear, self._said, self._seen = fear.Fear(), None, -1
        if frame is not None and frame.sequence != self._seen:
            self._seen = frame.sequence
            self._look(request, frame)
        thought_s = self._clock.now_s()
        trajectory, reason = self._drive(request) if request.mode is Mode.LAND else self._fly(request)
        done_s = self._clock.now_s()
        keys = self._nothing(request) if self._said is None else self._said.keys
        brakes = trajectory.source is Source.BRAKE
        return PlanResult(
            sequence=request.sequence,
            frame_stamp_s=frame.stamp_s if frame is not None else math.nan,
            trajectory=trajectory,
            network=keys,
            followed=None if brakes else keys,
            source=trajectory.source,
            clearance_m=math.nan,  # it keeps no map to tell it
            reason=reason,
            lift_off_m=lift_off_distance_m(request.body_pose.position_m, keys.points_m, keys.air),
            land_path_ends=False,  # it knows of no other way than its path
            take_off_clear=self._said is not None and not self._fear.stopped,
            landing_clear=_aside_m(request) < LAND_OVER_M,
            hop=request.mode is Mode.LAND and not request.goal_in_air and bool(keys.air.any()),
            timings=Timings(
                network_s=thought_s - began_s, refine_s=done_s - thought_s, total_s=done_s - began_s
            ),
        )

    # ------------------------------------------------------------------ the network
    def _look(self, request: PlanRequest, frame: DepthFrame) -> None:
        """Ask the network, and count its fear."""
        self._network.look(request, frame)
        if _over_goal(request):  # nothing that it has to find a way for
            self._fear = fear.Fear()
            return
        pose, drive_z_m = request.frame_pose, request.floor_z_m + self._config.body.below_m
        keys, mu = self._network.keys(request, frame)
        path = path_points(keys)
        self._fear = fear.step(self._fear, mu, fear.leads_forward(path))
        points = level_to_odom(keys, pose)
        self._said = Said(
            KeyPoints(points, self._air(points, drive_z_m), mu, Source.GKPN), level_to_odom(path, pose)
        )

    def _air(self, points_m: Array, drive_z_m: float) -> NDArray[np.bool_]:
        return np.zeros(len(points_m), bool) if self._drives_only else classify(points_m, drive_z_m)

    def _nothing(self, request: PlanRequest) -> KeyPoints:
        """Key points before the first image: none of them leads anywhere."""
        here = np.repeat(request.body_pose.position_m[None], 5, axis=0)
        return KeyPoints(here, np.zeros(5, bool), 1.0, Source.BRAKE)

    # ------------------------------------------------------------------ the spline
    def _drive(self, request: PlanRequest) -> tuple[Trajectory, str]:
        """The follower's way along the driven part of the path, or to a stop."""
        motion = request.motion
        here = motion.position_m
        stops = self._fear.stopped or self._said is None
        path = here[None] if stops or self._said is None else self._said.land_m()
        state = np.array([here[0], here[1], motion.yaw_rad, motion.speed_mps, motion.yaw_rate_rps])
        source = Source.BRAKE if stops else Source.GKPN
        return (
            follower.roll_out(path[:, :2], state, self._limits, request.start_s, float(here[2]), source),
            self._why_not(stops),
        )

    def _fly(self, request: PlanRequest) -> tuple[Trajectory, str]:
        """Along the path within the heights of flight, over to a goal that is near, or to a hover."""
        motion, limits = request.motion, self._config.air
        here, over = motion.position_m, _over_goal(request)
        stops = not over and (self._fear.stopped or self._said is None)
        if over:
            path = np.array([[*request.goal_m[:2], request.goal_m[2] if request.goal_in_air else here[2]]])
        elif stops or self._said is None:
            path = here[None]
        else:
            path = self._said.path_m.copy()
            lowest = min(request.floor_z_m + LOWEST_M, float(here[2]))
            if request.goal_in_air:
                lowest = min(lowest, float(request.goal_m[2]))
            path[:, 2] = np.clip(path[:, 2], lowest, request.floor_z_m + limits.height_max_m)
        source = Source.BRAKE if stops else Source.DIRECT if over else Source.GKPN
        trajectory = flyer.fly_along(path, motion, limits, request.start_s, source, stay=stops)
        return trajectory, self._why_not(stops)

    def _why_not(self, stops: bool) -> str:
        """Why it does not move, "" when it does."""
        if not stops:
            return ""
        return AFRAID if self._fear.stopped else NO_IMAGE


def _aside_m(request: PlanRequest) -> float:
    """Distance from the goal in the plane."""
    return float(np.hypot(*(request.goal_m[:2] - request.body_pose.position_m[:2])))


def _over_goal(request: PlanRequest) -> bool:
    """Whether a flying robot is over its goal, or nearly."""
    return request.mode is Mode.AIR and _aside_m(request) < OVER_GOAL_M
