"""Small worlds whose free space is known in closed form."""

from __future__ import annotations

import numpy as np

from labr_autonomy.config import RobotConfig
from sim.bench.route import Router
from sim.worlds.free_space import FreeSpace
from sim.worlds.meshes import Mesh, box, flat, height_field, merged
from sim.worlds.surface import Surface
from sim.worlds.world import make_world

ROBOT = RobotConfig()
WALL_M = 2.6


def wall(x0, y0, x1, y1, top=WALL_M):
    """Bounds of an upright block on the floor, (2, 3)."""
    return np.array([[x0, y0, 0.0], [x1, y1, top]])


def solid(bounds):
    low, high = bounds
    return box((low + high) / 2, (high - low) / 2)


def rim(x0, y0, x1, y1):
    """Outer walls round a rectangle."""
    t = 0.2
    return [
        wall(x0 - t, y0 - t, x0, y1 + t),
        wall(x1, y0 - t, x1 + t, y1 + t),
        wall(x0, y0 - t, x1, y0),
        wall(x0, y1, x1, y1 + t),
    ]


def two_rooms(door_m=1.0, middle_m=1.5):
    """12 x 6 m, halved by a wall with a door in it."""
    low, high = middle_m - door_m / 2, middle_m + door_m / 2
    return [*rim(-6, -3, 6, 3), wall(-0.1, -3, 0.1, low), wall(-0.1, high, 0.1, 3)]


def low_wall(top=1.0):
    """8 x 4 m, halved by a wall that can only be flown over."""
    return [*rim(-4, -2, 4, 2), wall(-0.1, -2, 0.1, 2, top)]


def detour(end_m):
    """A low wall from y = -1.5 to `end_m`, and a way round its end."""
    return [*rim(-2.5, -1.5, 2.5, end_m + 1.5), wall(-0.1, -1.5, 0.1, end_m, 1.0)]


def world_of(blocks, floor=(-6.2, -3.2, 6.2, 3.2), extra=()):
    parts = [flat(floor[:2], floor[2:], 0.0), *(solid(b) for b in blocks), *extra]
    mesh = merged(parts)
    return make_world("analytic", mesh.vertices_m, mesh.faces, {})


def rooms_of(blocks):
    """World with its floor under all blocks."""
    low = np.min([b[0] for b in blocks], axis=0)
    high = np.max([b[1] for b in blocks], axis=0)
    return world_of(blocks, (*low[:2], *high[:2]))


def free_space(world, **options):
    return FreeSpace(world, Surface(world, ROBOT.body), ROBOT, **options)


def router_of(world):
    return Router(free_space(world))


def standing_at(x, y, floor=0.0):
    return np.array([x, y, floor + ROBOT.body.below_m])


def distance_to_blocks(points, blocks):
    """Distance of points (n, d) to the nearest of axis-parallel blocks, 0 within."""
    d = points.shape[1]
    gaps = []
    for low, high in blocks:
        out = np.maximum(np.maximum(low[:d] - points, points - high[:d]), 0.0)
        gaps.append(np.linalg.norm(out, axis=1))
    return np.min(gaps, axis=0)


def ramp_world():
    """A floor, a ramp of 10 % to a deck at 1 m above the same floor."""
    x = np.linspace(0.0, 10.0, 6)
    ramp = height_field(x, np.array([-1.0, 1.0]), np.repeat(0.1 * x[:, None], 2, axis=1))
    deck = flat((10.0, -1.0), (16.0, 1.0), 1.0)
    return world_of([], (-4.0, -3.0, 17.0, 3.0), (ramp, deck))


def table_world():
    """A table of 2.4 x 1.4 m, 0.7 m high, on thin legs, across a corridor 1.4 m wide."""
    legs = [wall(x - 0.03, y - 0.03, x + 0.03, y + 0.03, 0.7) for x in (-1.1, 1.1) for y in (-0.6, 0.6)]
    top = np.array([[-1.2, -0.7, 0.7], [1.2, 0.7, 0.75]])
    return world_of([*rim(-4, -0.75, 4, 0.75), *legs, top], (-4.2, -1.0, 4.2, 1.0))


def sheet(corners):
    """Two triangles through four corners (4, 3): a wall without thickness."""
    return Mesh(np.array(corners, dtype=float), np.array([[0, 1, 2], [2, 0, 3]], np.int32))
