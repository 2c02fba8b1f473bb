"""What is asked of a network that is flown alone, and what it is shown."""

from __future__ import annotations

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import odom_to_level
from labr_autonomy.gkpn.infer import PlanningOnnx, drawn_in
from labr_autonomy.gkpn.local_map import local_map
from labr_autonomy.perception.rolling_map import RollingMap, warm_up
from labr_autonomy.planner.messages import PlanRequest
from labr_autonomy.types import Array, DepthFrame, Mode
from sim.bench.iplanner.fear import THRESHOLD
from sim.bench.iplanner.planner import shown

FAR_M = 27.0  # a key point farther away than this is not meant: three times the farthest goal shown
# A network that fears the whole way may know its beginning: it is asked for these parts of its range in turn.
NEARER = (1.0, 0.6, 0.35)


class Asked:
    """A network with what it needs to be asked: those that take a map have one built, for their eyes only.

    Args:
        network: One of either kind.
        config: The robot.
    """

    def __init__(self, network: PlanningOnnx, config: RobotConfig) -> None:
        self._network = network
        self._below_m = config.body.below_m
        self._map = RollingMap(config) if network.takes_map else None
        if self._map is not None:
            warm_up()

    def look(self, request: PlanRequest, frame: DepthFrame) -> None:
        """Enter an image into the map, if there is one."""
        if self._map is not None:
            self._map.update(frame, request.frame_pose, request.floor_z_m)
            self._map.clear_robot(request.body_pose)

    def keys(self, request: PlanRequest, frame: DepthFrame) -> tuple[Array, float]:
        """Key points (5, 3) in the level frame of the image's pose [m], and mu.

        What is no path, not finite or beyond `FAR_M`, is one that leads nowhere and is feared.
        """
        pose, drive_z_m = request.frame_pose, request.floor_z_m + self._below_m
        seen = None if self._map is None else local_map(self._map, pose, request.floor_z_m)
        floor_m = drive_z_m - float(pose.position_m[2])
        first: tuple[Array, float] | None = None
        for part in NEARER:
            goal = self._shown(request, drive_z_m, part * self._network.range_m)
            points, mu, _ = self._network.predict(frame.depth_m, frame.intrinsics, goal, seen, floor_m)
            sane = np.isfinite(points).all() and np.abs(points).max() < FAR_M and 0.0 <= mu <= 1.0
            said = (points, mu) if sane else (np.zeros((5, 3)), 1.0)
            if said[1] <= THRESHOLD:
                return said
            first = first or said
        assert first is not None
        return first

    def _shown(self, request: PlanRequest, drive_z_m: float, range_m: float) -> Array:
        """The goal (3,), level frame, brought within a bearing and a distance that the network knows.

        One on the floor is shown at the driving height of the robot's own floor; so is one in the air that is
        farther away, to a robot on its wheels.
        """
        goal = shown(odom_to_level(request.goal_m, request.frame_pose))
        at = drawn_in(goal, range_m)
        if not request.goal_in_air or (at is not goal and request.mode is Mode.LAND):
            at[2] = drive_z_m - float(request.frame_pose.position_m[2])
        return at
