"""Pieces of triangle mesh to put worlds together from. Odom, z up, metres, faces wound outwards."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.types import Array


class Mesh(NamedTuple):
    """Triangles."""

    vertices_m: Array  # (n, 3)
    faces: NDArray[np.int32]  # (m, 3)

    def moved(self, x_m: float, y_m: float, z_m: float = 0.0, yaw_rad: float = 0.0) -> Mesh:
        """Turned about the origin's vertical, then shifted."""
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return Mesh(self.vertices_m @ turn.T + np.array([x_m, y_m, z_m]), self.faces)


def merged(parts: Iterable[Mesh]) -> Mesh:
    """All parts as one mesh; vertices are not shared between parts."""
    kept = [part for part in parts if len(part.faces)]
    if not kept:
        return Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))
    starts = np.cumsum([0] + [len(part.vertices_m) for part in kept[:-1]])
    faces = [part.faces + np.int32(start) for part, start in zip(kept, starts, strict=True)]
    return Mesh(np.concatenate([part.vertices_m for part in kept]), np.concatenate(faces))


def hull_of_rings(rings: Sequence[Array], *, capped: bool = True) -> Mesh:
    """A tube through rings of equally many points, each (k, 3) and counter-clockwise seen from its end."""
    k = len(rings[0])
    vertices = np.concatenate(rings)
    i = np.arange(k)
    j = (i + 1) % k
    faces = []
    for number in range(len(rings) - 1):
        low, high = number * k, (number + 1) * k
        faces.append(np.stack([low + i, low + j, high + i], axis=1))
        faces.append(np.stack([low + j, high + j, high + i], axis=1))
    if capped:
        fan = np.arange(1, k - 1)
        top = (len(rings) - 1) * k
        faces.append(np.stack([np.zeros_like(fan), fan + 1, fan], axis=1))
        faces.append(np.stack([np.full_like(fan, top), top + fan, top + fan + 1], axis=1))
    return Mesh(vertices, np.concatenate(faces).astype(np.int32))


def prism(outline_m: Array, low_m: float, high_m: float) -> Mesh:
    """An upright prism over a convex outline (k, 2), counter-clockwise."""
    rings = [np.column_stack([outline_m, np.full(len(outline_m), z)]) for z in (low_m, high_m)]
    return hull_of_rings(rings)


def box(centre_m: Sequence[float], half_m: Sequence[float], yaw_rad: float = 0.0) -> Mesh:
    """An upright box."""
    x, y, z = half_m
    outline = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    return prism(outline, -z, z).moved(float(centre_m[0]), float(centre_m[1]), float(centre_m[2]), yaw_rad)


def tube(points_m: Array, radii_m: Sequence[float], sides: int = 8, *, capped: bool = True) -> Mesh:
    """A tapering round stick through points (k, 3): trunks, branches, pipes, table legs."""
    points = np.asarray(points_m, dtype=np.float64)
    angle = np.arange(sides) * (2.0 * math.pi / sides)
    along = np.gradient(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.array([1.0, 0.0, 0.0]) if abs(along[0, 0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    rings = []
    for place, ahead, radius in zip(points, along, radii_m, strict=True):
        side = side - ahead * float(side @ ahead)
        side /= np.linalg.norm(side)
        up = np.cross(ahead, side)
        rings.append(place + radius * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * up))
    return hull_of_rings(rings, capped=capped)


def height_field(x_m: Array, y_m: Array, z_m: Array) -> Mesh:
    """Ground over a grid: x (nx,), y (ny,), heights (nx, ny); faces up."""
    gx, gy = np.meshgrid(x_m, y_m, indexing="ij")
    vertices = np.stack([gx, gy, z_m], axis=-1).reshape(-1, 3)
    ny = len(y_m)
    corner = (np.arange(len(x_m) - 1)[:, None] * ny + np.arange(ny - 1)).reshape(-1)
    a, b, c, d = corner, corner + ny, corner + ny + 1, corner + 1
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return Mesh(vertices, faces.astype(np.int32))


def flat(low_m: Sequence[float], high_m: Sequence[float], z_m: float, *, down: bool = False) -> Mesh:
    """A level rectangle in tiles of at most 2 m: a floor, or a ceiling when it faces down."""
    nx, ny = (max(1, math.ceil((high - low) / 2.0)) for low, high in zip(low_m, high_m, strict=True))
    x, y = np.linspace(low_m[0], high_m[0], nx + 1), np.linspace(low_m[1], high_m[1], ny + 1)
    sheet = height_field(x, y, np.full((nx + 1, ny + 1), z_m))
    return Mesh(sheet.vertices_m, sheet.faces[:, ::-1].copy()) if down else sheet
