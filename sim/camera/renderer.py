"""Ideal depth images of a world: OpenGL on EGL where that works, Embree's rays otherwise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from labr_autonomy.config import Camera
from labr_autonomy.errors import BadInput
from labr_autonomy.types import Array, Image, Intrinsics
from sim.movers.mover import Placed
from sim.worlds.world import World

DEFAULT_RANGE_M = Camera().range_max_m


class Renderer(Protocol):
    """Whatever renders depth."""

    kind: str  # what renders, for reports

    def depth(self, T_world_camera: Array, movers: Sequence[Placed] = ()) -> Image:
        """Depth along the optical axis [m], (h, w) float32; 0 where nothing is within range.

        Args:
            T_world_camera: (4, 4) camera-FLU (x along the optical axis) to odom.
            movers: What stands in the world besides its own triangles.
        """
        ...

    def close(self) -> None:
        """Give back what the renderer holds."""
        ...


def make_renderer(
    world: World, intrinsics: Intrinsics, range_m: float = DEFAULT_RANGE_M, *, kind: str = "auto"
) -> Renderer:
    """The quickest renderer that works on this machine.

    Args:
        world: What is seen.
        intrinsics: The camera; pixel (u, v) is the ray through its centre, u right, v down.
        range_m: Farther surfaces are not seen.
        kind: "gl", "rays", or "auto" for gl and rays where gl does not work.
    """
    from sim.camera.gl import GlRenderer, GlUnavailable
    from sim.camera.rays import RayRenderer

    if kind not in ("auto", "gl", "rays"):
        raise BadInput(f"there is no renderer '{kind}'", "Take auto, gl or rays.")
    if kind == "rays":
        return RayRenderer(world, intrinsics, range_m)
    try:
        return GlRenderer(world, intrinsics, range_m)
    except GlUnavailable as error:
        if kind == "gl":
            raise
        return RayRenderer(world, intrinsics, range_m, instead_of=str(error))
