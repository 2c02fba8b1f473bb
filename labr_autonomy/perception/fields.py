"""Distance fields on a grid, 2D for driving and 3D for flying. Frame: odom; units: metres.

The distance is signed and counted from the nearest face of an occupied cell: `edt * cell - cell / 2`
outside, its negative inside, so that the interpolated field crosses zero on the face itself. Cell
(i, j, ...) has its centre at `origin + (index + 0.5) * cell`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from labr_autonomy.types import Array

Bits = NDArray[np.bool_]
Distances = NDArray[np.float32]


def _interpolate(values: Distances, origin_m: Array, cell_m: float, points_m: Array) -> Array:
    """Multilinear interpolation between cell centres, clamped to the border; points (k, d) -> (k,)."""
    shape = np.array(values.shape)
    u = np.clip((np.asarray(points_m, float) - origin_m) / cell_m - 0.5, 0.0, shape - 1.0)
    low = np.minimum(u.astype(np.intp), np.maximum(shape - 2, 0))
    high = np.minimum(low + 1, shape - 1)
    f = u - low
    out = np.zeros(len(u))
    for corner in product((0, 1), repeat=values.ndim):
        index = tuple(high[:, axis] if bit else low[:, axis] for axis, bit in enumerate(corner))
        weight = np.ones(len(u))
        for axis, bit in enumerate(corner):
            weight = weight * (f[:, axis] if bit else 1.0 - f[:, axis])
        out += weight * values[index]
    return out


def _surface(occupied: Bits) -> Bits:
    """Occupied cells with a face towards a cell that is not."""
    buried = occupied.copy()
    for axis in range(occupied.ndim):
        for step in (-1, 1):
            neighbour = np.roll(occupied, step, axis)
            edge = [slice(None)] * occupied.ndim
            edge[axis] = slice(0, 1) if step == 1 else slice(-1, None)
            neighbour[tuple(edge)] = True  # beyond the border counts as solid
            buried &= neighbour
    return occupied & ~buried


def _cells_away(filled: NDArray[np.uint8]) -> Distances:
    """Distance in cells from every filled cell's centre to that of the nearest empty one, correctly rounded.

    OpenCV's last bit depends on where in memory the rows lie; the squares are whole numbers, so that rounding
    them gives the same answer in every run.
    """
    away = cv2.distanceTransform(filled, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    out: Distances = np.sqrt(np.rint(away * away))
    return out


def _far_m(shape: tuple[int, ...], cell_m: float) -> float:
    """Distance reported where the grid holds no obstacle at all: its diagonal."""
    return float(np.linalg.norm(shape)) * cell_m


@dataclass(frozen=True, slots=True)
class _Field:
    """What the two dimensions share."""

    distance_m: Distances  # (nx, ny[, nz]) signed, metres
    known: Bits  # (nx, ny[, nz]) True where the map has seen the cell
    origin_m: Array  # (2|3,) odom, lower corner of cell (0, 0[, 0])
    cell_m: float

    @property
    def upper_m(self) -> Array:
        """Upper corner, (2|3,) odom."""
        out: Array = self.origin_m + np.array(self.distance_m.shape) * self.cell_m
        return out

    def contains(self, points_m: Array) -> Bits:
        """Whether points (k, d) lie inside the grid, (k,)."""
        p = np.asarray(points_m, float)
        out: Bits = np.all((p >= self.origin_m) & (p < self.upper_m), axis=1)
        return out

    def lookup(self, points_m: Array) -> Array:
        """Signed distance at points (k, d) [m], interpolated; outside the grid that of its border."""
        return _interpolate(self.distance_m, self.origin_m, self.cell_m, points_m)

    def gradient(self, points_m: Array) -> Array:
        """Direction of growing distance at points (k, d), (k, d) [m/m], central difference over one cell."""
        p = np.asarray(points_m, float)
        k, d = p.shape
        half = 0.5 * self.cell_m * np.eye(d)
        probes = np.concatenate([p[:, None, :] + half, p[:, None, :] - half], axis=1)
        values = self.lookup(probes.reshape(-1, d)).reshape(k, 2, d)
        out: Array = (values[:, 0] - values[:, 1]) / self.cell_m
        return out

    def is_known(self, points_m: Array) -> Bits:
        """Whether the cells of points (k, d) have been seen, (k,); False outside the grid."""
        inside = self.contains(points_m)
        index = np.floor((np.asarray(points_m, float) - self.origin_m) / self.cell_m).astype(np.intp)
        index = np.clip(index, 0, np.array(self.known.shape) - 1)
        out: Bits = inside & self.known[tuple(index.T)]
        return out

    def surface_points(self) -> Array:
        """Centres of the occupied cells that have a face towards a free or unknown one, (m, d) odom."""
        index = np.argwhere(_surface(self.distance_m < 0.0))
        out: Array = self.origin_m + (index + 0.5) * self.cell_m
        return out


@dataclass(frozen=True, slots=True)
class Field2(_Field):
    """Distance to what hinders the driving body, over the floor plan."""

    @classmethod
    def from_occupied(cls, occupied: Bits, known: Bits, origin_m: Array, cell_m: float) -> Field2:
        """Exact Euclidean distances of an occupancy grid (nx, ny)."""
        far = _far_m(occupied.shape, cell_m)
        if not occupied.any():
            return cls(np.full(occupied.shape, far, np.float32), known, np.asarray(origin_m, float), cell_m)
        solid = np.ascontiguousarray(occupied, np.uint8)
        outside = _cells_away(1 - solid) * cell_m
        signed = outside - 0.5 * cell_m
        if occupied.all():
            signed = np.full(occupied.shape, -far, np.float32)
        else:
            inside = _cells_away(solid) * cell_m
            signed = np.where(occupied, 0.5 * cell_m - inside, signed)
        return cls(signed.astype(np.float32, copy=False), known, np.asarray(origin_m, float), cell_m)


@dataclass(frozen=True, slots=True)
class Field3(_Field):
    """Distance to anything solid, in a box of space."""

    @classmethod
    def from_occupied(cls, occupied: Bits, known: Bits, origin_m: Array, cell_m: float) -> Field3:
        """Exact Euclidean distances of an occupancy grid (nx, ny, nz)."""
        far = _far_m(occupied.shape, cell_m)
        if not occupied.any():
            return cls(np.full(occupied.shape, far, np.float32), known, np.asarray(origin_m, float), cell_m)
        if occupied.all():
            return cls(np.full(occupied.shape, -far, np.float32), known, np.asarray(origin_m, float), cell_m)
        from labr_autonomy.perception.edt import distance_to  # numba: only where it is used

        outside, inside = distance_to(occupied, True), distance_to(occupied, False)
        signed = (np.where(occupied, 0.5 - inside, outside - 0.5)) * np.float32(cell_m)
        return cls(signed.astype(np.float32, copy=False), known, np.asarray(origin_m, float), cell_m)
