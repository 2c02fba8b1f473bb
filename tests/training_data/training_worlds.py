"""Small worlds whose truth is known in closed form, as the training data takes them."""

import numpy as np

from labr_autonomy.config import RobotConfig
from sim.bench.known import Known
from sim.bench.route import Router
from sim.worlds.free_space import FreeSpace
from sim.worlds.meshes import box, flat, height_field, merged
from sim.worlds.surface import Surface
from sim.worlds.world import make_world

ROBOT = RobotConfig()
BELOW_M = ROBOT.body.below_m


def block(x0, y0, x1, y1, z0=0.0, z1=1.2):
    low, high = np.array([x0, y0, z0]), np.array([x1, y1, z1])
    return box((low + high) / 2, (high - low) / 2)


def known_of(*meshes):
    mesh = merged(meshes)
    world = make_world("small", mesh.vertices_m, mesh.faces, {})
    surface = Surface(world, ROBOT.body)
    free = FreeSpace(world, surface, ROBOT)
    land, air = free.land, free.air
    places = np.column_stack([land.xy_m, land.floor_z_m + BELOW_M])
    index = np.argwhere(air.free)
    cells, at = air.centres_m(index), tuple(index.T)
    height = cells[:, 2] - air.floor_z_m[at]
    return Known(world, surface, free, Router(free), places, cells, height, air.reach[at])


def box_world():
    """A floor of 12 x 8 m at z = 0 with a closed block of 2 x 1 x 1.2 m in it."""
    return known_of(flat((-6, -4), (6, 4), 0.0), block(-1.0, -0.5, 1.0, 0.5))


def drop_world():
    """A deck that ends at x = 2 above a floor 1 m lower."""
    return known_of(flat((-6, -3), (2, 3), 0.0), flat((2, -3), (6, 3), -1.0))


def ramp_world():
    """A floor, then a ramp of 10 % from x = 0 on, with a block on it from x = 3 to 4."""
    x = np.linspace(0.0, 6.0, 4)
    ramp = height_field(x, np.array([-3.0, 3.0]), np.repeat(0.1 * x[:, None], 2, axis=1))
    return known_of(flat((-6, -3), (0, 3), 0.0), ramp, block(3.0, -0.5, 4.0, 0.5, 0.2, 1.0))


def place_near(known, x, y):
    number = int(np.linalg.norm(known.places_m[:, :2] - [x, y], axis=1).argmin())
    return known.places_m[number]


def cell_middles(corner_m, n=160, cell_m=0.1):
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    return np.asarray(corner_m) + (np.stack([i, j], axis=-1) + 0.5) * cell_m
