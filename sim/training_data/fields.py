"""The truth that the loss compares a path with: signed distances on land around a view, in the air all over.

On land `FreeSpace` follows floors up and down slopes and takes for solid what hinders the wheels or the body,
drops, and whatever cannot be driven to. In the air distances are exact near surfaces; negative is the space
that no robot gets to: the inside of cars and furniture, and what lies under the floor. Frame: odom; metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from labr_autonomy.gkpn.shards import FAR_CM, LAND_CELL_M, LAND_SIDE, NO_FLOOR
from labr_autonomy.perception.edt import distance_to
from labr_autonomy.perception.fields import Field2
from labr_autonomy.types import Array
from sim.bench.known import Known
from sim.training_data import air_kernels as kernels

FINE = 2  # cells of the land field are computed this much finer: half a cell matters at a door
EXACT_M = 0.35  # distances in the air up to this are exact
CORE_M = 0.08  # a ball of this radius fits where a robot can be; gaps too small for it lead nowhere
RIM = 3  # voxels around such balls that still count as free


@dataclass(frozen=True, slots=True)
class LandTruth:
    """Driving around one view."""

    field: Field2  # fine cells, at least as far as `distance_cm`
    distance_cm: NDArray[np.int8]  # (LAND_SIDE, LAND_SIDE)
    floors_cm: NDArray[np.int16]  # (LAND_SIDE, LAND_SIDE) above the floor under the robot
    corner_m: Array  # (2,)

    @property
    def coarse(self) -> Field2:
        """`distance_cm` as a field."""
        distance_m = self.distance_cm.astype(np.float32) * np.float32(0.01)
        return Field2(distance_m, np.ones(distance_m.shape, np.bool_), self.corner_m, LAND_CELL_M)


def land_truth(known: Known, xy_m: Array, floor_z_m: float, place_m: Array) -> LandTruth:
    """Truth on land around a view.

    Args:
        known: The world.
        xy_m: Of the view, the middle of the field (2,).
        floor_z_m: Height of the floor under the robot.
        place_m: Body origin (3,) of a standing place nearby, from which floors are followed.
    """
    fine_m = LAND_CELL_M / FINE
    middle, start = (np.floor(np.asarray(at[:2]) / LAND_CELL_M).astype(int) for at in (xy_m, place_m))
    extra = int(np.abs(middle - start).max())
    half = LAND_SIDE // 2 + extra
    begin = np.array([*((start + 0.25) * LAND_CELL_M), place_m[2]])  # well inside a fine cell
    half_m = (half - 0.1) * LAND_CELL_M  # it is rounded up to whole fine cells
    field, floors_m = known.free.land_and_floors(begin, (half_m, half_m), fine_m)
    low = (middle - start + extra) * FINE
    window = tuple(slice(int(a), int(a) + LAND_SIDE * FINE) for a in low)
    floors = _pooled(floors_m[window] - floor_z_m)  # NaN where any is missing
    floors_cm = np.full(floors.shape, NO_FLOOR, np.int16)
    there = np.isfinite(floors)
    floors_cm[there] = np.round(100.0 * floors[there]).astype(np.int16)
    return LandTruth(
        field=field,
        distance_cm=centimetres(_pooled(field.distance_m[window])),
        floors_cm=floors_cm,
        corner_m=(middle - LAND_SIDE // 2) * LAND_CELL_M,
    )


def _pooled(fine: NDArray[np.floating]) -> Array:
    """Means of FINE x FINE cells: the value at the middle of the coarse one."""
    n = fine.shape[0] // FINE
    out: Array = fine.reshape(n, FINE, n, FINE).mean(axis=(1, 3), dtype=np.float64)
    return out


def centimetres(distance_m: NDArray[np.floating]) -> NDArray[np.int8]:
    """Metres to whole centimetres, clipped to what a byte holds."""
    out: NDArray[np.int8] = np.clip(np.round(100.0 * distance_m), -FAR_CM, FAR_CM).astype(np.int8)
    return out


@dataclass(frozen=True, slots=True)
class AirTruth:
    """The air of a scene."""

    distance_cm: NDArray[np.int8]  # (nx, ny, nz) signed, of voxel centres to any surface
    origin_m: Array  # (3,) odom
    cell_m: float

    def layer(self, xy_m: Array, z_m: float, half_m: float) -> Field2 | None:
        """Distances at one height around a place (2,); None above and below the field."""
        k = math.floor((z_m - float(self.origin_m[2])) / self.cell_m)
        if not 0 <= k < self.distance_cm.shape[2]:
            return None
        at = np.floor((np.asarray(xy_m) - self.origin_m[:2]) / self.cell_m).astype(int)
        n, limit = math.ceil(half_m / self.cell_m), np.array(self.distance_cm.shape[:2])
        low = np.clip(at - n, 0, limit - 2)
        high = np.clip(at + n, low + 2, limit)
        cut = self.distance_cm[low[0] : high[0], low[1] : high[1], k].astype(np.float32) * np.float32(0.01)
        return Field2(cut, np.ones(cut.shape, np.bool_), self.origin_m[:2] + low * self.cell_m, self.cell_m)


def air_truth(known: Known) -> AirTruth:
    """Signed distances in the air of a scene."""
    free = known.free
    cell, origin = free.voxel_m, free.origin_m
    distance = np.full(free.distance_m.shape, np.float32(EXACT_M))
    kernels.near_distances(known.world.triangles_m, origin, cell, EXACT_M, distance)
    beyond = distance >= np.float32(EXACT_M)
    distance[beyond] = np.maximum(free.distance_m[beyond], np.float32(EXACT_M))
    reached = _reached(known, distance)
    if reached.all() or not reached.any():
        return AirTruth(centimetres(distance if reached.any() else -distance), origin, cell)
    depth = (distance_to(reached, True) - np.float32(0.5)) * np.float32(cell)
    near_m = np.where(beyond, np.float32(0.0), distance)
    return AirTruth(centimetres(np.where(reached, distance, -np.maximum(depth, near_m))), origin, cell)


def _reached(known: Known, distance_m: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Voxels that are joined to where the robot can stand or fly, (nx, ny, nz)."""
    free = known.free
    wide = distance_m >= max(CORE_M, 0.51 * free.voxel_m)  # between two such centres there is no surface
    covered = ndimage.binary_erosion(free.occupied.any(axis=2), np.ones((3, 3)), border_value=1)
    wide &= covered[:, :, None]  # not round the world's edge to below its floor
    parts, count = ndimage.label(wide)
    lifted = known.places_m + np.array([0.0, 0.0, 0.5 * free.voxel_m])  # the floor is too near to the body
    seeds = np.vstack([known.cells_m, known.places_m, lifted])
    at = np.floor((seeds - free.origin_m) / free.voxel_m).astype(int)
    at = np.clip(at, 0, np.array(distance_m.shape) - 1)
    mine = np.zeros(count + 1, np.bool_)
    mine[parts[tuple(at.T)]] = True
    mine[0] = False
    reached: NDArray[np.bool_] = mine[parts]
    for _ in range(math.ceil(RIM * 0.1 / free.voxel_m)):
        reached = kernels.spread(reached, distance_m, free.voxel_m)
    return reached
