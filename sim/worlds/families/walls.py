"""Walls with doorways and windows, door leaves, floor and ceiling slabs. Frame: odom; solids are closed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sim.worlds.families.floor_plan import OUTSIDE, Border, Rect
from sim.worlds.families.layout import Rng
from sim.worlds.meshes import Mesh, box, merged

OUTER_M = 0.20  # thickness of an outer wall, outside the floor's rectangle
SLAB_M = 0.20  # thickness of floor and ceiling
_SEAM_M = 0.001  # keeps faces of neighbouring pieces from lying in one plane
_TILE_M = 2.0
_PANE_M = 0.012  # half the thickness of a window pane, which a depth camera takes for a wall
_LEAF_M = 0.02  # half the thickness of a door leaf


class Opening(NamedTuple):
    """A hole in the wall on a border."""

    border: Border
    low_m: float  # along the border
    high_m: float
    bottom_m: float
    top_m: float
    pane: bool = False  # closed by a window

    @property
    def centre_m(self) -> tuple[float, float]:
        """Middle of the hole in x and y."""
        middle = 0.5 * (self.low_m + self.high_m)
        return (middle, self.border.at_m) if self.border.along == 0 else (self.border.at_m, middle)

    @property
    def width_m(self) -> float:
        """[m]."""
        return self.high_m - self.low_m


def opening(
    rng: Rng, border: Border, width_m: float, bottom_m: float, top_m: float, end_m: float = 0.25
) -> Opening:
    """A hole somewhere on a border, at least `end_m` from its ends."""
    room = max(0.0, border.length_m - width_m - 2.0 * end_m)
    low = border.low_m + 0.5 * (border.length_m - width_m - room) + rng.uniform(0.0, room)
    return Opening(border, low, low + width_m, bottom_m, top_m)


def windows(rng: Rng, border: Border, sill_m: float, top_m: float) -> list[Opening]:
    """A row of equal windows in an outer wall."""
    width, pier = rng.uniform(1.0, 1.8), rng.uniform(0.5, 1.2)
    count = int((border.length_m - pier) / (width + pier))
    pitch = border.length_m / max(1, count)
    middles = border.low_m + pitch * (np.arange(count) + 0.5)
    return [Opening(border, m - 0.5 * width, m + 0.5 * width, sill_m, top_m, pane=True) for m in middles]


def wall(border: Border, holes: Sequence[Opening], floor: Rect, half_m: float, height_m: float) -> list[Mesh]:
    """The wall on a border as boxes around its holes. Outer walls stand outside the floor's rectangle."""
    along = border.along
    if border.second == OUTSIDE:
        outwards = 1.0 if border.at_m > floor.centre[1 - along] else -1.0
        middle, half = border.at_m + 0.5 * outwards * OUTER_M, 0.5 * OUTER_M
        low_end = OUTER_M if border.low_m <= floor[along] else _SEAM_M
        high_end = OUTER_M if border.high_m >= floor[along + 2] else _SEAM_M
    else:
        middle, half = border.at_m, half_m
        low_end = high_end = half_m - _SEAM_M

    def piece(low: float, high: float, bottom: float, top: float, half_thick: float) -> Mesh:
        centre, extent = (0.5 * (low + high), middle), (0.5 * (high - low), half_thick)
        if along == 1:
            centre, extent = centre[::-1], extent[::-1]
        return box((*centre, 0.5 * (bottom + top)), (*extent, 0.5 * (top - bottom)))

    foot, head = _SEAM_M, height_m - _SEAM_M
    parts, edge = [], border.low_m - low_end
    for hole in sorted(holes, key=lambda h: h.low_m):
        if hole.low_m - edge > _SEAM_M:
            parts.append(piece(edge, hole.low_m, foot, head, half))
        if hole.bottom_m > 0.0:
            parts.append(piece(hole.low_m, hole.high_m, foot, hole.bottom_m, half))
        if hole.top_m < height_m:
            parts.append(piece(hole.low_m, hole.high_m, hole.top_m, head, half))
        if hole.pane:
            parts.append(piece(hole.low_m, hole.high_m, hole.bottom_m, hole.top_m, _PANE_M))
        edge = hole.high_m
    if border.high_m + high_end - edge > _SEAM_M:
        parts.append(piece(edge, border.high_m + high_end, foot, head, half))
    return parts


def door_leaf(rng: Rng, hole: Opening, wall_half_m: float, into: int) -> Mesh:
    """The leaf of an open door: hinged at one jamb, swung 85 to 120 degrees into one of the two spaces."""
    border, half = hole.border, 0.5 * (hole.width_m - 0.02)
    at_low, side = rng.random() < 0.5, 1.0 if into == border.second else -1.0
    swing = rng.uniform(math.radians(85.0), math.radians(120.0))
    hinge = hole.low_m - _LEAF_M if at_low else hole.high_m + _LEAF_M
    heading = side * swing if at_low else math.pi - side * swing  # from the hinge, as if the wall ran along x
    u, v = hinge, border.at_m + side * (wall_half_m + _LEAF_M)
    leaf = box((half, 0.0, 0.5 * hole.top_m), (half, _LEAF_M, 0.5 * hole.top_m - 0.01))
    handle = box((2.0 * half - 0.08, 0.0, 1.02), (0.06, 0.06, 0.012))
    if border.along == 0:
        return merged([leaf, handle]).moved(u, v, 0.0, heading)
    return merged([leaf, handle]).moved(v, u, 0.0, 0.5 * math.pi - heading)


def slab(area: Rect, bottom_m: float, top_m: float) -> Mesh:
    """A closed slab with faces of at most 2 m, so that its triangles stay local."""
    nx, ny = (max(1, math.ceil(side / _TILE_M)) for side in area.size)
    x, y = np.linspace(area.x0, area.x1, nx + 1), np.linspace(area.y0, area.y1, ny + 1)
    gx, gy = np.meshgrid(x, y, indexing="ij")
    sheets = [np.stack([gx, gy, np.full_like(gx, z)], axis=-1).reshape(-1, 3) for z in (bottom_m, top_m)]
    node = np.arange((nx + 1) * (ny + 1)).reshape(nx + 1, ny + 1)
    a, b, c, d = (
        corner.reshape(-1) for corner in (node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:])
    )
    up = node.size  # from a corner below to the one above it
    faces = [
        np.stack(f, axis=1)
        for f in ((a, c, b), (a, d, c), (a + up, b + up, c + up), (a + up, c + up, d + up))
    ]
    rim = np.concatenate([node[:-1, 0], node[-1, :-1], node[:0:-1, -1], node[0, :0:-1]])  # counter-clockwise
    after = np.roll(rim, -1)
    faces += [np.stack([rim, after, rim + up], axis=1), np.stack([after, after + up, rim + up], axis=1)]
    return Mesh(np.concatenate(sheets), np.concatenate(faces).astype(np.int32))


def floor_and_ceiling(floor: Rect, height_m: float) -> list[Mesh]:
    """Slabs below z = 0 and above the ceiling, out to the outer faces of the outer walls."""
    whole = floor.shrunk(-OUTER_M)
    return [slab(whole, -SLAB_M, 0.0), slab(whole, height_m, height_m + SLAB_M)]
