"""Where a robot can be: places to stand on, and cells to fly in. Frame: odom; metres."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from labr_autonomy.config import RobotConfig
from labr_autonomy.types import Array
from sim.worlds import free_kernels as kernels
from sim.worlds.surface import FLOOR_BAND_M, Surface

LAND_CELL_M = 0.1
LAND_COLUMNS_MAX = 300_000
HITS_MAX = 1_000_000  # floors and undersides together, over all decks
AIR_CELL_M = 0.2
AIR_CELLS_MAX = 4_000_000
LAND_MARGIN_M = 0.05  # beyond the outline: half a cell, so that the way between two places is free as well
AIR_MARGIN_M = 0.02  # beyond the sphere about the outline; a cell must still fit into a 0.9 m door
ROOM_M = 0.3  # clearances up to this are told apart
SUPPORT_M = 0.2  # floor must go on this far all round: the wheels stand 0.15 m from the middle
STEP_M = FLOOR_BAND_M  # what the wheels climb
SLOPE_MAX = 0.12
LIFT_MIN_M = 0.8  # least height of a hop above driving height, as `mission.pilot` lifts
HEAD_FROM_M = 0.1  # what is lower does not hinder take-off, as `planner.pipeline` judges it
GROUND_M2 = 4.0  # a smaller platform (a table, a car's roof) is no floor to count heights from
SPECK_PLACES = 6  # islands of fewer places are noise of the grid
_PROBES = 3  # places of an island that are asked whether they are inside a solid

Ints = NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class LandLayer:
    """Places where the robot can stand, several in a column where there are decks."""

    origin_m: Array  # (2,) lower corner of column (0, 0)
    cell_m: float
    shape: tuple[int, int]
    starts: Ints  # (nx * ny + 1,) where the places of a column begin, by rising height
    column: Ints  # (n,) i * ny + j
    floor_z_m: Array  # (n,)
    room_m: NDArray[np.float32]  # (n,) about the clearance of the outline standing there, at most ROOM_M
    top_m: NDArray[np.float32]  # (n,) height of the body to which it may lift off here
    beside: Ints  # (n, 8) neighbours that can be driven to, -1 where none
    island: Ints  # (n,) places with the same number are joined by driving
    ground: NDArray[np.bool_]  # (n,) on floors, not on platforms
    reach: Ints  # (n,) places and air cells with the same number are joined by driving and flying

    @property
    def xy_m(self) -> Array:
        """Centres of all places, (n, 2)."""
        i, j = np.divmod(self.column, self.shape[1])
        out: Array = self.origin_m + (np.column_stack([i, j]) + 0.5) * self.cell_m
        return out

    def nearest(self, xy_m: Array, floor_z_m: float, within_m: float, dz_m: float = 0.15) -> int | None:
        """Number of the place nearest to a point on a floor; None when none is within the distances."""
        at = (np.asarray(xy_m, dtype=float) - self.origin_m) / self.cell_m - 0.5
        r = math.ceil(within_m / self.cell_m)
        best: tuple[float, int] | None = None
        for i in range(max(round(at[0]) - r, 0), min(round(at[0]) + r, self.shape[0] - 1) + 1):
            for j in range(max(round(at[1]) - r, 0), min(round(at[1]) + r, self.shape[1] - 1) + 1):
                gap = math.hypot(i - at[0], j - at[1]) * self.cell_m
                if gap > within_m + self.cell_m:
                    continue
                column = i * self.shape[1] + j
                for k in range(int(self.starts[column]), int(self.starts[column + 1])):
                    dz = abs(float(self.floor_z_m[k]) - floor_z_m)
                    if dz <= dz_m and (best is None or gap + dz < best[0]):
                        best = (gap + dz, k)
        return None if best is None else best[1]


@dataclass(frozen=True, slots=True)
class AirLayer:
    """Cells in which the robot can fly."""

    origin_m: Array  # (3,) lower corner of cell (0, 0, 0)
    cell_m: float
    free: NDArray[np.bool_]  # (nx, ny, nz)
    room_m: NDArray[
        np.float32
    ]  # (nx, ny, nz) beyond the sphere about the outline, by the voxels; at most ROOM_M
    floor_z_m: NDArray[np.float32]  # (nx, ny, nz) of the ground below; NaN where there is none
    reach: Ints  # (nx, ny, nz) as in LandLayer; -1 where not free
    place_starts: Ints  # (nx * ny + 1,) where the places under a column begin in `places`
    places: Ints  # land places ordered by air column

    def centres_m(self, index: NDArray[np.int64]) -> Array:
        """Centres of cells (n, 3), (n, 3) odom."""
        out: Array = self.origin_m + (index + 0.5) * self.cell_m
        return out

    def nearest(self, point_m: Array, within_m: float) -> int | None:
        """Flat number of the free cell nearest to a point (3,); None when none is within."""
        at = (np.asarray(point_m, dtype=float) - self.origin_m) / self.cell_m - 0.5
        r = math.ceil(within_m / self.cell_m) + 1
        low = np.clip(np.round(at).astype(int) - r, 0, self.free.shape)
        high = np.clip(np.round(at).astype(int) + r + 1, 0, self.free.shape)
        near = np.argwhere(self.free[tuple(slice(a, b) for a, b in zip(low, high, strict=True))]) + low
        if not len(near):
            return None
        gap = np.linalg.norm(near - at, axis=1) * self.cell_m
        best = int(gap.argmin())
        if gap[best] > within_m:
            return None
        return int(np.ravel_multi_index(tuple(near[best]), self.free.shape))


@dataclass(frozen=True, slots=True)
class Standing:
    """Floors and the places on them, before they are joined with the air."""

    origin_m: Array
    cell_m: float
    shape: tuple[int, int]
    starts: Ints
    column: Ints
    floor_z_m: Array
    room_m: NDArray[np.float32]
    beside: Ints
    island: Ints
    covered: NDArray[np.bool_]  # (nx, ny) columns with any surface at all

    @property
    def ground(self) -> NDArray[np.bool_]:
        """Which places belong to floors, not to platforms, (n,); all when there are only platforms."""
        if not len(self.island):
            return np.zeros(0, np.bool_)
        wide = np.bincount(self.island) * self.cell_m**2 >= GROUND_M2
        kept: NDArray[np.bool_] = wide[self.island]
        return kept if kept.any() else ~kept


def standing(
    surface: Surface, config: RobotConfig, region_m: Array, margin_m: float, slope: float
) -> Standing:
    """Every place where the outline can stand with `margin_m` to spare."""
    size = region_m[1, :2] - region_m[0, :2]
    cell = max(LAND_CELL_M, math.sqrt(float(size[0] * size[1]) / LAND_COLUMNS_MAX))
    while True:
        pad = math.ceil(SUPPORT_M / cell) + 1
        nx, ny = (int(n) + 2 * pad for n in np.ceil(size / cell - 1e-6))
        origin = region_m[0, :2] - pad * cell
        low, high = float(region_m[0, 2]) - 0.05, float(region_m[1, 2])
        column, z = kernels.column_hits(surface.world.triangles_m, origin, cell, nx, ny, low, high)
        if len(z) <= HITS_MAX:
            break
        cell *= 1.02 * math.sqrt(len(z) / HITS_MAX)
    order = np.lexsort((z, column))
    column, z = column[order], z[order]
    covered = np.bincount(column, minlength=nx * ny).reshape(nx, ny) > 0
    # the upper of two surfaces that the wheels do not tell apart
    same = column[1:] == column[:-1]
    above = np.where(same, z[1:] - z[:-1], math.inf)
    upper = np.append(above > STEP_M, True)[: len(z)]
    column, z = column[upper], z[upper]
    starts = _starts(column, nx * ny)
    reach = max(1, round(SUPPORT_M / cell))
    fit, rises = kernels.supported(starts, column, z, nx, ny, cell, reach, STEP_M, slope)
    tall = config.body.below_m + config.body.above_m
    overhead = np.append(np.where(column[1:] == column[:-1], z[1:] - z[:-1], math.inf), math.inf)[: len(z)]
    fit &= overhead > tall
    i, j = np.divmod(column, ny)
    xy = origin + (np.column_stack([i, j]) + 0.5) * cell
    fit &= ((xy >= region_m[0, :2]) & (xy <= region_m[1, :2])).all(axis=1)
    column, z, xy, rises = column[fit], z[fit], xy[fit], rises[fit]
    body_m = np.column_stack([xy, z + config.body.below_m])
    free = surface.clear(body_m, margin_m, on_floor=True, slopes=rises)
    column, z, body_m = column[free], z[free], body_m[free]
    island = _islands(kernels.neighbours(_starts(column, nx * ny), column, z, nx, ny, cell, STEP_M, slope))
    real = _outside_solids(surface, body_m, island)
    column, z = column[real], z[real]
    starts = _starts(column, nx * ny)
    beside = kernels.neighbours(starts, column, z, nx, ny, cell, STEP_M, slope)
    return Standing(
        origin,
        cell,
        (nx, ny),
        starts,
        column,
        z,
        _room(beside, cell, margin_m),
        beside,
        _islands(beside),
        covered,
    )


def join(
    land: Standing, surface: Surface, config: RobotConfig, region_m: Array, nearest_m: NearestField
) -> tuple[LandLayer, AirLayer]:
    """The air over the places, and where the two can be changed between."""
    body = config.body
    size = region_m[1] - region_m[0]
    cell = max(AIR_CELL_M, float(np.cbrt(np.prod(size) / AIR_CELLS_MAX)))
    shape = tuple(max(1, int(n)) for n in np.ceil(size / cell - 1e-6))
    origin = region_m[0].copy()
    axes = [origin[k] + (np.arange(shape[k]) + 0.5) * cell for k in range(3)]
    floor = _ground_below(land, axes, body.below_m)
    height = axes[2] - floor
    sphere_m = math.hypot(body.radius_m, max(body.below_m, body.above_m))
    low_enough = height <= config.air.height_max_m + 1e-6  # NaN, no ground below, is not
    index = np.argwhere(low_enough)
    distance = nearest_m(origin + (index + 0.5) * cell, sphere_m + AIR_MARGIN_M)
    room = np.full(shape, -sphere_m, np.float32)
    room[tuple(index.T)] = np.minimum(distance - sphere_m, ROOM_M)
    free = room >= AIR_MARGIN_M
    islands, count = ndimage.label(free, np.ones((3, 3, 3)))
    cells = np.argwhere(free)
    label = (islands[free] - 1).astype(np.int32)
    good = _outside_solids(surface, origin + (cells + 0.5) * cell, label)
    free[tuple(cells[~good].T)] = False
    i, j = np.divmod(land.column, land.shape[1])
    xy = land.origin_m + (np.column_stack([i, j]) + 0.5) * land.cell_m
    spots = np.column_stack([xy, land.floor_z_m + HEAD_FROM_M])
    head = surface.headrooms(spots, body.radius_m + config.clearance.landing_m)
    top = head - body.above_m - config.clearance.landing_m
    over = np.clip(((xy - origin[:2]) / cell).astype(np.int64), 0, np.array(shape[:2]) - 1)
    over_column = over[:, 0] * shape[1] + over[:, 1]
    order = np.argsort(over_column, kind="stable").astype(np.int32)
    join_land, join_air = _joints(land, free, islands, over, axes[2], top, body.below_m + LIFT_MIN_M)
    land_count = int(land.island.max()) + 1 if len(land.island) else 0
    total = land_count + count
    graph = csr_matrix(
        (np.ones(len(join_land), np.int8), (join_land, land_count + join_air)), shape=(total, total)
    )
    reach = connected_components(graph, directed=False)[1].astype(np.int32)
    air_reach = np.full(shape, -1, np.int32)
    air_reach[free] = reach[land_count + islands[free] - 1]
    layer = LandLayer(
        land.origin_m,
        land.cell_m,
        land.shape,
        land.starts,
        land.column,
        land.floor_z_m,
        land.room_m,
        top.astype(np.float32),
        land.beside,
        land.island,
        land.ground,
        reach[land.island] if len(land.island) else np.zeros(0, np.int32),
    )
    places = _starts(over_column[order].astype(np.int32), shape[0] * shape[1])
    return layer, AirLayer(origin, cell, free, room, floor, air_reach, places, order)


class NearestField:
    """Distances of points to the surface: exactly decided where it matters, by the voxel field elsewhere.

    Args:
        surface: The exact answer.
        distance_m: (nx, ny, nz) distance of voxel centres to the nearest occupied voxel centre.
        origin_m: (3,) lower corner of voxel (0, 0, 0).
        cell_m: Edge of a voxel.
    """

    def __init__(
        self, surface: Surface, distance_m: NDArray[np.float32], origin_m: Array, cell_m: float
    ) -> None:
        self._surface, self._distance_m, self._origin_m, self._cell_m = surface, distance_m, origin_m, cell_m

    def __call__(self, points_m: Array, least_m: float) -> Array:
        """Distances of points (n, 3), (n,): on the right side of `least_m`, beyond that to about a voxel."""
        u = (points_m - self._origin_m) / self._cell_m
        at = np.clip(u.astype(np.int64), 0, np.array(self._distance_m.shape) - 1)
        rough: Array = self._distance_m[tuple(at.T)].astype(np.float64)
        # half a diagonal to the surface in its voxel, and from the point to its own voxel's centre
        error = math.sqrt(0.75) * self._cell_m + np.linalg.norm(u - at - 0.5, axis=1) * self._cell_m
        unsure = np.abs(rough - least_m) <= error
        far = self._surface.away(points_m[unsure], least_m)
        rough[unsure] = np.where(far, np.maximum(rough[unsure], least_m), 0.0)
        return rough


def _room(beside: Ints, cell_m: float, margin_m: float) -> NDArray[np.float32]:
    """About how much clearance each place has, (n,): the way to the rim of its island, rims at the margin."""
    room = np.where((beside < 0).any(axis=1), margin_m, ROOM_M)
    step = cell_m * np.array([math.hypot(a, b) for a, b in kernels.RING])
    for _ in range(math.ceil((ROOM_M - margin_m) / cell_m)):
        room = np.minimum(room, (np.where(beside < 0, ROOM_M, room[beside]) + step).min(axis=1))
    return np.asarray(room, dtype=np.float32)


def _starts(column: Ints, count: int) -> Ints:
    return np.searchsorted(column, np.arange(count + 1)).astype(np.int32)


def _islands(beside: Ints) -> Ints:
    n = len(beside)
    tails = np.repeat(np.arange(n), 8)[beside.ravel() >= 0]
    heads = beside.ravel()[beside.ravel() >= 0]
    graph = csr_matrix((np.ones(len(tails), np.int8), (tails, heads)), shape=(n, n))
    return connected_components(graph, directed=False)[1].astype(np.int32) if n else np.zeros(0, np.int32)


def _outside_solids(surface: Surface, points_m: Array, island: Ints) -> NDArray[np.bool_]:
    """Which points (n, 3) belong to islands that are neither specks nor inside a solid, (n,)."""
    if not len(island):
        return np.zeros(0, np.bool_)
    order = np.argsort(island, kind="stable")
    count = np.bincount(island)
    first = np.cumsum(count) - count
    good = count >= SPECK_PLACES
    for number in np.flatnonzero(good):
        pick = first[number] + (np.arange(_PROBES) * (count[number] - 1)) // (_PROBES - 1)
        votes = sum(surface.inside(points_m[order[k]]) for k in pick)
        good[number] = 2 * votes <= _PROBES
    out: NDArray[np.bool_] = good[island]
    return out


def _ground_below(land: Standing, axes: list[Array], below_m: float) -> NDArray[np.float32]:
    """Height of the ground under every air cell (nx, ny, nz), NaN where there is nothing below.

    Over furniture and walls it is that of the nearest ground: heights are not counted from a table's top.
    """
    shape = (len(axes[0]), len(axes[1]), len(axes[2]))
    if not len(land.island):
        return np.full(shape, np.nan, np.float32)
    kept = land.ground
    column, z = land.column[kept], land.floor_z_m[kept]
    nx, ny = land.shape
    starts = _starts(column, nx * ny)
    bare = (np.diff(starts) == 0).reshape(nx, ny)
    near = ndimage.distance_transform_edt(bare, return_distances=False, return_indices=True)
    own = (near[0] * ny + near[1]).astype(np.int32)
    i = np.clip(((axes[0] - land.origin_m[0]) / land.cell_m).astype(np.int64), 0, nx - 1)
    j = np.clip(((axes[1] - land.origin_m[1]) / land.cell_m).astype(np.int64), 0, ny - 1)
    columns = own[i[:, None], j[None, :]].ravel()
    below = kernels.floors_below(starts, z, columns, axes[2] - below_m + STEP_M).reshape(shape)
    below[~land.covered[i[:, None], j[None, :]]] = np.nan  # outside the world
    return np.asarray(below, dtype=np.float32)


def _joints(
    land: Standing,
    free: NDArray[np.bool_],
    islands: Ints,
    over: NDArray[np.int64],
    z_m: Array,
    top_m: Array,
    lift_m: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs (land island, air island) that a take-off joins."""
    count = int(islands.max()) + 1
    pairs = []
    for k, z in enumerate(z_m):
        ok = free[over[:, 0], over[:, 1], k] & (z >= land.floor_z_m + lift_m) & (z <= top_m)
        pairs.append(land.island[ok].astype(np.int64) * count + islands[over[ok, 0], over[ok, 1], k] - 1)
    return np.divmod(np.unique(np.concatenate(pairs)), count)
