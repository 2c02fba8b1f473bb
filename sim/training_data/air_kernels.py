"""Compiled loops behind `fields`: exact distances near surfaces, and where free space goes on."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from labr_autonomy.perception.compiled import compiled
from sim.worlds.surface_kernels import _closest_on_triangle


@compiled
def near_distances(triangles: Any, origin: Any, cell: float, band: float, out: Any) -> None:
    """Lower `out` (nx, ny, nz) to the distance of each voxel's centre to the triangles, within `band`."""
    size = out.shape
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for t in range(len(triangles)):
        empty = False
        for k in range(3):
            least = min(triangles[t, 0, k], triangles[t, 1, k], triangles[t, 2, k])
            most = max(triangles[t, 0, k], triangles[t, 1, k], triangles[t, 2, k])
            low[k] = max(math.ceil((least - band - origin[k]) / cell - 0.5), 0)
            high[k] = min(math.floor((most + band - origin[k]) / cell - 0.5), size[k] - 1)
            empty = empty or low[k] > high[k]
        if empty:
            continue
        a = (float(triangles[t, 0, 0]), float(triangles[t, 0, 1]), float(triangles[t, 0, 2]))
        b = (float(triangles[t, 1, 0]), float(triangles[t, 1, 1]), float(triangles[t, 1, 2]))
        c = (float(triangles[t, 2, 0]), float(triangles[t, 2, 1]), float(triangles[t, 2, 2]))
        u0, u1, u2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        v0, v1, v2 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        n0, n1, n2 = u1 * v2 - u2 * v1, u2 * v0 - u0 * v2, u0 * v1 - u1 * v0
        length = math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
        if length > 0.0:
            n0, n1, n2 = n0 / length, n1 / length, n2 / length
        for i in range(low[0], high[0] + 1):
            x = origin[0] + (i + 0.5) * cell
            for j in range(low[1], high[1] + 1):
                y = origin[1] + (j + 0.5) * cell
                level = n0 * (x - a[0]) + n1 * (y - a[1]) - n2 * a[2]
                for k in range(low[2], high[2] + 1):
                    z = origin[2] + (k + 0.5) * cell
                    if abs(level + n2 * z) >= out[i, j, k]:  # to the plane alone it is farther
                        continue
                    q = _closest_on_triangle((x, y, z), a, b, c)
                    gap = math.sqrt((x - q[0]) ** 2 + (y - q[1]) ** 2 + (z - q[2]) ** 2)
                    out[i, j, k] = min(out[i, j, k], gap)


@compiled
def _joined(free: Any, distance: Any, cell: float, i: int, j: int, k: int) -> bool:
    """Whether one of the 26 voxels around is free and in plain sight."""
    nx, ny, nz = free.shape
    for a in range(max(i - 1, 0), min(i + 2, nx)):
        for b in range(max(j - 1, 0), min(j + 2, ny)):
            for c in range(max(k - 1, 0), min(k + 2, nz)):
                if free[a, b, c]:
                    step = cell * math.sqrt((a - i) ** 2 + (b - j) ** 2 + (c - k) ** 2)
                    if distance[i, j, k] + distance[a, b, c] > step * (1.0 + 1e-5):
                        return True
    return False


@compiled
def spread(free: Any, distance: Any, cell: float) -> Any:
    """Free voxels and those beside them, (nx, ny, nz), where no surface can lie between the two centres.

    The centre of a voxel is at least its distance away from any surface: when two neighbours' distances
    add up to more than the step between them, the step meets none.
    """
    nx, ny, nz = free.shape
    out = free.copy()
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                if not free[i, j, k]:
                    out[i, j, k] = _joined(free, distance, cell, i, j, k)
    return out
