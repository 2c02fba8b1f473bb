"""Triangles of movers' shapes, for cameras and pictures."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.types import Array
from sim.movers.mover import Placed, Shape
from sim.worlds.primitives import box, cylinder, triangles


@lru_cache(maxsize=256)
def mesh(shape: Shape) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Corners (n, 3) [m] and faces (m, 3) of a shape that stands at the origin and looks along x."""
    half = 0.5 * shape.height_m
    if shape.kind == "person":
        row = cylinder(0.0, 0.0, shape.half_m[0], 0.0, shape.height_m)
    else:
        row = box((0.0, 0.0, half), (*shape.half_m, half))
    vertices, faces = triangles(row)
    return vertices.astype(np.float32), faces


def transform(placed: Placed) -> Array:
    """(4, 4) from the shape's own frame to odom."""
    c, s = math.cos(placed.yaw_rad), math.sin(placed.yaw_rad)
    return np.array(
        [
            [c, -s, 0.0, placed.x_m],
            [s, c, 0.0, placed.y_m],
            [0.0, 0.0, 1.0, placed.floor_z_m],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def corners_m(placed: Placed) -> NDArray[np.float32]:
    """Triangles of a placed mover, (m, 3, 3), odom."""
    vertices, faces = mesh(placed.shape)
    T_odom_shape = transform(placed)
    moved = vertices @ T_odom_shape[:3, :3].T + T_odom_shape[:3, 3]
    out: NDArray[np.float32] = moved.astype(np.float32)[faces]
    return out
