"""Distance fields on a grid, 2D for driving and 3D for flying. Frame: odom; units: metres.

The distance is signed and counted from the nearest face of an occupied cell: `edt * cell - cell / 2`
outside, its negative inside, so that the interpolated field crosses zero on the face itself. Cell
(i, j, ...) has its centre at `origin + (index + 0.5) * cell`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.perception.edt import distance_to
from labr_autonomy.perception.interpolate import interpolated
from labr_autonomy.perception.point_distance import SPOT, distance_to_points
from labr_autonomy.perception.skin import skin
from labr_autonomy.types import Array

Bits = NDArray[np.bool_]
Distances = NDArray[np.float32]


def _signed_m(occupied: Bits, cell_m: float) -> Distances:
    """Signed distance at every cell's centre; see the module."""
    far = np.float32(_far_m(occupied.shape, cell_m))
    if not occupied.any():
        return np.full(occupied.shape, far)
    if occupied.all():
        return np.full(occupied.shape, -far)
    outside, inside = distance_to(occupied, True), distance_to(occupied, False)
    half, cell = np.float32(0.5), np.float32(cell_m)
    out: Distances = (np.where(occupied, half - inside, outside - half)) * cell
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
        return interpolated(self.distance_m, self.origin_m, self.cell_m, points_m)

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
        out: Array = self.origin_m + (skin(self.distance_m) + 0.5) * self.cell_m
        return out


@dataclass(frozen=True, slots=True)
class Field2(_Field):
    """Distance to what hinders the driving body, over the floor plan."""

    points_m: Array | None = None  # (m, 2) where the solid cells' contents stand, if it is known

    @property
    def grain_m(self) -> float:
        """Radius of what a surface point stands for."""
        return 0.5 * self.cell_m if self.points_m is None else 0.0

    def surface_points(self) -> Array:
        """Points on what is solid, (m, 2) odom: the contents of its cells where known, else their centres."""
        return _Field.surface_points(self) if self.points_m is None else self.points_m

    @classmethod
    def from_points(
        cls, occupied: Bits, known: Bits, spots: NDArray[np.int8], origin_m: Array, cell_m: float
    ) -> Field2:
        """Distances to the points in an occupancy grid's cells, which lie beside their middles by `spots`.

        Outside solid cells the distance is that to the nearest point (`point_distance`); inside it stays
        that to the next free cell.
        """
        origin = np.asarray(origin_m, float)
        if not occupied.any() or occupied.all():
            return cls(_signed_m(occupied, cell_m), known, origin, cell_m)
        cell = np.float32(cell_m)
        inside = (np.float32(0.5) - distance_to(occupied, False)) * cell
        away = distance_to_points(occupied, spots) * cell
        border = np.argwhere(occupied & (inside > -cell))
        points = origin + (border + 0.5 + spots[tuple(border.T)] / SPOT) * cell_m
        return cls(np.where(occupied, inside, away), known, origin, cell_m, points)

    @classmethod
    def from_occupied(cls, occupied: Bits, known: Bits, origin_m: Array, cell_m: float) -> Field2:
        """Exact Euclidean distances of an occupancy grid (nx, ny)."""
        return cls(_signed_m(occupied, cell_m), known, np.asarray(origin_m, float), cell_m)

    def coarser(self) -> Field2:
        """The same plan in cells of twice the edge: distances where four cells meet, for searches."""
        nx, ny = (size // 2 for size in self.distance_m.shape)

        def four(values: NDArray[Any]) -> NDArray[Any]:
            return values[: 2 * nx, : 2 * ny].reshape(nx, 2, ny, 2)

        distance = four(self.distance_m).mean(axis=(1, 3)).astype(np.float32)
        known: Bits = np.asarray(four(self.known).any(axis=(1, 3)))
        return Field2(distance, known, self.origin_m, 2.0 * self.cell_m)


@dataclass(frozen=True, slots=True)
class Field3(_Field):
    """Distance to anything solid, in a box of space."""

    @property
    def grain_m(self) -> float:
        """Radius of what a surface point stands for."""
        return 0.5 * self.cell_m

    @classmethod
    def from_occupied(cls, occupied: Bits, known: Bits, origin_m: Array, cell_m: float) -> Field3:
        """Exact Euclidean distances of an occupancy grid (nx, ny, nz)."""
        return cls(_signed_m(occupied, cell_m), known, np.asarray(origin_m, float), cell_m)
