"""The first stage in flight: what the network is asked, and whether what it says is a path at all."""

from __future__ import annotations

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import level_to_odom, odom_to_level
from labr_autonomy.gkpn.infer import GkpnOnnx
from labr_autonomy.gkpn.local_map import local_map
from labr_autonomy.modes.decision import classify
from labr_autonomy.perception.rolling_map import RollingMap
from labr_autonomy.planner.messages import PlanRequest
from labr_autonomy.types import Array, DepthFrame, KeyPoints, Source

RANGE_M = 8.0  # farther goals are shown at most at this distance, on the floor
FAR_M = 3.0 * RANGE_M  # a key point farther away than this is not meant
GOAL_JOIN_M = 0.6  # a path that ends this near the place it was asked for ends at it


class FirstStage:
    """The network in its frame.

    Args:
        config: The robot; names the network's weights and runtime.
    """

    def __init__(self, config: RobotConfig) -> None:
        self._below_m = config.body.below_m
        self._network = GkpnOnnx(config.network.weights, config.network.runtime)
        self._range_m = min(RANGE_M, self._network.range_m)

    def ask(self, request: PlanRequest, frame: DepthFrame | None, seen: RollingMap) -> KeyPoints:
        """Key points towards the goal.

        Args:
            request: Of the cycle.
            frame: The image; without one the answer is a straight line with mu = 1, not to be used.
            seen: The rolling map.
        """
        goal, pose = self._shown(request), request.body_pose
        level = odom_to_level(goal, pose)
        straight = level[None] * np.linspace(0.2, 1.0, 5)[:, None]
        points, mu = straight, 1.0
        if frame is not None:
            around = local_map(seen, pose, request.floor_z_m) if self._network.takes_map else None
            floor_m = request.floor_z_m + self._below_m - float(pose.position_m[2])
            points, mu, _ = self._network.predict(frame.depth_m, frame.intrinsics, level, around, floor_m)
            sane = np.isfinite(points).all() and np.abs(points).max() < FAR_M and 0.0 <= mu <= 1.0
            if not sane:  # not a path: as if there were no image
                points, mu = straight, 1.0
        points = np.array(level_to_odom(points, pose))
        if float(np.linalg.norm(points[-1, :2] - goal[:2])) < GOAL_JOIN_M:
            points[-1, :2] = goal[:2]
        drive_z_m = request.floor_z_m + self._below_m
        return KeyPoints(points, classify(points, drive_z_m), float(mu), Source.GKPN)

    def _shown(self, request: PlanRequest) -> Array:
        """The goal as the network sees it: within its range, on the floor but for a goal in the air."""
        here, drive_z_m = request.body_pose.position_m[:2], request.floor_z_m + self._below_m
        goal = np.array([*request.goal_m[:2], request.goal_m[2] if request.goal_in_air else drive_z_m])
        away = goal[:2] - here
        distance_m = float(np.hypot(*away))
        if distance_m > self._range_m:
            goal[:2] = here + away * self._range_m / distance_m
            goal[2] = drive_z_m
        return goal
