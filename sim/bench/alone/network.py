"""What is asked of a network that is flown alone."""

from __future__ import annotations

from typing import Protocol, cast

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.gkpn.local_map import LocalMap, local_map
from labr_autonomy.perception.rolling_map import RollingMap, warm_up
from labr_autonomy.planner.messages import PlanRequest
from labr_autonomy.types import Array, DepthFrame, Image, Intrinsics

FAR_M = 27.0  # a key point farther away than this is not meant: three times the farthest goal shown


class Network(Protocol):
    """A network that plans from the image; `labr_autonomy.gkpn.infer.PlanningOnnx` is one."""

    def predict(
        self, depth_m: Image, intrinsics: Intrinsics, goal_level_m: Array, /
    ) -> tuple[Array, float, float]:
        """Key points (5, 3) level frame [m], collision probability 0..1, time taken [s]."""
        ...


class MapNetwork(Protocol):
    """A network that is shown the surroundings from above as well: its `takes_map` is true."""

    def predict(
        self, depth_m: Image, intrinsics: Intrinsics, goal_level_m: Array, /, *, seen: LocalMap | None = None
    ) -> tuple[Array, float, float]:
        """The same, with the local map."""
        ...


class Asked:
    """A network with what it needs to be asked: those that take a map have one built, for their eyes only.

    Args:
        network: One of either kind.
        config: The robot.
    """

    def __init__(self, network: Network, config: RobotConfig) -> None:
        self._network = network
        self._map = RollingMap(config) if getattr(network, "takes_map", False) else None
        if self._map is not None:
            warm_up()

    def look(self, request: PlanRequest, frame: DepthFrame) -> None:
        """Enter an image into the map, if there is one."""
        if self._map is not None:
            self._map.update(frame, request.frame_pose, request.floor_z_m)
            self._map.clear_robot(request.body_pose)

    def keys(self, request: PlanRequest, frame: DepthFrame, goal_level_m: Array) -> tuple[Array, float]:
        """Key points (5, 3) in the level frame of the image's pose [m], and mu; no path is feared fully."""
        if self._map is None:
            points, mu, _ = self._network.predict(frame.depth_m, frame.intrinsics, goal_level_m)
        else:
            seen = local_map(self._map, request.frame_pose, request.floor_z_m)
            aware = cast(MapNetwork, self._network)
            points, mu, _ = aware.predict(frame.depth_m, frame.intrinsics, goal_level_m, seen=seen)
        sane = np.isfinite(points).all() and np.abs(points).max() < FAR_M and 0.0 <= mu <= 1.0
        return (points, mu) if sane else (np.zeros((5, 3)), 1.0)
