"""Scenes of upright boxes and cylinders: exact signed distance, footprints and triangles. Frame: odom."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.types import Array
from sim.worlds.world import World, make_world

BOX, CYLINDER = 0.0, 1.0
COLUMNS = 8  # kind, centre x y z, half extents x y z (a cylinder's radius twice), yaw [m, rad]
SIDES = 32  # of the prism drawn for a cylinder; its flats lie 0.5 % of the radius inside the exact surface

# Corners of the unit cube and its twelve triangles, wound outwards.
_CUBE = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=np.float64)
_CUBE_FACES = np.array(
    [
        (0, 2, 1),
        (1, 2, 3),
        (4, 5, 6),
        (5, 7, 6),
        (0, 1, 4),
        (1, 5, 4),
        (2, 6, 3),
        (3, 6, 7),
        (0, 4, 2),
        (2, 4, 6),
        (1, 3, 5),
        (3, 7, 5),
    ],
    dtype=np.int32,
)


def box(centre_m: Sequence[float], half_m: Sequence[float], yaw_rad: float = 0.0) -> Array:
    """One oriented box as a row (8,)."""
    return np.array([BOX, *centre_m, *half_m, yaw_rad], dtype=np.float64)


def cylinder(x_m: float, y_m: float, radius_m: float, bottom_m: float, top_m: float) -> Array:
    """One vertical cylinder as a row (8,)."""
    half = 0.5 * (top_m - bottom_m)
    return np.array([CYLINDER, x_m, y_m, bottom_m + half, radius_m, radius_m, half, 0.0])


@dataclass(frozen=True, slots=True)
class Scene:
    """A union of solids above a flat floor at z = 0 (the floor is no solid of the scene)."""

    rows: Array  # (n, 8) see COLUMNS

    def distance(self, points_m: Array) -> Array:
        """Signed distance of points (..., 3) to the union [m]; exact outside, negative inside.

        Inside overlapping solids it is a bound: the depth in the solid that holds the point deepest
        from outside, min over solids of their own exact signed distances.
        """
        return self._reduce(points_m, flat=False)

    def footprint_distance(self, points_xy_m: Array, below_m: float = math.inf) -> Array:
        """Signed distance of (..., 2) points to the outlines from above [m].

        Solids that begin at `below_m` or higher are left out.
        """
        rows = self.rows[self.rows[:, 3] - self.rows[:, 6] < below_m]
        return Scene(rows)._reduce(points_xy_m, flat=True)

    def _reduce(self, points_m: Array, *, flat: bool) -> Array:
        """Minimum over solids, one solid at a time: n stays small and memory flat."""
        best = np.full(points_m.shape[:-1], np.inf)
        for row in self.rows:
            np.minimum(best, _solid_distance(points_m, row, flat=flat), out=best)
        return best

    def world(self, name: str, spec: dict[str, Any], floor_half_m: tuple[float, float]) -> World:
        """Triangles of the solids and of a floor of the given half extents (tiles of at most 2 m)."""
        parts = [_floor(floor_half_m)] + [triangles(row) for row in self.rows]
        offsets = np.cumsum([0] + [len(v) for v, _ in parts[:-1]])
        vertices = np.concatenate([v for v, _ in parts])
        faces = np.concatenate([f + o for (_, f), o in zip(parts, offsets, strict=True)])
        return make_world(name, vertices, faces, spec)


def _solid_distance(points_m: Array, row: Array, *, flat: bool) -> Array:
    """Exact signed distance of (..., 2 or 3) points to one solid, or to its outline in x, y."""
    kind, cx, cy, cz, hx, hy, hz, yaw = row
    dx, dy = points_m[..., 0] - cx, points_m[..., 1] - cy
    if kind == CYLINDER:
        sides = [np.hypot(dx, dy) - hx]
    else:
        c, s = math.cos(yaw), math.sin(yaw)
        sides = [np.abs(c * dx + s * dy) - hx, np.abs(c * dy - s * dx) - hy]
    if not flat:
        sides.append(np.abs(points_m[..., 2] - cz) - hz)
    q = np.stack(sides, axis=-1)
    outside: Array = np.linalg.norm(np.maximum(q, 0.0), axis=-1)
    inside: Array = np.minimum(q.max(axis=-1), 0.0)
    return outside + inside


def triangles(row: Array) -> tuple[Array, NDArray[np.int32]]:
    """Corners (n, 3) and faces (m, 3) of one solid."""
    kind, *_, yaw = row
    centre, half = row[1:4], row[4:7]
    if kind == BOX:
        c, s = math.cos(yaw), math.sin(yaw)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return (_CUBE * half) @ turn.T + centre, _CUBE_FACES
    angle = np.arange(SIDES) * (2.0 * math.pi / SIDES)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    low = np.column_stack([ring, np.full(SIDES, -1.0)])
    high = np.column_stack([ring, np.full(SIDES, 1.0)])
    vertices = np.concatenate([low, high, [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]]) * half + centre
    i = np.arange(SIDES)
    j = (i + 1) % SIDES
    under, over = np.full(SIDES, 2 * SIDES), np.full(SIDES, 2 * SIDES + 1)
    faces = [[i, j, i + SIDES], [j, j + SIDES, i + SIDES], [under, j, i], [over, i + SIDES, j + SIDES]]
    return vertices, np.concatenate([np.stack(f, axis=1) for f in faces]).astype(np.int32)


def _floor(half_m: tuple[float, float]) -> tuple[Array, NDArray[np.int32]]:
    """The plane z = 0 over [-half, half], facing up, in tiles of at most 2 m."""
    nx, ny = (max(1, math.ceil(h)) for h in half_m)
    x, y = np.linspace(-half_m[0], half_m[0], nx + 1), np.linspace(-half_m[1], half_m[1], ny + 1)
    gx, gy = np.meshgrid(x, y, indexing="ij")
    vertices = np.stack([gx, gy, np.zeros_like(gx)], axis=-1).reshape(-1, 3)
    corner = (np.arange(nx)[:, None] * (ny + 1) + np.arange(ny)).reshape(-1)
    a, b, c, d = corner, corner + ny + 1, corner + ny + 2, corner + 1
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]).astype(np.int32)
    return vertices, faces
