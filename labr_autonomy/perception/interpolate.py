"""Compiled multilinear interpolation on a grid, between cell centres and clamped to the border."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from labr_autonomy.perception.compiled import compiled
from labr_autonomy.types import Array


@compiled
def _along(x: float, n: int) -> tuple[int, int, float]:
    """Cells on both sides of a place along one axis, and how far it lies towards the upper one."""
    x = min(max(x, 0.0), n - 1.0) if x == x else 0.0
    low = min(math.floor(x), max(n - 2, 0))
    return low, min(low + 1, n - 1), x - low


@compiled
def _in_plane(values: Any, origin_m: Any, cell_m: float, points_m: Any, out: Any) -> None:
    nx, ny = values.shape
    for k in range(len(points_m)):
        i, a, f = _along((points_m[k, 0] - origin_m[0]) / cell_m - 0.5, nx)
        j, b, g = _along((points_m[k, 1] - origin_m[1]) / cell_m - 0.5, ny)
        near = values[i, j] * (1.0 - g) + values[i, b] * g
        far = values[a, j] * (1.0 - g) + values[a, b] * g
        out[k] = near * (1.0 - f) + far * f


@compiled
def _in_space(values: Any, origin_m: Any, cell_m: float, points_m: Any, out: Any) -> None:
    nx, ny, nz = values.shape
    for k in range(len(points_m)):
        i, a, f = _along((points_m[k, 0] - origin_m[0]) / cell_m - 0.5, nx)
        j, b, g = _along((points_m[k, 1] - origin_m[1]) / cell_m - 0.5, ny)
        m, c, h = _along((points_m[k, 2] - origin_m[2]) / cell_m - 0.5, nz)
        total = 0.0
        for x, u in ((i, 1.0 - f), (a, f)):
            near = values[x, j, m] * (1.0 - h) + values[x, j, c] * h
            far = values[x, b, m] * (1.0 - h) + values[x, b, c] * h
            total += u * (near * (1.0 - g) + far * g)
        out[k] = total


def interpolated(values: Any, origin_m: Array, cell_m: float, points_m: Array) -> Array:
    """Values at points.

    Args:
        values: (nx, ny) or (nx, ny, nz) float32 at the cells' centres.
        origin_m: (2|3,) lower corner of the first cell.
        cell_m: Edge of a cell.
        points_m: (k, 2|3), same frame as the origin; NaN counts as the lower border.

    Returns:
        (k,) values.
    """
    points = np.ascontiguousarray(points_m, dtype=np.float64)
    out = np.empty(len(points))
    kernel = _in_plane if values.ndim == 2 else _in_space
    kernel(values, np.asarray(origin_m, dtype=np.float64), cell_m, points, out)
    return out
