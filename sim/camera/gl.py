"""Depth images by OpenGL on EGL: no window, no display server, software rasteriser or GPU alike.

Only the depth buffer is drawn; it is turned into metres on the way out. Chunks of the world that lie
outside the view or beyond the range are not drawn, far ones with less detail (see `chunks`).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.errors import LabrError
from labr_autonomy.types import Array, Image, Intrinsics
from sim.camera.chunks import cut
from sim.movers.mover import Placed, Shape
from sim.movers.shapes import mesh, transform
from sim.worlds.world import World

NEAR_M = 0.05  # nothing of the world comes nearer to the lens than the body's outline lets it

_VERTEX = """
#version 330
in vec3 corner;
uniform mat4 clip_from_world;
void main() { gl_Position = clip_from_world * vec4(corner, 1.0); }
"""
_FRAGMENT = """
#version 330
void main() {}
"""


class GlUnavailable(LabrError):
    """No OpenGL context can be made on this machine."""


class GlRenderer:
    """Depth by rasterising.

    Args:
        world: What is seen.
        intrinsics: The camera.
        range_m: Farther surfaces are not seen.
    """

    def __init__(self, world: World, intrinsics: Intrinsics, range_m: float) -> None:
        self._gl = _context()
        self.kind = f"OpenGL on EGL ({self._gl.info['GL_RENDERER']})"
        self._intrinsics, self._range_m = intrinsics, range_m
        size = (intrinsics.width, intrinsics.height)
        self._depth = self._gl.depth_texture(size)
        self._frame = self._gl.framebuffer(depth_attachment=self._depth)
        self._program = self._gl.program(vertex_shader=_VERTEX, fragment_shader=_FRAGMENT)
        self._chunks = cut(world)
        self._corners = self._chunks.corners_m
        self._large = self._array(world.vertices_m, self._chunks.large) if len(self._chunks.large) else None
        self._small = [self._array(level.vertices_m, level.faces) for level in self._chunks.levels]
        self._shapes: dict[Shape, Any] = {}  # of movers, uploaded when first seen
        self._gl.enable(self._gl.DEPTH_TEST)
        self._clip_from_camera = _projection(intrinsics, range_m)

    def depth(self, T_world_camera: Array, movers: Sequence[Placed] = ()) -> Image:
        """Depth image (h, w) [m]; see `Renderer`."""
        turn = T_world_camera[:3, :3]
        camera_from_world = np.eye(4)
        camera_from_world[:3, :3] = turn.T
        camera_from_world[:3, 3] = -turn.T @ T_world_camera[:3, 3]
        clip_from_world = self._clip_from_camera @ camera_from_world
        self._frame.use()
        self._frame.clear(depth=1.0)
        self._program["clip_from_world"].write(clip_from_world.T.astype(np.float32).tobytes())
        if self._large is not None:
            self._large.render()
        seen = self._seen(clip_from_world)
        wanted = self._chunks.level_of(seen, T_world_camera[:3, 3])
        for number, (level, array) in enumerate(zip(self._chunks.levels, self._small, strict=True)):
            for first, last in self._chunks.runs(level, seen[wanted == number]):
                array.render(vertices=3 * (last - first), first=3 * first)
        for placed in movers:
            self._draw(placed, clip_from_world)
        size = (self._intrinsics.height, self._intrinsics.width)
        buffer = np.frombuffer(self._depth.read(alignment=1), np.float32).reshape(size)
        # Window depth w in 0..1 of a perspective with near n and far f: depth = n f / (f - w (f - n)).
        near, far = np.float32(NEAR_M), np.float32(self._range_m)
        metres: Image = near * far / (far - buffer * (far - near))
        metres[buffer >= np.float32(1.0)] = 0.0
        return metres

    def _draw(self, placed: Placed, clip_from_world: Array) -> None:
        """One mover into the depth buffer."""
        if placed.shape not in self._shapes:
            self._shapes[placed.shape] = self._array(*mesh(placed.shape))
        clip_from_shape = clip_from_world @ transform(placed)
        self._program["clip_from_world"].write(clip_from_shape.T.astype(np.float32).tobytes())
        self._shapes[placed.shape].render()

    def _array(self, vertices_m: NDArray[np.float32], faces: NDArray[np.int32]) -> Any:
        return self._gl.vertex_array(
            self._program,
            [(self._gl.buffer(vertices_m.tobytes()), "3f", "corner")],
            index_buffer=self._gl.buffer(faces.tobytes()),
        )

    def _seen(self, clip_from_world: Array) -> NDArray[np.int64]:
        """Chunks that are not wholly beyond one plane of the view."""
        corners = self._corners @ clip_from_world[:, :3].T + clip_from_world[:, 3]  # (chunks, 8, 4)
        w = corners[..., 3:]
        beyond = (corners[..., :3] > w).all(axis=1) | (corners[..., :3] < -w).all(axis=1)
        return np.flatnonzero(~np.any(beyond, axis=1))

    def close(self) -> None:
        """Give back the context."""
        self._gl.release()


def _context() -> Any:
    # llvmpipe's worker threads cost more in hand-overs than they save at this image size.
    os.environ.setdefault("LP_NUM_THREADS", "0")
    try:
        import moderngl

        settings: dict[str, Any] = {"standalone": True, "backend": "egl", "require": 330}
        return moderngl.create_context(**settings)
    except Exception as error:  # glcontext raises bare Exception for whatever fails
        raise GlUnavailable(
            f"OpenGL on EGL does not work here: {error}", "Install libegl1, libegl-mesa0 and libgl1-mesa-dri."
        ) from error


def _projection(i: Intrinsics, far_m: float) -> Array:
    """Camera-FLU to clip space, (4, 4), with image rows downwards in memory.

    A pixel's centre is at its whole-numbered (u, v), which is half a pixel from its corner in the window.
    """
    sx, sy = 2.0 / i.width, 2.0 / i.height
    near, far = NEAR_M, far_m
    return np.array(
        [
            [(i.cx + 0.5) * sx - 1.0, -i.fx * sx, 0.0, 0.0],
            [(i.cy + 0.5) * sy - 1.0, 0.0, -i.fy * sy, 0.0],
            [(far + near) / (far - near), 0.0, 0.0, -2.0 * far * near / (far - near)],
            [1.0, 0.0, 0.0, 0.0],
        ]
    )
