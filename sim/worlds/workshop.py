"""The example mesh that comes with the simulator: `python -m sim.worlds.workshop FILE.glb` writes it.

A workshop of 14 x 10 m: benches, shelves, a loading ramp to a dock, a mezzanine on posts with a stair, a
crane with its hook hanging low. It shows what a mesh and its world file look like, y up as glTF is.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np

from sim.worlds.meshes import Mesh, box, flat, hull_of_rings, merged, prism, tube

HALF_M = (7.0, 5.0)  # inside of the walls
HIGH_M = 5.0  # inside of the roof
WALL_M = 0.2
DOCK_M = 0.6  # the loading dock, at the upper end of the ramp
MEZZANINE_M = 2.4
_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # odom to the axes of glTF


def workshop() -> Mesh:
    """All of it, odom, floor at z = 0."""
    parts = [*_shell(), *_dock(), *_mezzanine(), *_crane()]
    for x, y, yaw in ((-3.2, -4.45, 0.0), (-0.6, -4.45, 0.0), (-1.6, 0.9, 0.25)):
        parts += [part.moved(x, y, 0.0, yaw) for part in _bench()]
    for x, y, yaw in ((4.6, 4.6, 0.0), (2.4, 4.6, 0.0), (0.2, 2.6, math.pi / 2), (6.6, 1.9, math.pi / 2)):
        parts += [part.moved(x, y, 0.0, yaw) for part in _shelf()]
    for x, y in ((2.0, -4.3), (2.75, -4.4), (2.4, -3.7), (-6.4, -1.2)):
        parts.append(tube(np.array([[x, y, 0.0], [x, y, 0.9]]), (0.29, 0.29), 16))
    parts += [box((1.6, -1.6, 0.07), (0.6, 0.4, 0.07), 0.4), box((1.55, -1.6, 0.39), (0.4, 0.3, 0.25), 0.4)]
    return merged(parts)


def _shell() -> list[Mesh]:
    """Floor, walls with a gate in the west, roof."""
    x, y = HALF_M
    middle, half = HIGH_M / 2, WALL_M / 2
    return [
        flat((-x, -y), (x, y), 0.0),
        flat((-x, -y), (x, y), HIGH_M, down=True),
        box((0.0, y + half, middle), (x + WALL_M, half, middle)),
        box((0.0, -y - half, middle), (x + WALL_M, half, middle)),
        box((x + half, 0.0, middle), (half, y, middle)),
        box((-x - half, -3.0, middle), (half, 2.0, middle)),
        box((-x - half, 3.5, middle), (half, 1.5, middle)),
        box((-x - half, 0.5, 4.0), (half, 1.5, 1.0)),
        box((-x - half, 0.5, 1.5), (0.02, 1.5, 1.5)),  # the gate's leaf, shut
    ]


def _dock() -> list[Mesh]:
    """A dock in the south-east corner and the ramp that leads up to it, 8.5 degrees."""
    foot, head, low, high = 0.9, 4.9, -3.2, -1.4
    ramp = np.array([[foot, low, 0.0], [head, low, 0.0], [head, low, DOCK_M]])
    far = ramp + np.array([0.0, high - low, 0.0])
    return [
        box((5.95, -3.1, DOCK_M / 2), (1.05, 1.9, DOCK_M / 2)),
        hull_of_rings([ramp[::-1], far[::-1]]).moved(0.0, 0.0),
        box((6.3, -4.4, DOCK_M + 0.4), (0.5, 0.45, 0.4)),
    ]


def _mezzanine() -> list[Mesh]:
    """A deck in the north-west corner on posts, with a rail and a stair of twelve steps."""
    low, high, top = (-7.0, 1.9), (-2.6, 5.0), MEZZANINE_M
    centre = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2)
    parts = [box((*centre, top - 0.1), ((high[0] - low[0]) / 2, (high[1] - low[1]) / 2, 0.1))]
    for x, y in ((-2.75, 2.05), (-2.75, 4.85), (-4.9, 2.05)):
        parts.append(box((x, y, (top - 0.2) / 2), (0.08, 0.08, (top - 0.2) / 2)))
    rail_y, half = low[1] + 0.03, (high[0] - low[0]) / 2
    parts += [box((centre[0], rail_y, top + height), (half, 0.02, 0.02)) for height in (0.55, 1.05)]
    posts = np.linspace(low[0] + 0.1, high[0] - 0.1, 5).tolist()
    parts += [box((x, rail_y, top + 0.53), (0.02, 0.02, 0.53)) for x in posts]
    count = 12
    for number in range(count):
        z = top * (number + 1) / (count + 1)
        parts.append(box((high[0] + 0.14 + 0.26 * (count - 1 - number), 4.5, z), (0.13, 0.45, 0.02)))
    for y in (4.07, 4.93):
        slope = np.array([[high[0] + 0.26 * count, 0.05], [high[0], top - 0.1]])
        stringer = [np.column_stack([slope[:, 0], [y, y], slope[:, 1] + dz]) for dz in (-0.05, 0.1)]
        ring = np.concatenate([stringer[1], stringer[0][::-1]])
        parts.append(hull_of_rings([ring + np.array([0.0, 0.02, 0.0]), ring - np.array([0.0, 0.02, 0.0])]))
    parts += [
        box((-5.6, 4.4, top + 0.45), (0.7, 0.4, 0.45)),
        box((-3.8, 4.5, top + 0.3), (0.4, 0.4, 0.3), 0.3),
    ]
    return parts


def _crane() -> list[Mesh]:
    """A beam across the hall at 3.9 m, its trolley, and a hook that hangs down to 1.5 m."""
    x, y = 3.2, 0.4
    flange = [box((x, 0.0, z), (0.15, HALF_M[1], 0.02)) for z in (3.78, 4.08)]
    rope = tube(np.array([[x, y, 3.6], [x, y, 1.9]]), (0.025, 0.025), 8)
    angle = np.linspace(-0.5 * math.pi, math.pi, 10)
    hook = np.column_stack([x + 0.12 * np.cos(angle), np.full(10, y), 1.62 + 0.12 * np.sin(angle)])
    return [
        *flange,
        box((x, 0.0, 3.93), (0.02, HALF_M[1], 0.13)),
        box((x, y, 3.65), (0.22, 0.25, 0.1)),
        rope,
        box((x, y, 1.85), (0.1, 0.07, 0.12)),
        tube(hook[::-1], [0.03] * 10, 8),
    ]


def _bench() -> list[Mesh]:
    """A work bench 2 m long with a vice and a drawer unit."""
    legs = [box((x, y, 0.42), (0.04, 0.04, 0.42)) for x in (-0.92, 0.92) for y in (-0.32, 0.32)]
    return [
        box((0.0, 0.0, 0.87), (1.0, 0.38, 0.03)),
        *legs,
        box((0.55, 0.0, 0.55), (0.25, 0.3, 0.28)),
        box((-0.7, 0.2, 1.0), (0.12, 0.09, 0.1)),
    ]


def _shelf() -> list[Mesh]:
    """A rack 1.9 m long and 2.2 m high with crates."""
    posts = [box((x, y, 1.1), (0.03, 0.03, 1.1)) for x in (-0.92, 0.92) for y in (-0.27, 0.27)]
    boards = [box((0.0, 0.0, z), (0.95, 0.3, 0.02)) for z in (0.15, 0.8, 1.45, 2.1)]
    crates = [
        box((x, 0.0, z + 0.02 + h), (w, 0.22, h), yaw)
        for x, z, w, h, yaw in (
            (-0.6, 0.15, 0.22, 0.2, 0.1),
            (0.0, 0.15, 0.25, 0.15, 0.0),
            (0.55, 0.8, 0.3, 0.22, -0.05),
            (-0.5, 0.8, 0.18, 0.12, 0.15),
            (-0.1, 1.45, 0.4, 0.18, 0.0),
        )
    ]
    pipe = prism(np.array([[-0.8, -0.1], [0.7, -0.1], [0.7, 0.1], [-0.8, 0.1]]), 2.12, 2.3)
    return [*posts, *boards, *crates, pipe]


def write(path: Path) -> None:
    """Export the workshop, y up as glTF wants it; the suffix names the format."""
    import trimesh

    mesh = workshop()
    vertices = (mesh.vertices_m @ _Y_UP.T).astype(np.float32)
    trimesh.Trimesh(vertices, mesh.faces, process=False).export(path)


if __name__ == "__main__":
    write(Path(sys.argv[1]))
