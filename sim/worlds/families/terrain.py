"""Hilly ground: a smooth height field whose steepest slope is given, as a closed block."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from labr_autonomy.types import Array
from sim.worlds.families.layout import Rng
from sim.worlds.meshes import Mesh, height_field

CELL_M = 0.6
BLOCK_M = 1.0  # ground below the lowest point of the surface
_WAVES = 7
_WAVE_M = (9.0, 26.0)  # lengths of the waves that make up the ground


@dataclass(frozen=True, slots=True)
class Ground:
    """Heights over a regular grid, in two triangles a cell as `meshes.height_field` cuts them."""

    x_m: Array  # (nx,) evenly spaced
    y_m: Array  # (ny,) evenly spaced
    z_m: Array  # (nx, ny) odom

    def height_m(self, xy_m: Array) -> Array:
        """Height of the triangles under points (n, 2), (n,); beyond the edge that of the edge."""
        steps = (self.x_m[1] - self.x_m[0], self.y_m[1] - self.y_m[0])
        at = (np.asarray(xy_m) - [self.x_m[0], self.y_m[0]]) / steps
        at = np.clip(at, 0.0, np.array(self.z_m.shape) - 1.0)
        i, j = np.minimum(at.astype(np.int64), np.array(self.z_m.shape) - 2).T
        u, v = (at - np.stack([i, j], axis=1)).T
        a, b, c, d = self.z_m[i, j], self.z_m[i + 1, j], self.z_m[i + 1, j + 1], self.z_m[i, j + 1]
        height: Array = np.where(u >= v, a + u * (b - a) + v * (c - b), a + v * (d - a) + u * (c - d))
        return height

    def slopes(self) -> Array:
        """Rise over run of every triangle, (2 (nx - 1)(ny - 1),)."""
        along = np.diff(self.z_m, axis=0) / (self.x_m[1] - self.x_m[0])
        across = np.diff(self.z_m, axis=1) / (self.y_m[1] - self.y_m[0])
        two = [np.hypot(along[:, :-1], across[1:]), np.hypot(along[:, 1:], across[:-1])]
        return np.concatenate([s.reshape(-1) for s in two])

    def block(self) -> Mesh:
        """The surface with sides and a level bottom."""
        top = height_field(self.x_m, self.y_m, self.z_m)
        nx, ny = self.z_m.shape
        index = np.arange(nx * ny).reshape(nx, ny)
        rim = np.concatenate([index[:-1, 0], index[-1, :-1], index[:0:-1, -1], index[0, :0:-1]])
        low = top.vertices_m[rim].copy()
        low[:, 2] = self.z_m.min() - BLOCK_M
        k, n = len(rim), nx * ny
        i = np.arange(k)
        j = (i + 1) % k
        faces = [
            top.faces,
            np.stack([n + i, n + j, rim[j]], axis=1),
            np.stack([n + i, rim[j], rim], axis=1),
            np.stack([np.full(k, n + k), n + j, n + i], axis=1),
        ]
        vertices = np.concatenate([top.vertices_m, low, low.mean(axis=0, keepdims=True)])
        return Mesh(vertices, np.concatenate(faces).astype(np.int32))


def hilly(rng: Rng, half_m: tuple[float, float], steepest: float) -> Ground:
    """Smooth hills, at height 0 in the origin.

    Args:
        rng: Random numbers.
        half_m: Half the extents in x and y [m].
        steepest: Rise over run of the steepest triangle.
    """
    x, y = (np.linspace(-h, h, math.ceil(2.0 * h / CELL_M) + 1) for h in half_m)
    length = rng.uniform(*_WAVE_M, _WAVES)
    heading, phase = rng.uniform(0.0, 2.0 * math.pi, (2, _WAVES))
    z = np.zeros((len(x), len(y)))
    for wave, turn, shift in zip(length, heading, phase, strict=True):
        along = math.cos(turn) * x[:, None] + math.sin(turn) * y[None, :]
        z += wave * np.sin(2.0 * math.pi / wave * along + shift)  # every wave about equally steep
    z *= steepest / float(Ground(x, y, z).slopes().max())
    return Ground(x, y, z - float(Ground(x, y, z).height_m(np.zeros((1, 2)))[0]))
