"""`python -m sim.warm_up`: compile the simulator's kernels once, after installing."""

from __future__ import annotations

import sys

import numpy as np

from labr_autonomy.config import RobotConfig
from sim.bench.iplanner import follower
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


if __name__ == "__main__":
    main()
