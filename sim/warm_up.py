"""`python -m sim.warm_up`: compile the simulator's kernels once, after installing."""

from __future__ import annotations

import sys

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.planner.messages import Motion, PlanRequest
from labr_autonomy.types import DepthFrame, Mode, Pose
from sim.bench.iplanner import follower
from sim.bench.mapping.planner import MappingPlanner
from sim.bench.route import Router
from sim.camera.noise import flawed_depth
from sim.worlds.free_space import FreeSpace
from sim.worlds.surface import Surface
from sim.worlds.world import make_world


def main() -> None:
    """Compile and cache."""
    sys.stdout.write("compiling the simulator's kernels (once) ...\n")
    sys.stdout.flush()
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=np.float32)
    floor = make_world("floor", corners, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32), {})
    surface = Surface(floor)
    surface.clearance(np.array([0.0, 0.0, 0.12]), on_floor=True)
    camera = RobotConfig().camera.intrinsics
    flawed_depth(np.ones((camera.height, camera.width), np.float32), camera, 0)
    free = FreeSpace(floor, surface, RobotConfig())
    free.land_field(np.array([0.0, 0.0, 0.12]))
    Router(free).route(np.array([-0.5, 0.0, 0.12]), np.array([0.3, 0.0, 1.2]), goal_in_air=True)
    follower.warm_up()
    _plan_by_mapping(RobotConfig())


def _plan_by_mapping(config: RobotConfig) -> None:
    """One cycle of the mapping method on land and in the air, which calls all of its kernels."""
    camera = config.camera.intrinsics
    depth = np.full((camera.height, camera.width), 4.0, np.float32)
    for mode, z_m in ((Mode.LAND, config.body.below_m), (Mode.AIR, 1.2)):
        here, zero = np.array([0.0, 0.0, z_m]), np.zeros(3)
        pose = Pose(here, np.array([1.0, 0.0, 0.0, 0.0]))
        request = PlanRequest(
            sequence=1,
            frame_sequence=1,
            frame_pose=pose,
            body_pose=pose,
            start_s=1.0,
            motion=Motion(here, zero, zero, 0.0, 0.0, 0.0),
            mode=mode,
            goal_m=np.array([3.0, 0.5, 1.2]),
            goal_in_air=mode is Mode.AIR,
            floor_z_m=0.0,
            lift_to_m=1.2,
        )
        MappingPlanner(config).cycle(request, DepthFrame(1, 0.9, depth, camera))


if __name__ == "__main__":
    main()
