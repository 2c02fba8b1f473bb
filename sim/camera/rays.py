"""Depth images by Embree: needs nothing but its wheel; about ten times the work of OpenGL."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.types import Array, Image, Intrinsics
from sim.movers.mover import Placed
from sim.movers.shapes import corners_m
from sim.worlds.world import World

BESIDE_M = 0.05  # a body that reaches nearer to the lens than this may cover any column


def _scene(triangles_m: NDArray[np.float32]) -> tuple[Any, Any]:
    """A scene of Embree, and its mesh, which must be kept as long."""
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    scene = rtcore_scene.EmbreeScene()
    return scene, TriangleMesh(scene, np.ascontiguousarray(triangles_m))


class RayRenderer:
    """One ray through each pixel's centre.

    Args:
        world: What is seen.
        intrinsics: The camera.
        range_m: Farther surfaces are not seen.
        instead_of: Why OpenGL was not taken, for reports.
    """

    def __init__(self, world: World, intrinsics: Intrinsics, range_m: float, *, instead_of: str = "") -> None:
        self.kind = f"embree ({instead_of})" if instead_of else "embree"
        self._scene, self._mesh = _scene(world.triangles_m)
        self._range_m = range_m
        i = self._intrinsics = intrinsics
        # With 1 along the axis, not normalised, the ray's parameter is the depth itself.
        self._left = (-(np.arange(i.width, dtype=np.float32) - i.cx) / i.fx).astype(np.float32)[None, :, None]
        self._up = (-(np.arange(i.height, dtype=np.float32) - i.cy) / i.fy).astype(np.float32)[:, None, None]

    def depth(self, T_world_camera: Array, movers: Sequence[Placed] = ()) -> Image:
        """Depth image (h, w) [m]; see `Renderer`."""
        forward, left, up = T_world_camera[:3, :3].T.astype(np.float32)
        directions = (forward + self._left * left + self._up * up).reshape(-1, 3)
        origins = np.broadcast_to(T_world_camera[:3, 3].astype(np.float32), directions.shape).copy()
        found: Image = self._scene.run(origins, directions, query="DISTANCE")
        if movers:
            self._look_at(movers, T_world_camera, origins, directions, found)
        found = np.where(found <= self._range_m, found, np.float32(0.0)).astype(np.float32)
        return found.reshape(self._intrinsics.height, self._intrinsics.width)

    def _look_at(
        self,
        movers: Sequence[Placed],
        T_world_camera: Array,
        origins: Image,
        directions: Image,
        found: Image,
    ) -> None:
        """Let movers hide what is behind them: `found` (h * w,) is lowered where one is nearer.

        Only the columns of the image in which a mover may be seen are traced again.
        """
        triangles = [corners_m(placed) for placed in movers]
        columns = np.zeros(self._intrinsics.width, dtype=bool)
        for part in triangles:
            columns |= self._columns(part.reshape(-1, 3), T_world_camera)
        if not columns.any():
            return
        scene, _mesh = _scene(np.concatenate(triangles))
        rays = np.flatnonzero(np.tile(columns, self._intrinsics.height))
        nearer = scene.run(origins[rays], directions[rays], query="DISTANCE")
        found[rays] = np.minimum(found[rays], nearer)

    def _columns(self, corners_m: Image, T_world_camera: Array) -> NDArray[np.bool_]:
        """Columns of the image that a convex body with these corners (n, 3) odom can cover, (w,)."""
        i = self._intrinsics
        seen = (corners_m - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
        out = np.zeros(i.width, dtype=bool)
        if seen[:, 0].max() <= 0.0 or seen[:, 0].min() > self._range_m:
            return out
        if seen[:, 0].min() <= BESIDE_M:
            out[:] = True
            return out
        u = i.cx - i.fx * seen[:, 1] / seen[:, 0]
        out[max(0, math.floor(u.min())) : max(0, math.ceil(u.max()) + 1)] = True
        return out

    def close(self) -> None:
        """Nothing to give back."""
