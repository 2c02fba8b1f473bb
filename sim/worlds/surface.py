"""Truth about the world's surface: how far the robot is from it, what lies beneath, who sees whom.

The robot's outline is the upright cylinder of `config.Body`. Clearance is the exact distance between
that cylinder and the triangles; at or below zero they meet, by about that depth. Two rules, chosen by
`on_floor`:

- On the floor (standing, driving, lifting off, touching down), whatever lies lower than FLOOR_BAND_M above
  the plane in which the wheels touch does not count: it is driven over or landed on. On a slope that plane
  is tilted, and the cylinder is sheared along with it: its ends lie parallel to the slope.
- In flight everything counts, the floor included.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.config import Body
from labr_autonomy.types import Array
from sim.worlds.surface_kernels import clear_of, cylinder_clearance, headrooms
from sim.worlds.world import World

FLOOR_BAND_M = 0.04  # what the wheels climb, and the unevenness of floors in meshes
REACH_M = 2.0  # clearances beyond this are reported as this
_CELL_M = 0.25
_COLUMNS_MAX = 800
_JITTER_M = 1e-3  # rays beside the edge that two triangles share, where a single ray can slip through
_MARGIN_M = 1e-4
# A ray slips through within half a millimetre of the seam of slabs of 30 m: these two cannot both.
_BESIDE_M = np.array([[3.0, 1.0], [-1.0, 3.0]], dtype=np.float32) * np.float32(_JITTER_M)
_SLOPE_BASE_M = 0.12  # about half the wheels' base
LEVEL = (0.0, 0.0)


class Surface:
    """Queries on the triangles of one world.

    Args:
        world: The world.
        body: Outline of the robot.
    """

    def __init__(self, world: World, body: Body | None = None) -> None:
        self._body = body or Body()
        self.world = world
        self._triangles = np.ascontiguousarray(world.triangles_m)
        self._boxes = np.concatenate(
            [self._triangles.min(axis=1), self._triangles.max(axis=1)], axis=1
        ).astype(np.float64)
        self._corner = world.lower_m[:2].copy()
        extent = world.upper_m[:2] - world.lower_m[:2]
        self._cell = max(_CELL_M, float(extent.max()) / _COLUMNS_MAX)
        nx, ny = (int(n) + 1 for n in extent / self._cell)
        self._shape = (nx, ny)
        self._starts, self._members = self._columns()
        self._rays = _Rays(self._triangles)

    def _columns(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Triangles of every column of the xy grid, by their bounds."""
        limit = np.array(self._shape) - 1
        low = np.clip(((self._boxes[:, 0:2] - self._corner) / self._cell).astype(np.int64), 0, limit)
        high = np.clip(((self._boxes[:, 3:5] - self._corner) / self._cell).astype(np.int64), 0, limit)
        wide = high - low + 1
        counts = wide[:, 0] * wide[:, 1]
        owner = np.repeat(np.arange(len(counts)), counts)
        local = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        i = low[owner, 0] + local // wide[owner, 1]
        j = low[owner, 1] + local % wide[owner, 1]
        column = i * self._shape[1] + j
        order = np.argsort(column, kind="stable")
        starts = np.searchsorted(column[order], np.arange(self._shape[0] * self._shape[1] + 1))
        return starts.astype(np.int32), owner[order].astype(np.int32)

    def clearance(
        self,
        position_m: Array,
        *,
        on_floor: bool = False,
        radius_m: float | None = None,
        reach_m: float = REACH_M,
        slope: tuple[float, float] = LEVEL,
    ) -> float:
        """Distance from the robot's outline to the nearest surface [m], at most `reach_m`; <= 0 is contact.

        Args:
            position_m: (3,) body origin, odom.
            on_floor: Leave out what lies lower than FLOOR_BAND_M above the plane of the wheels' contact.
            radius_m: Another radius than the body's.
            reach_m: Look no farther than this.
            slope: Rise of the floor per metre east and per metre north, where the robot stands on it.
        """
        z = float(position_m[2])
        steep = math.sqrt(1.0 + slope[0] * slope[0] + slope[1] * slope[1])
        low = z - self._body.below_m * steep + (FLOOR_BAND_M if on_floor else 0.0)
        return float(
            cylinder_clearance(
                *self.index,
                np.array(position_m[:2], dtype=np.float64),
                self._body.radius_m if radius_m is None else radius_m,
                low,
                z + self._body.above_m,
                on_floor,
                reach_m,
                slope[0],
                slope[1],
            )
        )

    def clear(
        self, positions_m: Array, margin_m: float, *, on_floor: bool = False, slopes: Array | None = None
    ) -> NDArray[np.bool_]:
        """Whether `clearance` is at least `margin_m` (above zero) at each of many positions (n, 3), (n,).

        `slopes` (n, 2) are the floor's rises per metre east and north under each; level when left out.
        """
        p = np.asarray(positions_m, dtype=np.float64).reshape(-1, 3)
        slant = np.zeros((len(p), 2)) if slopes is None else np.ascontiguousarray(slopes, np.float64)
        steep = np.sqrt(1.0 + (slant * slant).sum(axis=1))
        low = p[:, 2] - self._body.below_m * steep + (FLOOR_BAND_M if on_floor else 0.0)
        high = p[:, 2] + self._body.above_m
        out: NDArray[np.bool_] = clear_of(
            *self.index, p[:, :2].copy(), self._body.radius_m, low, high, on_floor, margin_m, slant
        )
        return out

    def away(self, points_m: Array, distance_m: float) -> NDArray[np.bool_]:
        """Whether no surface is nearer than `distance_m` to each of many points (n, 3), (n,)."""
        p = np.asarray(points_m, dtype=np.float64).reshape(-1, 3)
        z = p[:, 2].copy()
        level = np.zeros((len(p), 2))
        out: NDArray[np.bool_] = clear_of(*self.index, p[:, :2].copy(), 0.0, z, z, False, distance_m, level)
        return out

    def headrooms(self, points_m: Array, radius_m: float) -> NDArray[np.float64]:
        """Height in odom up to which nothing is above a disc about points (n, 3), (n,); inf under the sky."""
        p = np.asarray(points_m, dtype=np.float64).reshape(-1, 3)
        out: NDArray[np.float64] = headrooms(*self.index, p[:, :2].copy(), radius_m, p[:, 2].copy())
        return out

    def near(self, low_m: Array, high_m: Array) -> NDArray[np.float32]:
        """Triangles whose bounds meet a rectangle between corners (2,), seen from above; (k, 3, 3)."""
        meets = (self._boxes[:, 0:2] <= high_m).all(axis=1) & (self._boxes[:, 3:5] >= low_m).all(axis=1)
        out: NDArray[np.float32] = self._triangles[meets]
        return out

    @property
    def index(self) -> tuple[Any, ...]:
        """What the kernels of `surface_kernels` search in, in their order."""
        return (
            self._triangles,
            self._boxes,
            self._starts,
            self._members,
            self._shape,
            self._corner,
            self._cell,
        )

    def free_place(self, position_m: Array, *, on_floor: bool = False) -> float:
        """Clearance as above, but -1 where the position is inside a solid, however large the solid is.

        On the floor the plane of the wheels is the floor's own, so that a ramp is no obstacle.
        """
        if self.inside(position_m):
            return -1.0
        if not on_floor:
            return self.clearance(position_m)
        x, y, z = (float(v) for v in position_m)
        return self.clearance(position_m, on_floor=True, slope=self.floor_slope(x, y, z))

    def floor_slope(self, x_m: float, y_m: float, z_m: float) -> tuple[float, float]:
        """Rise of the floor below a point per metre east and north; level where there is no even floor."""
        side = _SLOPE_BASE_M
        around = np.array([[side, 0.0], [-side, 0.0], [0.0, side], [0.0, -side], [0.0, 0.0]])
        east, west, north, south, here = self.floors_below(around + np.array([x_m, y_m]), z_m).tolist()
        uneven = max(abs(0.5 * (east + west) - here), abs(0.5 * (north + south) - here))
        if not uneven < FLOOR_BAND_M:
            return LEVEL
        return 0.5 * (east - west) / side, 0.5 * (north - south) / side

    def floors_below(self, points_m: Array, z_m: Array | float) -> Array:
        """Height of the highest surface at or below each of some points [m, odom]; -inf without one.

        Args:
            points_m: (n, 2) x and y.
            z_m: (n,) or one height from which to look down.
        """
        n = len(points_m)
        origins = np.empty((3, n, 3), dtype=np.float32)
        origins[:, :, :2] = points_m
        origins[1:, :, :2] += _BESIDE_M[:, None]
        origins[:, :, 2] = z_m + _JITTER_M
        down = np.zeros((3 * n, 3), dtype=np.float32)
        down[:, 2] = -1.0
        flat = origins.reshape(-1, 3)
        distance, _ = self._rays.first(flat, down)
        straight, *others = (flat[:, 2].astype(np.float64) - distance).reshape(3, n)
        # Rays beside count only where the first has slipped through a seam: on a slope they are off.
        beside = np.maximum(*others)
        out: Array = np.where(beside > straight + 4.0 * _JITTER_M, beside, straight)
        return out

    def floor_below(self, x_m: float, y_m: float, z_m: float) -> float:
        """Height of the highest surface at or below a point [m, odom]; -inf where there is none."""
        return float(self.floors_below(np.array([[x_m, y_m]]), z_m)[0])

    def sees(self, from_m: Array, to_m: Array) -> bool:
        """Whether the straight segment between two points (3,) meets no surface."""
        step = np.asarray(to_m, dtype=np.float64) - from_m
        length = float(np.linalg.norm(step))
        if length == 0.0:
            return True
        distance, _ = self._rays.first(np.asarray(from_m)[None], (step / length)[None])
        return bool(distance[0] >= length)

    def inside(self, position_m: Array) -> bool:
        """Whether a point (3,) is inside a solid.

        Meshes in the wild are open here and wound wrongly there, so two votes over many directions must
        agree: most rays meet an odd number of surfaces, and most meet the back of a surface first.
        """
        directions = _DIRECTIONS
        origins = np.tile(np.asarray(position_m, dtype=np.float64), (len(directions), 1))
        hits, backs = self._rays.crossings(origins, directions)
        odd, first_back = int((hits % 2 == 1).sum()), int(backs.sum())
        return 2 * odd > len(directions) and 2 * first_back > len(directions)


def _spread(count: int) -> Array:
    """Directions spread evenly over the sphere (golden spiral), (count, 3)."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    turn = math.pi * (1.0 + math.sqrt(5.0)) * k
    r = np.sqrt(1.0 - z * z)
    return np.column_stack([r * np.cos(turn), r * np.sin(turn), z])


_DIRECTIONS = _spread(21)


class _Rays:
    """Rays against the triangles, by Embree."""

    def __init__(self, triangles_m: NDArray[np.float32]) -> None:
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh

        edges = np.diff(triangles_m.astype(np.float64), axis=1)
        self._normals = np.cross(edges[:, 0], edges[:, 1])
        self._scene = rtcore_scene.EmbreeScene()
        self._mesh = TriangleMesh(self._scene, triangles_m)

    def first(
        self, origins_m: NDArray[np.floating[Any]], directions: NDArray[np.floating[Any]]
    ) -> tuple[Array, NDArray[np.int64]]:
        """Distance to the first hit [m] (inf without one) and its triangle (-1 without one)."""
        found = self._scene.run(
            np.ascontiguousarray(origins_m, np.float32),
            np.ascontiguousarray(directions, np.float32),
            output=1,
        )
        triangle = found["primID"].astype(np.int64)
        return np.where(triangle >= 0, found["tfar"].astype(np.float64), math.inf), triangle

    def crossings(self, origins_m: Array, directions: Array) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """How many surfaces each ray meets, and whether the first is met from behind."""
        count = np.zeros(len(origins_m), dtype=np.int64)
        backs = np.zeros(len(origins_m), dtype=bool)
        origins, live = origins_m.copy(), np.arange(len(origins_m))
        for turn in range(100):
            distance, triangle = self.first(origins[live], directions[live])
            hit = triangle >= 0
            live, distance, triangle = live[hit], distance[hit], triangle[hit]
            if len(live) == 0:
                break
            if turn == 0:
                backs[live] = (self._normals[triangle] * directions[live]).sum(axis=1) > 0.0
            count[live] += 1
            origins[live] += directions[live] * (distance + _MARGIN_M)[:, None]
        return count, backs
