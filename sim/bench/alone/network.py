"""What is asked of a network that is flown alone, and what it is shown."""

from __future__ import annotations

import inspect
import math
from typing import Any, Protocol

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import odom_to_level
from labr_autonomy.gkpn.infer import GOAL_RANGE_M
from labr_autonomy.gkpn.local_map import local_map
from labr_autonomy.perception.rolling_map import RollingMap, warm_up
from labr_autonomy.planner.messages import PlanRequest
from labr_autonomy.types import Array, DepthFrame
from sim.bench.iplanner.planner import shown

FAR_M = 27.0  # a key point farther away than this is not meant: three times the farthest goal shown


class Network(Protocol):
    """A network that plans from the image; `labr_autonomy.gkpn.infer.PlanningOnnx` is one.

    Where its attribute `takes_map` is true it is given the local map as `seen`; where `predict` has an
    argument `floor_m` it is told the height of driving, level frame; its attribute `range_m`, where it has
    one, is the farthest goal that it knows.
    """

    @property
    def predict(self) -> Any:
        """From depth [m], intrinsics and goal: key points (5, 3) level frame [m], mu 0..1, seconds taken."""
        ...


class Asked:
    """A network with what it needs to be asked: those that take a map have one built, for their eyes only.

    Args:
        network: One of either kind.
        config: The robot.
    """

    def __init__(self, network: Network, config: RobotConfig) -> None:
        self._network = network
        self._below_m = config.body.below_m
        self._range_m = float(getattr(network, "range_m", GOAL_RANGE_M))
        self._told_floor = "floor_m" in inspect.signature(network.predict).parameters
        self._map = RollingMap(config) if getattr(network, "takes_map", False) else None
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
        more: dict[str, Any] = {}
        if self._told_floor:
            more["floor_m"] = drive_z_m - float(pose.position_m[2])
        if self._map is not None:
            more["seen"] = local_map(self._map, pose, request.floor_z_m)
        goal = self._shown(request, drive_z_m)
        points, mu, _ = self._network.predict(frame.depth_m, frame.intrinsics, goal, **more)
        sane = np.isfinite(points).all() and np.abs(points).max() < FAR_M and 0.0 <= mu <= 1.0
        return (points, mu) if sane else (np.zeros((5, 3)), 1.0)

    def _shown(self, request: PlanRequest, drive_z_m: float) -> Array:
        """The goal (3,), level frame, brought to the edge of the training data in bearing and distance.

        One on the floor is shown at the driving height of the robot's own floor.
        """
        z_m = request.goal_m[2] if request.goal_in_air else drive_z_m
        goal = shown(odom_to_level(np.array([*request.goal_m[:2], z_m]), request.frame_pose))
        share = min(1.0, self._range_m / max(math.hypot(goal[0], goal[1]), 1e-9))
        at: Array = goal * np.array([share, share, 1.0])
        return at
