"""The truth about where a robot can be in a world: any triangles, several decks, slopes, holes.

Clearance is decided by `Surface` itself, exactly; the voxel field only spares it the obvious cases and
stands in for a map where one is wanted. Frame: odom; metres.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from labr_autonomy.config import RobotConfig
from labr_autonomy.perception.edt import distance_to
from labr_autonomy.perception.fields import Field2, Field3
from labr_autonomy.types import Array
from sim.worlds import free_kernels as kernels
from sim.worlds.free_layers import (
    LAND_MARGIN_M,
    SLOPE_MAX,
    SUPPORT_M,
    AirLayer,
    LandLayer,
    NearestField,
    join,
    standing,
)
from sim.worlds.surface import FLOOR_BAND_M, Surface
from sim.worlds.world import World

VOXEL_M = 0.1
VOXELS_MAX = 12_000_000
PAD_M = 0.6  # field beyond the region
SKY_M = 0.5  # of air kept above the greatest height
LOCAL_CELL_M = 0.05  # of the driving robot's field


class FreeSpace:
    """Free places on land and free cells in the air of one world, for one robot.

    Args:
        world: The world; its `region_m` bounds all answers.
        surface: Its surface with the robot's outline.
        config: The robot.
        margin_m: Clearance that a place to stand must have.
        slope_max: Rise over run that the wheels climb.
    """

    def __init__(
        self,
        world: World,
        surface: Surface,
        config: RobotConfig,
        *,
        margin_m: float = LAND_MARGIN_M,
        slope_max: float = SLOPE_MAX,
    ) -> None:
        self.world, self.surface, self.config, self.slope_max = world, surface, config, slope_max
        places = standing(surface, config, world.region_m, margin_m, slope_max)
        self.region_m = self._region(places.floor_z_m[places.ground])
        size = self.region_m[1] - self.region_m[0] + 2.0 * PAD_M
        self.voxel_m = max(VOXEL_M, float(np.cbrt(np.prod(size) / VOXELS_MAX)))
        shape = np.ceil(size / self.voxel_m).astype(int)
        self.origin_m: Array = self.region_m[0] - PAD_M
        self.occupied = np.zeros(tuple(shape), np.bool_)
        kernels.voxelise(world.triangles_m, self.origin_m, self.voxel_m, self.occupied)
        self.distance_m = self._distances()
        nearest = NearestField(surface, self.distance_m, self.origin_m, self.voxel_m)
        self.land: LandLayer
        self.air: AirLayer
        self.land, self.air = join(places, surface, config, self.region_m, nearest)

    def _region(self, floors_m: Array) -> Array:
        """The region, up to where the robot may fly over its floors; the sky is not the mesh's upper end."""
        low, high = self.world.region_m.copy()
        ceiling = self.config.air.height_max_m + SKY_M
        top = (float(floors_m.max()) if len(floors_m) else float(low[2])) + ceiling
        open_above = high[2] >= self.world.upper_m[2] - 1e-6
        high[2] = top if open_above else min(top, float(high[2]))
        return np.stack([low, high])

    def _distances(self) -> NDArray[np.float32]:
        if not self.occupied.any():
            return np.full(self.occupied.shape, 1e3, np.float32)
        out = distance_to(self.occupied, True)
        out *= np.float32(self.voxel_m)
        return out

    def air_field(self, centre_m: Array, half_m: tuple[float, float] = (3.5, 3.5)) -> Field3:
        """The true map around a flying robot: distance to the voxels' faces, everything known."""
        u = (np.asarray(centre_m[:2], dtype=float) - self.origin_m[:2]) / self.voxel_m
        n = np.ceil(np.array(half_m) / self.voxel_m).astype(int)
        limit = np.array(self.distance_m.shape[:2])
        low = np.clip(np.floor(u).astype(int) - n, 0, limit - 2)
        high = np.clip(np.floor(u).astype(int) + n + 1, low + 2, limit)
        distance = self.distance_m[low[0] : high[0], low[1] : high[1]] - np.float32(0.5 * self.voxel_m)
        corner = self.origin_m + np.array([low[0], low[1], 0]) * self.voxel_m
        return Field3(np.ascontiguousarray(distance), np.ones(distance.shape, np.bool_), corner, self.voxel_m)

    def land_field(
        self, position_m: Array, half_m: tuple[float, float] = (3.5, 3.5), cell_m: float = LOCAL_CELL_M
    ) -> Field2:
        """The true map around a robot that stands at `position_m` (3,) body origin, as it would be driven.

        A cell hinders when a surface crosses it between what the wheels climb and the body's top above the
        floor *there*, or when the floor does not go on: floors are followed up and down slopes.
        """
        return self.land_and_floors(position_m, half_m, cell_m)[0]

    def land_and_floors(
        self, position_m: Array, half_m: tuple[float, float] = (3.5, 3.5), cell_m: float = LOCAL_CELL_M
    ) -> tuple[Field2, Array]:
        """`land_field`, and the height in odom of the floor that was followed, (nx, ny); NaN without one."""
        body = self.config.body
        n = np.ceil(np.array(half_m) / cell_m).astype(int)
        nx, ny = (int(2 * k) for k in n)
        origin = np.floor(np.asarray(position_m[:2], dtype=float) / cell_m) * cell_m - n * cell_m
        floor = float(position_m[2]) - body.below_m
        corner = origin + np.array([nx, ny]) * cell_m
        triangles = self.surface.near(origin - SUPPORT_M, corner + SUPPORT_M)
        floors = _floors_around(triangles, origin, cell_m, nx, ny, floor, float(half_m[0]))
        solid = np.isnan(floors)
        kernels.band_cells(
            triangles,
            origin,
            cell_m,
            np.where(solid, floor, floors),
            FLOOR_BAND_M,
            body.below_m + body.above_m,
            solid,
        )
        reached, _ = ndimage.label(~solid)
        here = int(reached[nx // 2, ny // 2])
        if here:  # what cannot be driven to is as good as solid: the inside of things, most of all
            solid = reached != here
        return Field2.from_occupied(solid, np.ones((nx, ny), np.bool_), origin, cell_m), floors


def _floors_around(
    triangles_m: NDArray[np.float32],
    origin_m: Array,
    cell_m: float,
    nx: int,
    ny: int,
    floor_m: float,
    reach_m: float,
) -> Array:
    """Height of the floor in each cell that can be followed from the middle, NaN elsewhere, (nx, ny)."""
    rise = SLOPE_MAX * reach_m * math.sqrt(2.0) + FLOOR_BAND_M
    column, z = kernels.column_hits(
        triangles_m, origin_m, cell_m, nx, ny, floor_m - rise - FLOOR_BAND_M, floor_m + rise
    )
    order = np.lexsort((z, column))
    column, z = column[order], z[order]
    starts = np.searchsorted(column, np.arange(nx * ny + 1)).astype(np.int32)
    return np.asarray(kernels.follow_floor(starts, z, nx, ny, cell_m, floor_m, FLOOR_BAND_M, SLOPE_MAX))
