"""Compiled loops behind `free_space`: triangles into voxels and columns, floors to their neighbours."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from sim.worlds.surface_kernels import _clip, _closest_on_triangle, _flat_distance, copied

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Bits = NDArray[np.bool_]

_EDGE = 1e-7  # barycentric; a column on the edge of two triangles is met by both rather than by none


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def voxelise(triangles: Any, origin: Floats, cell: float, out: Bits) -> None:
    """Mark every voxel that a triangle passes through; voxels of `out` (nx, ny, nz) start at `origin`.

    A voxel counts when the triangle's plane cuts it and the triangle comes within half its diagonal of its
    centre: no more than the true set by slivers at the triangle's rim, never less.
    """
    size = np.array(out.shape)
    half_diagonal = 0.5 * math.sqrt(3.0) * cell
    a, b, c, p = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for t in range(len(triangles)):
        empty = False
        for k in range(3):
            a[k], b[k], c[k] = triangles[t, 0, k], triangles[t, 1, k], triangles[t, 2, k]
            low[k] = max(math.floor((min(a[k], b[k], c[k]) - origin[k]) / cell - 1e-6), 0)
            high[k] = min(math.floor((max(a[k], b[k], c[k]) - origin[k]) / cell + 1e-6), size[k] - 1)
            empty = empty or low[k] > high[k]
        if empty:
            continue
        at_a, at_b, at_c = (a[0], a[1], a[2]), (b[0], b[1], b[2]), (c[0], c[1], c[2])
        u, v = b - a, c - a
        n0, n1, n2 = u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]
        reach = 0.5 * cell * (abs(n0) + abs(n1) + abs(n2)) * (1.0 + 1e-6)
        for i in range(low[0], high[0] + 1):
            p[0] = origin[0] + (i + 0.5) * cell
            for j in range(low[1], high[1] + 1):
                p[1] = origin[1] + (j + 0.5) * cell
                k0, k1 = low[2], high[2]
                level = n0 * (p[0] - a[0]) + n1 * (p[1] - a[1])
                if abs(n2) > 1e-12:  # the plane cuts only a few voxels of this column
                    middle, span = a[2] - level / n2, reach / abs(n2)
                    k0 = max(k0, math.floor((middle - span - origin[2]) / cell - 0.5 - 1e-6))
                    k1 = min(k1, math.ceil((middle + span - origin[2]) / cell - 0.5 + 1e-6))
                elif abs(level) > reach:
                    continue
                for k in range(k0, k1 + 1):
                    if out[i, j, k]:
                        continue
                    p[2] = origin[2] + (k + 0.5) * cell
                    if abs(level + n2 * (p[2] - a[2])) > reach:
                        continue
                    q = _closest_on_triangle((p[0], p[1], p[2]), at_a, at_b, at_c)
                    gap = (p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2
                    if gap <= half_diagonal * half_diagonal * (1.0 + 1e-6):
                        out[i, j, k] = True


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def column_hits(
    triangles: Any, origin: Floats, cell: float, nx: int, ny: int, low: float, high: float
) -> tuple[Ints, Floats]:
    """Where vertical lines through the columns' centres meet the triangles between two heights.

    Returns:
        Column number i * ny + j and height of every hit, unordered, (m,) each.
    """
    count = 0
    columns, heights = np.empty(1024, np.int32), np.empty(1024)
    for t in range(len(triangles)):
        ax, ay, az = float(triangles[t, 0, 0]), float(triangles[t, 0, 1]), float(triangles[t, 0, 2])
        bx, by, bz = float(triangles[t, 1, 0]), float(triangles[t, 1, 1]), float(triangles[t, 1, 2])
        cx, cy, cz = float(triangles[t, 2, 0]), float(triangles[t, 2, 1]), float(triangles[t, 2, 2])
        if min(az, bz, cz) > high or max(az, bz, cz) < low:
            continue
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if abs(area) < 1e-10:  # upright
            continue
        i0 = max(math.ceil((min(ax, bx, cx) - origin[0]) / cell - 0.5 - 1e-6), 0)
        i1 = min(math.floor((max(ax, bx, cx) - origin[0]) / cell - 0.5 + 1e-6), nx - 1)
        j0 = max(math.ceil((min(ay, by, cy) - origin[1]) / cell - 0.5 - 1e-6), 0)
        j1 = min(math.floor((max(ay, by, cy) - origin[1]) / cell - 0.5 + 1e-6), ny - 1)
        for i in range(i0, i1 + 1):
            x = origin[0] + (i + 0.5) * cell
            for j in range(j0, j1 + 1):
                y = origin[1] + (j + 0.5) * cell
                v = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
                w = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
                if v < -_EDGE or w < -_EDGE or v + w > 1.0 + _EDGE:
                    continue
                z = az + v * (bz - az) + w * (cz - az)
                if z < low or z > high:
                    continue
                if count == len(columns):
                    more_columns, more_heights = np.empty(2 * count, np.int32), np.empty(2 * count)
                    more_columns[:count], more_heights[:count] = columns, heights
                    columns, heights = more_columns, more_heights
                columns[count], heights[count] = i * ny + j, z
                count += 1
    return columns[:count].copy(), heights[:count].copy()


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def at_height(starts: Ints, z_m: Floats, column: int, wanted_m: float, give_m: float) -> int:
    """The entry of a column nearest to a height, -1 when none is within `give_m`."""
    best, found = give_m + 1e-9, -1
    for k in range(starts[column], starts[column + 1]):
        gap = abs(z_m[k] - wanted_m)
        if gap <= best:
            best, found = gap, k
    return found


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def supported(
    starts: Ints,
    column: Ints,
    z_m: Floats,
    nx: int,
    ny: int,
    cell: float,
    reach: int,
    step: float,
    slope: float,
) -> tuple[Bits, Floats]:
    """Whether floor goes on all round at `reach` columns' distance and is no steeper than `slope`, (n,).

    Also its rise per metre in x and y, (n, 2), where it does.
    """
    out = np.zeros(len(z_m), np.bool_)
    rises = np.zeros((len(z_m), 2))
    around = np.empty((3, 3))
    for p in range(len(z_m)):
        i, j = column[p] // ny, column[p] % ny
        if i < reach or j < reach or i >= nx - reach or j >= ny - reach:
            continue
        whole = True
        for a in range(-1, 2):
            for b in range(-1, 2):
                if not whole:
                    break
                away = reach * cell * math.hypot(float(a), float(b))
                k = at_height(starts, z_m, (i + a * reach) * ny + j + b * reach, z_m[p], step + slope * away)
                if k < 0:
                    whole = False
                else:
                    around[a + 1, b + 1] = z_m[k]
        if whole:
            run = 2.0 * reach * cell
            gx, gy = (around[2, 1] - around[0, 1]) / run, (around[1, 2] - around[1, 0]) / run
            out[p] = math.hypot(gx, gy) <= slope * 1.001
            rises[p, 0], rises[p, 1] = gx, gy
    return out, rises


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def neighbours(
    starts: Ints, column: Ints, z_m: Floats, nx: int, ny: int, cell: float, step: float, slope: float
) -> Ints:
    """Entry beside every entry in the eight directions of `RING`, (n, 8); -1 where there is none."""
    out = np.full((len(z_m), 8), -1, np.int32)
    for p in range(len(z_m)):
        i, j = column[p] // ny, column[p] % ny
        d = -1
        for a in range(-1, 2):
            for b in range(-1, 2):
                if a == 0 and b == 0:
                    continue
                d += 1
                if 0 <= i + a < nx and 0 <= j + b < ny:
                    give = step + slope * cell * math.hypot(float(a), float(b))
                    out[p, d] = at_height(starts, z_m, (i + a) * ny + j + b, z_m[p], give)
    return out


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def floors_below(starts: Ints, z_m: Floats, columns: Ints, heights: Floats) -> NDArray[np.float32]:
    """Highest entry at or below each of `heights` (nz,) in `columns` (n,); NaN without one, (n, nz)."""
    out = np.full((len(columns), len(heights)), np.nan, np.float32)
    for p in range(len(columns)):
        c = columns[p]
        for k in range(len(heights)):
            best = -math.inf
            for m in range(starts[c], starts[c + 1]):
                if z_m[m] <= heights[k] and z_m[m] > best:
                    best = z_m[m]
            if best > -math.inf:
                out[p, k] = best
    return out


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def follow_floor(
    starts: Ints, z_m: Floats, nx: int, ny: int, cell: float, floor: float, step: float, slope: float
) -> Floats:
    """Floor heights (nx, ny) by spreading from the middle to columns within reach; NaN where it ends.

    In each column the highest surface within the step counts: what lies on a floor is driven over.
    """
    out = np.full((nx, ny), np.nan)
    queue = np.empty((nx * ny, 2), np.int64)
    tail = 0
    for i in range(nx // 2 - 1, nx // 2 + 1):
        for j in range(ny // 2 - 1, ny // 2 + 1):
            best = -math.inf
            for k in range(starts[i * ny + j], starts[i * ny + j + 1]):
                if abs(z_m[k] - floor) <= 2.0 * step and z_m[k] > best:
                    best = z_m[k]
            if best > -math.inf:
                out[i, j] = best
                queue[tail, 0], queue[tail, 1] = i, j
                tail += 1
    head = 0
    give = step + slope * cell
    while head < tail:
        i, j = queue[head, 0], queue[head, 1]
        head += 1
        for d in range(4):
            a = i + (1 if d == 0 else -1 if d == 1 else 0)
            b = j + (1 if d == 2 else -1 if d == 3 else 0)
            if a < 0 or b < 0 or a >= nx or b >= ny or not math.isnan(out[a, b]):
                continue
            best = -math.inf
            for k in range(starts[a * ny + b], starts[a * ny + b + 1]):
                if abs(z_m[k] - out[i, j]) <= give and z_m[k] > best:
                    best = z_m[k]
            if best > -math.inf:
                out[a, b] = best
                queue[tail, 0], queue[tail, 1] = a, b
                tail += 1
    return out


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def band_cells(
    triangles: Any, origin: Floats, cell: float, floors: Floats, above: float, top: float, out: Bits
) -> None:
    """Mark cells (nx, ny) that a triangle crosses between `above` and `top` over the cell's own floor."""
    nx, ny = out.shape
    one, two, triangle = np.empty((6, 3)), np.empty((6, 3)), np.empty((3, 3))
    half = 0.5 * cell
    near = half * (1.0 + 1e-6)  # a sheet between two cells marks both, a corner's sliver none
    lowest, highest = floors.min() + above, floors.max() + top
    for t in range(len(triangles)):
        ax, ay, az = float(triangles[t, 0, 0]), float(triangles[t, 0, 1]), float(triangles[t, 0, 2])
        bx, by, bz = float(triangles[t, 1, 0]), float(triangles[t, 1, 1]), float(triangles[t, 1, 2])
        cx, cy, cz = float(triangles[t, 2, 0]), float(triangles[t, 2, 1]), float(triangles[t, 2, 2])
        bottom, peak = min(az, bz, cz), max(az, bz, cz)
        if peak <= lowest or bottom >= highest:
            continue
        west, east, south, north = min(ax, bx, cx), max(ax, bx, cx), min(ay, by, cy), max(ay, by, cy)
        i0 = max(math.floor((west - origin[0]) / cell) - 1, 0)
        i1 = min(math.floor((east - origin[0]) / cell) + 1, nx - 1)
        j0 = max(math.floor((south - origin[1]) / cell) - 1, 0)
        j1 = min(math.floor((north - origin[1]) / cell) + 1, ny - 1)
        copied(triangles[t], triangle)
        for i in range(i0, i1 + 1):
            x = origin[0] + (i + 0.5) * cell
            if west > x + near or east < x - near:
                continue
            for j in range(j0, j1 + 1):
                y = origin[1] + (j + 0.5) * cell
                if out[i, j] or south > y + near or north < y - near:
                    continue
                low, high = floors[i, j] + above, floors[i, j] + top
                if peak <= low or bottom >= high:
                    continue
                count = _clip(triangle, 3, low, 1.0, one)
                inside = _clip(one, count, high, -1.0, two)
                if inside > 0 and _flat_distance(two, inside, x, y) <= near:
                    out[i, j] = True


RING = [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if (a, b) != (0, 0)]
