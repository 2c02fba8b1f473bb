"""Round things that grow or lie about, many at a time: sticks, blobs and cones. Each is closed by itself."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.types import Array
from sim.worlds.families.layout import Rng
from sim.worlds.meshes import Mesh, hull_of_rings

_LATITUDES_RAD = np.radians([-72.0, -24.0, 24.0, 72.0])  # rings of a blob


@lru_cache(maxsize=64)
def _tube_faces(rings: int, sides: int) -> NDArray[np.int32]:
    """Faces of one capped tube whose vertices are stored ring by ring."""
    return hull_of_rings([np.zeros((sides, 3))] * rings).faces


def _tubes(rings_m: Array) -> Mesh:
    """Capped tubes from rings (n, k, sides, 3), counter-clockwise seen from their ends."""
    n, k, sides, _ = rings_m.shape
    faces = _tube_faces(k, sides)[None] + (np.arange(n, dtype=np.int32) * np.int32(k * sides))[:, None, None]
    return Mesh(rings_m.reshape(-1, 3), faces.reshape(-1, 3))


@lru_cache(maxsize=16)
def _circle(sides: int) -> Array:
    angle = np.arange(sides) * (2.0 * math.pi / sides)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def sticks(points_m: Array, radii_m: Array, sides: int) -> Mesh:
    """Tapering round sticks.

    Args:
        points_m: (n, k, 3) points along each stick; gently bent.
        radii_m: (n, k) radius at each point.
        sides: Corners of the cross-section.
    """
    along = np.empty_like(points_m)
    along[:, 1:-1] = points_m[:, 2:] - points_m[:, :-2]
    along[:, 0] = points_m[:, 1] - points_m[:, 0]
    along[:, -1] = points_m[:, -1] - points_m[:, -2]
    along /= np.sqrt((along * along).sum(axis=-1, keepdims=True))
    upright = np.abs(along.mean(axis=1)[:, 2]) > 0.7
    reference = np.where(upright[:, None], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])[:, None, :]
    side = reference - along * (reference * along).sum(axis=-1, keepdims=True)
    side /= np.sqrt((side * side).sum(axis=-1, keepdims=True))
    (ax, ay, az), (bx, by, bz) = np.moveaxis(along, -1, 0), np.moveaxis(side, -1, 0)
    other = np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)
    c, s = _circle(sides).T
    spoke = c[:, None] * side[:, :, None, :] + s[:, None] * other[:, :, None, :]
    return _tubes(points_m[:, :, None, :] + radii_m[:, :, None, None] * spoke)


def blobs(rng: Rng, centres_m: Array, half_m: Array, *, rough: float, sides: int = 7) -> Mesh:
    """Lumpy ellipsoids: leaf masses, bushes, rocks.

    Args:
        rng: Random numbers.
        centres_m: (n, 3) centres.
        half_m: (n, 3) half extents before roughening.
        rough: Share by which radii vary, below 1.
        sides: Corners of each of the four rings.
    """
    n, k = len(centres_m), len(_LATITUDES_RAD)
    ring = _circle(sides)
    flat, up = np.cos(_LATITUDES_RAD)[:, None], np.sin(_LATITUDES_RAD)
    unit = np.empty((k, sides, 3))
    unit[..., :2] = flat[..., None] * ring[None]
    unit[..., 2] = up[:, None]
    factor = 1.0 + rough * rng.uniform(-1.0, 1.0, (n, k, sides, 1))
    return _tubes(centres_m[:, None, None, :] + unit * factor * half_m[:, None, None, :])


def cones(rng: Rng, feet_m: Array, tips_m: Array, radii_m: Array, *, sides: int = 8) -> Mesh:
    """Cones with ragged hems: the tiers of a conifer.

    Args:
        rng: Random numbers.
        feet_m: (n, 3) centres of the hems.
        tips_m: (n, 3) tips.
        radii_m: (n,) radii of the hems.
        sides: Corners of a hem.
    """
    n = len(feet_m)
    ring = _circle(sides)
    hem = radii_m[:, None] * rng.uniform(0.8, 1.1, (n, sides))
    rings = np.empty((n, 2, sides, 3))
    rings[:, 0, :, :2] = feet_m[:, None, :2] + hem[..., None] * ring
    rings[:, 0, :, 2] = feet_m[:, None, 2] - 0.15 * (hem - radii_m[:, None])  # long twigs hang lower
    rings[:, 1, :, :2] = tips_m[:, None, :2] + 0.06 * radii_m[:, None, None] * ring
    rings[:, 1, :, 2] = tips_m[:, None, 2]
    return _tubes(rings)
