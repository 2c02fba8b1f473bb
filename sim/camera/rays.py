"""Depth images by Embree: needs nothing but its wheel; about ten times the work of OpenGL."""

from __future__ import annotations

import numpy as np

from labr_autonomy.types import Array, Image, Intrinsics
from sim.worlds.world import World


class RayRenderer:
    """One ray through each pixel's centre.

    Args:
        world: What is seen.
        intrinsics: The camera.
        range_m: Farther surfaces are not seen.
        instead_of: Why OpenGL was not taken, for reports.
    """

    def __init__(self, world: World, intrinsics: Intrinsics, range_m: float, *, instead_of: str = "") -> None:
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh

        self.kind = f"embree ({instead_of})" if instead_of else "embree"
        self._scene = rtcore_scene.EmbreeScene()
        self._mesh = TriangleMesh(self._scene, np.ascontiguousarray(world.triangles_m))
        self._range_m = range_m
        i = self._intrinsics = intrinsics
        # With 1 along the axis, not normalised, the ray's parameter is the depth itself.
        self._left = (-(np.arange(i.width, dtype=np.float32) - i.cx) / i.fx).astype(np.float32)[None, :, None]
        self._up = (-(np.arange(i.height, dtype=np.float32) - i.cy) / i.fy).astype(np.float32)[:, None, None]

    def depth(self, T_world_camera: Array) -> Image:
        """Depth image (h, w) [m]; see `Renderer`."""
        forward, left, up = T_world_camera[:3, :3].T.astype(np.float32)
        directions = (forward + self._left * left + self._up * up).reshape(-1, 3)
        origins = np.broadcast_to(T_world_camera[:3, 3].astype(np.float32), directions.shape).copy()
        found: Image = self._scene.run(origins, directions, query="DISTANCE")
        found = np.where(found <= self._range_m, found, np.float32(0.0)).astype(np.float32)
        return found.reshape(self._intrinsics.height, self._intrinsics.width)

    def close(self) -> None:
        """Nothing to give back."""
