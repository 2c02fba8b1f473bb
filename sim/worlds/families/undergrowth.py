"""What lies and grows low in a forest: bushes, fallen logs, stumps, rocks, ledges, set on the ground."""

from __future__ import annotations

import math

import numpy as np

from labr_autonomy.types import Array
from sim.worlds.families.growth import blobs, sticks
from sim.worlds.families.layout import Rng
from sim.worlds.families.terrain import Ground
from sim.worlds.meshes import Mesh, merged

LOG_M = (0.15, 0.40)  # diameters
BUSH_M = (0.3, 1.0)  # heights


def _on(ground: Ground, xy_m: Array) -> Array:
    """Points (n, 3) of the ground at (n, 2)."""
    return np.column_stack([xy_m, ground.height_m(xy_m)])


def bush(rng: Rng, ground: Ground, x_m: float, y_m: float) -> Mesh:
    """Two or three leaf masses that grow into each other."""
    tall = rng.uniform(*BUSH_M)
    count = int(rng.integers(2, 4))
    xy = np.array([x_m, y_m]) + rng.uniform(-0.3, 0.3, (count, 2)) * (0.4 + tall)
    height = tall * np.array([1.0, *rng.uniform(0.5, 0.8, count - 1)])
    wide = height[:, None] * rng.uniform(0.45, 0.65, (count, 2)) + 0.06
    centre = _on(ground, xy) + np.column_stack([np.zeros((count, 2)), 0.4 * height])
    return blobs(rng, centre, np.column_stack([wide, 0.57 * height]), rough=0.12, sides=6)


def log(rng: Rng, ground: Ground, x_m: float, y_m: float) -> Mesh:
    """A fallen trunk with a few stubs, sunk a little into the ground it follows."""
    radius = 0.5 * rng.uniform(*LOG_M)
    length = rng.uniform(1.8, 4.5)
    yaw = rng.uniform(0.0, 2.0 * math.pi)
    way = np.array([math.cos(yaw), math.sin(yaw)])
    s = np.linspace(-0.5, 0.5, 5)
    points = _on(ground, np.array([x_m, y_m]) + (s * length)[:, None] * way)
    points[:, 2] += 0.85 * radius
    radii = radius * np.linspace(1.0, 0.75, len(s))
    count = int(rng.integers(1, 4))
    at = rng.integers(1, len(s), count)
    side = rng.choice([-1.0, 1.0], count)[:, None] * np.array([-way[1], way[0]])
    out = np.column_stack([side, rng.uniform(0.3, 1.2, count)]) * rng.uniform(0.25, 0.6, count)[:, None]
    stubs = points[at][:, None, :] + np.array([0.0, 0.6, 1.0])[None, :, None] * out[:, None, :]
    thin = 0.3 * radius * np.tile([1.0, 0.8, 0.5], (count, 1))
    return merged([sticks(points[None], radii[None], 9), sticks(stubs, thin, 5)])


def stump(rng: Rng, ground: Ground, x_m: float, y_m: float) -> Mesh:
    """What is left of a felled tree."""
    radius, tall = rng.uniform(0.1, 0.25), rng.uniform(0.2, 0.6)
    points = np.tile(_on(ground, np.array([[x_m, y_m]])), (4, 1))
    points[:, 2] += [-0.3, 0.0, 0.5 * tall, tall]
    return sticks(points[None], radius * np.array([[1.6, 1.4, 1.05, 1.0]]), 9)


def rock(rng: Rng, ground: Ground, x_m: float, y_m: float) -> Mesh:
    """A boulder that sits in the ground."""
    half = rng.uniform(0.15, 0.45) * np.array([[*rng.uniform(0.8, 1.3, 2), rng.uniform(0.6, 0.9)]])
    centre = _on(ground, np.array([[x_m, y_m]]))
    centre[:, 2] += rng.uniform(0.1, 0.5) * half[0, 2]
    return blobs(rng, centre, half, rough=0.2)


def ledge(rng: Rng, ground: Ground, x_m: float, y_m: float) -> Mesh:
    """A step of flat rocks side by side, 0.1 to 0.25 m high."""
    count = int(rng.integers(3, 6))
    yaw = rng.uniform(0.0, 2.0 * math.pi)
    s = (np.arange(count) - 0.5 * (count - 1)) * 0.75
    bow = 0.12 * s * s
    c, d = math.cos(yaw), math.sin(yaw)
    xy = np.column_stack([x_m + c * s - d * bow, y_m + d * s + c * bow])
    tall = rng.uniform(0.1, 0.25)
    half = np.column_stack([rng.uniform(0.42, 0.55, (count, 2)), np.full(count, 0.25)])
    centre = _on(ground, xy)
    centre[:, 2] += tall - 0.25 * math.sin(math.radians(72.0))  # the flat top of a blob is its last ring
    return blobs(rng, centre, half, rough=0.1, sides=6)
