"""`python -m sim.warm_up`: compile the simulator's kernels once, after installing."""

from __future__ import annotations

import sys

import numpy as np

from sim.worlds.surface import Surface
from sim.worlds.world import make_world


def main() -> None:
    """Compile and cache."""
    sys.stdout.write("compiling the simulator's kernels (once) ...\n")
    sys.stdout.flush()
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=np.float32)
    floor = make_world("floor", corners, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32), {})
    Surface(floor).clearance(np.array([0.0, 0.0, 0.12]), on_floor=True)


if __name__ == "__main__":
    main()
