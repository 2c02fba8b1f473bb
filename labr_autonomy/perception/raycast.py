"""Compiled kernels that put a depth image into a log-odds grid. All lengths in cells of the grid.

One frame changes a cell at most once: cells with returns gain what those returns are worth (capped at
one full hit), the other cells that rays went through lose one miss. So a thin chair leg, hit by few
of the rays that pass its cell, is not carved away by the others (as in OctoMap's discretised insertion).

Marks of a frame: 0 untouched, 1 passed through, 1 + w returns worth w in this cell.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.perception.compiled import compiled
from labr_autonomy.perception.ground import STANDS
from labr_autonomy.types import Array, Image

Grid = NDArray[np.int8]
Cells = NDArray[np.int32]


@compiled
def _carve(marks: Any, touched: Any, count: int, shape: Any, start: Any, end: Any) -> int:
    """Mark the cells from one point to another (cells, floats) as passed (Amanatides-Woo 1987)."""
    nx, ny, nz = shape
    ix, iy, iz = math.floor(start[0]), math.floor(start[1]), math.floor(start[2])
    dx, dy, dz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    far = 1e18
    sx = 1 if dx > 0 else -1
    sy = 1 if dy > 0 else -1
    sz = 1 if dz > 0 else -1
    stride_x, stride_y = ny * nz, nz
    step_x = abs(1.0 / dx) if dx != 0.0 else far
    step_y = abs(1.0 / dy) if dy != 0.0 else far
    step_z = abs(1.0 / dz) if dz != 0.0 else far
    next_x = ((ix + 1 - start[0]) if dx > 0 else (start[0] - ix)) * step_x if dx != 0.0 else far
    next_y = ((iy + 1 - start[1]) if dy > 0 else (start[1] - iy)) * step_y if dy != 0.0 else far
    next_z = ((iz + 1 - start[2]) if dz > 0 else (start[2] - iz)) * step_z if dz != 0.0 else far
    index = (ix * ny + iy) * nz + iz
    while True:
        if ix < 0 or iy < 0 or iz < 0 or ix >= nx or iy >= ny or iz >= nz:
            return count
        if marks[index] == 0:
            marks[index] = 1
            touched[count] = index
            count += 1
        if next_x < next_y and next_x < next_z:
            if next_x > 1.0:
                return count
            next_x += step_x
            ix += sx
            index += sx * stride_x
        elif next_y < next_z:
            if next_y > 1.0:
                return count
            next_y += step_y
            iy += sy
            index += sy * stride_y
        else:
            if next_z > 1.0:
                return count
            next_z += step_z
            iz += sz
            index += sz


@compiled
def _inside(cell: Any, shape: Any) -> bool:
    """Whether a place, in cells, lies in the grid."""
    return bool(0 <= cell[0] < shape[0] and 0 <= cell[1] < shape[1] and 0 <= cell[2] < shape[2])


@compiled
def wholly_in_view(border_x: int, border_y: int, fx: float, fy: float, cell_m: float) -> float:
    """Depth from which on all of a cell is in view, that many pixels from the image's borders [m].

    A cell that the border cuts must not be carved: the part outside may hold the chair leg that was seen
    there a moment ago.
    """
    if border_x <= 0 or border_y <= 0:
        return math.inf
    return max(fx * cell_m / border_x, fy * cell_m / border_y)


@compiled
def return_worth(hit: int, cell_m: float, spread_m: float) -> int:
    """What a return counts: the probability that its surface lies in this cell, given the ray's noise."""
    return max(1, round(hit * math.erf(0.5 * cell_m / (max(spread_m, 1e-6) * 1.4142135623730951))))


@compiled
def add_return(marks: Any, touched: Any, count: int, index: int, worth: int, hit: int) -> int:
    """Mark a cell with a return, capped at one full hit a frame; returns the new count of touched cells."""
    if marks[index] == 0:
        touched[count] = index
        count += 1
    marks[index] = min(max(marks[index], 1) + worth, hit + 1)
    return count


@compiled
def cast(
    depth: Any,
    optics: Any,
    rotation: Any,
    eye: Any,
    cell_m: float,
    shape: Any,
    marks: Any,
    touched: Any,
    sampling: Any,
    ranges: Any,
    kinds: Any,
    hit: int,
) -> int:
    """Mark what one depth image says.

    Args:
        depth: (h, w) float32 along the optical axis [m], 0 = invalid.
        optics: fx, fy, cx, cy [px] and the noise at one metre: sigma_z = optics[4] * z^2 [1/m].
        rotation: (3, 3) camera FLU to the grid's axes.
        eye: (3,) camera in cells from the grid's lower corner.
        cell_m: Edge of a cell [m].
        shape: (3,) int, cells along x, y, z.
        marks: (nx*ny*nz,) int8, all 0; changed.
        touched: (nx*ny*nz,) int32, filled with the indices that were marked.
        sampling: stride [px], first row, first column.
        ranges: shortest and longest depth of the camera; longest marked and longest carved distance [m].
        kinds: (h, w) of the returns (`ground`).
        hit: Worth of one certain return.

    Returns:
        How many cells were touched.
    """
    h, w = depth.shape
    stride = sampling[0]
    fx, fy, cx, cy, sigma_1 = optics
    nearest, sensible, farthest, carve_m = ranges
    if not _inside(eye, shape):
        return 0
    count = 0
    start = np.empty(3)
    end = np.empty(3)
    direction = np.empty(3)
    for v in range(sampling[1], h, stride):
        for u in range(sampling[2], w, stride):
            z = depth[v, u]
            if not nearest <= z <= sensible:  # also NaN
                continue
            # Direction with unit length along the optical axis, in cells per metre of depth.
            left = -(u - cx) / fx
            up = -(v - cy) / fy
            for k in range(3):
                direction[k] = (rotation[k, 0] + rotation[k, 1] * left + rotation[k, 2] * up) / cell_m
            slant = math.sqrt(1.0 + left * left + up * up)
            distance = z * slant
            sigma_m = sigma_1 * z * z
            is_floor = kinds[v, u] != STANDS
            returns = distance <= farthest and not is_floor
            before_m = 0.0 if is_floor else max(0.5 * cell_m / slant, 2.0 * sigma_m)
            reach = min(carve_m / slant, max(0.0, z - before_m))
            begin = wholly_in_view(min(u, w - 1 - u), min(v, h - 1 - v), fx, fy, cell_m)
            if begin < reach:
                for k in range(3):
                    start[k] = eye[k] + direction[k] * begin
                    end[k] = eye[k] + direction[k] * reach
                count = _carve(marks, touched, count, shape, start, end)
            if returns:
                ix = math.floor(eye[0] + direction[0] * z)
                iy = math.floor(eye[1] + direction[1] * z)
                iz = math.floor(eye[2] + direction[2] * z)
                if _inside((ix, iy, iz), shape):
                    worth = return_worth(hit, cell_m, sigma_m * slant)
                    index = (ix * shape[1] + iy) * shape[2] + iz
                    count = add_return(marks, touched, count, index, worth, hit)
    return count


@compiled
def apply(log_odds: Any, marks: Any, touched: Any, count: int, miss: int, lowest: int, highest: int) -> None:
    """Move the frame's marks into the flat log-odds grid, clamped, and clear them.

    A mark is 0 for untouched, 1 for passed, else 1 more than what its returns are worth; `touched` holds the
    flat indices of the first `count` cells with one.
    """
    for i in range(count):
        index = touched[i]
        mark = marks[index]
        marks[index] = 0
        change = mark - 1 if mark > 1 else -miss
        log_odds[index] = min(max(log_odds[index] + change, lowest), highest)


def integrate(
    log_odds: Grid,
    marks: Grid,
    touched: Cells,
    depth: Image,
    *,
    optics: tuple[float, float, float, float, float],
    rotation: Array,
    eye: Array,
    cell_m: float,
    sampling: tuple[int, int, int],
    ranges: tuple[float, float, float, float],
    kinds: NDArray[np.uint8],
    weights: tuple[int, int, int, int],
) -> int:
    """Cast one image into `log_odds` (nx, ny, nz); see `cast` for the arguments.

    Args:
        log_odds: (nx, ny, nz) int8, C-contiguous; changed.
        marks: (nx*ny*nz,) int8 work space, all 0 before and after.
        touched: (nx*ny*nz,) int32 work space.
        depth: Image.
        optics: See `cast`.
        rotation: See `cast`.
        eye: See `cast`.
        cell_m: Edge of a cell [m].
        sampling: See `cast`.
        ranges: See `cast`.
        kinds: See `cast`.
        weights: hit, miss, lowest, highest log-odds, in the grid's units.

    Returns:
        How many cells were changed.
    """
    hit, miss, lowest, highest = weights
    nx, ny, nz = log_odds.shape
    count: int = cast(
        depth, optics, rotation, eye, cell_m, (nx, ny, nz), marks, touched, sampling, ranges, kinds, hit
    )
    apply(log_odds.reshape(-1), marks, touched, count, miss, lowest, highest)
    return count
