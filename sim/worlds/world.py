"""A world is triangles in odom: z up, metres, floor mostly at z = 0."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class World:
    """Triangles and how to make them again."""

    name: str
    vertices_m: NDArray[np.float32]  # (n, 3) odom
    faces: NDArray[np.int32]  # (m, 3) indices into vertices_m
    lower_m: NDArray[np.float64]  # (3,) lower corner of the bounds, odom
    upper_m: NDArray[np.float64]  # (3,) upper corner of the bounds, odom
    spec: dict[str, Any]  # what build_world needs to make this world again; plain JSON values
    region_m: NDArray[np.float64]  # (2, 3) corners of where a robot may be asked to go, odom

    @property
    def triangles_m(self) -> NDArray[np.float32]:
        """Corners of every triangle, (m, 3, 3), odom."""
        corners: NDArray[np.float32] = self.vertices_m[self.faces]
        return corners


def make_world(
    name: str,
    vertices_m: NDArray[np.floating[Any]],
    faces: NDArray[np.integer[Any]],
    spec: dict[str, Any],
    *,
    region_m: NDArray[np.float64] | None = None,
) -> World:
    """A World from plain arrays, with its bounds.

    Args:
        name: Short name for people.
        vertices_m: (n, 3) corners, odom [m]; n >= 1.
        faces: (m, 3) indices into `vertices_m`.
        spec: How to build this world again.
        region_m: (2, 3) where a robot may be asked to go; the bounds when left out.
    """
    vertices = np.ascontiguousarray(vertices_m, dtype=np.float32)
    lower, upper = (corner.astype(np.float64) for corner in (vertices.min(axis=0), vertices.max(axis=0)))
    return World(
        name=name,
        vertices_m=vertices,
        faces=np.ascontiguousarray(faces, dtype=np.int32),
        lower_m=lower,
        upper_m=upper,
        spec=spec,
        region_m=np.stack([lower, upper]) if region_m is None else np.asarray(region_m, dtype=np.float64),
    )
