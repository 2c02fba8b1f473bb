"""The benchmark's method `iplanner`: depth image to key points, spline, fear rule and path follower.

As published (leggedrobotics/iPlanner @ 4a8d823): no map, no memory but the fear counter, no recovery. The
network answers in the frame of the image it saw, so the path is placed by the pose at that image. Its frame
is the body's, as in training, so the sensor's offset adds no key point. A goal beyond the training data, in
distance (`gkpn.infer`) or bearing, is shown at its edge: the follower turns towards the path, and the goal
comes into view.
"""

from __future__ import annotations

import math

import numpy as np

from labr_autonomy.clock import SystemClock
from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import level_to_odom, odom_to_level
from labr_autonomy.gkpn.spline import path_points
from labr_autonomy.planner.messages import PlanRequest, PlanResult, Timings
from labr_autonomy.types import Array, DepthFrame, KeyPoints, Mode, Source, Trajectory
from sim.bench.iplanner import fear
from sim.bench.iplanner.follower import FollowerLimits, roll_out, warm_up
from sim.bench.iplanner.weights import IPlannerOnnx

BEARING_MAX_RAD = 1.7 * math.pi / 4.0  # of the training data's goals
AFRAID = "the network fears a collision on its path"
NO_WINGS = "iPlanner only drives"


class IPlannerPlanner:
    """What it remembers between cycles: the last path, and how often it was afraid.

    Args:
        config: The robot.
        network: The trained network; the packaged one by default.
    """

    def __init__(self, config: RobotConfig, network: IPlannerOnnx | None = None) -> None:
        self._config = config
        self._clock = SystemClock()
        self._network = network or IPlannerOnnx()
        self._limits = FollowerLimits.of(config)
        warm_up()
        self._fear = fear.Fear()
        self._goal_m: Array | None = None
        self._seen = -1
        self._said: KeyPoints | None = None
        self._path_m: Array | None = None  # (51, 3) odom

    def cycle(self, request: PlanRequest, frame: DepthFrame | None) -> PlanResult:
        """Plan once; without a new frame the last path is followed on, as its follower does."""
        began_s = self._clock.now_s()
        if self._goal_m is None or not np.array_equal(self._goal_m, request.goal_m):
            self._goal_m = request.goal_m.copy()
            self._fear, self._said, self._path_m, self._seen = fear.Fear(), None, None, -1
        if frame is not None and frame.sequence != self._seen and request.mode is Mode.LAND:
            self._seen = frame.sequence
            self._look(request, frame)
        thought_s = self._clock.now_s()
        trajectory, reason = self._follow(request)
        done_s = self._clock.now_s()
        said = self._said or self._nothing(request)
        return PlanResult(
            sequence=request.sequence,
            frame_stamp_s=frame.stamp_s if frame is not None else math.nan,
            trajectory=trajectory,
            network=said,
            followed=said if trajectory is not None and not self._fear.stopped else None,
            source=Source.BRAKE if trajectory is None else trajectory.source,
            clearance_m=math.nan,  # it keeps no map to tell it
            reason=reason,
            lift_off_m=math.inf,
            land_path_ends=False,
            take_off_clear=False,
            landing_clear=False,
            timings=Timings(
                network_s=thought_s - began_s, refine_s=done_s - thought_s, total_s=done_s - began_s
            ),
        )

    def _look(self, request: PlanRequest, frame: DepthFrame) -> None:
        """Ask the network, and count its fear."""
        pose = request.frame_pose
        drive_z_m = request.floor_z_m + self._config.body.below_m
        goal = odom_to_level(np.array([*request.goal_m[:2], drive_z_m]), pose)
        keys, mu, _ = self._network.predict(frame.depth_m, frame.intrinsics, shown(goal))
        path = path_points(keys)
        self._fear = fear.step(self._fear, mu, fear.leads_forward(path))
        self._path_m = level_to_odom(path, pose)
        self._said = KeyPoints(level_to_odom(keys, pose), np.zeros(len(keys), bool), mu, Source.GKPN)

    def _follow(self, request: PlanRequest) -> tuple[Trajectory | None, str]:
        """The follower's way along the last path, or to a stop."""
        if request.mode is not Mode.LAND:
            return None, NO_WINGS
        motion = request.motion
        here = motion.position_m
        stops = self._fear.stopped or self._path_m is None
        path = here[None] if stops or self._path_m is None else self._path_m
        state = np.array([here[0], here[1], motion.yaw_rad, motion.speed_mps, motion.yaw_rate_rps])
        source = Source.BRAKE if stops else Source.GKPN
        trajectory = roll_out(path[:, :2], state, self._limits, request.start_s, float(here[2]), source)
        if self._fear.stopped:
            return trajectory, AFRAID
        return trajectory, "no image yet" if stops else ""

    def _nothing(self, request: PlanRequest) -> KeyPoints:
        """Key points before the first image: none of them leads anywhere."""
        here = np.repeat(request.body_pose.position_m[None], 5, axis=0)
        return KeyPoints(here, np.zeros(5, bool), 1.0, Source.BRAKE)


def shown(goal_m: Array) -> Array:
    """The goal (3,), level frame, brought into the training data's range of bearing."""
    bearing = math.atan2(goal_m[1], goal_m[0])
    held = min(max(bearing, -BEARING_MAX_RAD), BEARING_MAX_RAD)
    away = math.hypot(goal_m[0], goal_m[1])
    return np.array([away * math.cos(held), away * math.sin(held), goal_m[2]])
