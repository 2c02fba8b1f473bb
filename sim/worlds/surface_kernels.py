"""Compiled geometry: exact distance from an upright cylinder to the triangles of a mesh."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

_TOLERANCE_M = 1e-6
_ROUNDS = 200


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _dot(a: Any, b: Any) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _minus(a: Any, b: Any) -> Any:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _along(a: Any, step: Any, share: float) -> Any:
    return a[0] + step[0] * share, a[1] + step[1] * share, a[2] + step[2] * share


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _closest_on_triangle(p: Any, a: Any, b: Any, c: Any) -> Any:
    """Closest point of triangle abc to p, by its Voronoi regions (Ericson 2005, section 5.1.5).

    Points are tuples of three: arrays would be allocated by the thousand.
    """
    ab, ac, ap = _minus(b, a), _minus(c, a), _minus(p, a)
    d1, d2 = _dot(ab, ap), _dot(ac, ap)
    if d1 <= 0.0 and d2 <= 0.0:
        return a
    bp = _minus(p, b)
    d3, d4 = _dot(ab, bp), _dot(ac, bp)
    if d3 >= 0.0 and d4 <= d3:
        return b
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return _along(a, ab, d1 / (d1 - d3)) if d1 > d3 else a
    cp = _minus(p, c)
    d5, d6 = _dot(ab, cp), _dot(ac, cp)
    if d6 >= 0.0 and d5 <= d6:
        return c
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return _along(a, ac, d2 / (d2 - d6)) if d2 > d6 else a
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 >= d3 and d5 >= d6:
        along = (d4 - d3) + (d5 - d6)
        return _along(b, _minus(c, b), (d4 - d3) / along) if along > 0.0 else b
    total = va + vb + vc
    return _along(_along(a, ab, vb / total), ac, vc / total)


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _clip(polygon: Any, count: int, z_m: float, sign: float, out: Any) -> int:
    """Part of a convex polygon with sign*(z - z_m) >= 0; returns its number of corners."""
    kept = 0
    for i in range(count):
        j = (i + 1) % count
        da, db = sign * (polygon[i, 2] - z_m), sign * (polygon[j, 2] - z_m)
        if da >= 0.0:
            for k in range(3):
                out[kept, k] = polygon[i, k]
            kept += 1
        if (da >= 0.0) != (db >= 0.0):
            for k in range(3):
                out[kept, k] = polygon[i, k] + (polygon[j, k] - polygon[i, k]) * (da / (da - db))
            kept += 1
    return kept


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _flat_distance(polygon: Any, count: int, x: float, y: float) -> float:
    """Horizontal distance from (x, y) to the outline of a convex polygon seen from above, 0 within."""
    best, within = math.inf, False
    for i in range(count):
        ax, ay = polygon[i, 0] - x, polygon[i, 1] - y
        bx, by = polygon[(i + 1) % count, 0] - x, polygon[(i + 1) % count, 1] - y
        if (ay > 0.0) != (by > 0.0) and ax + (bx - ax) * ay / (ay - by) > 0.0:
            within = not within
        ex, ey = bx - ax, by - ay
        length2 = ex * ex + ey * ey
        t = min(max(-(ax * ex + ay * ey) / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
        best = min(best, math.hypot(ax + t * ex, ay + t * ey))
    return 0.0 if within else best


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _separation(a: Any, b: Any, c: Any, axis: Any, radius: float, low: float, high: float) -> float:
    """Distance between a triangle and a cylinder that do not meet, by projecting to and fro (both convex)."""
    q = (axis[0], axis[1], 0.5 * (low + high))
    last = math.inf
    for _ in range(_ROUNDS):
        p = _closest_on_triangle(q, a, b, c)
        dx, dy = p[0] - axis[0], p[1] - axis[1]
        r = math.hypot(dx, dy)
        shrink = radius / r if r > radius else 1.0
        q = (axis[0] + dx * shrink, axis[1] + dy * shrink, min(max(p[2], low), high))
        gap = math.sqrt((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2)
        if last - gap < _TOLERANCE_M:
            return gap
        last = gap
    return last


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _corner(polygon: Any, i: int) -> Any:
    return polygon[i, 0], polygon[i, 1], polygon[i, 2]


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _triangle_clearance(
    triangle: Any, axis: Any, radius: float, low: float, high: float, cut: bool, one: Any, two: Any
) -> Any:
    """Clearance of one triangle; negative by how far the cylinder must move to be free."""
    count = _clip(triangle, 3, low, 1.0, one)
    inside = _clip(one, count, high, -1.0, two)
    if inside > 0:
        flat = _flat_distance(two, inside, axis[0], axis[1]) - radius
        if flat <= 0.0:
            bottom, top = two[0, 2], two[0, 2]
            for i in range(1, inside):
                bottom, top = min(bottom, two[i, 2]), max(top, two[i, 2])
            return max(flat, low - top, bottom - high)
    if not cut:
        a, b, c = _corner(triangle, 0), _corner(triangle, 1), _corner(triangle, 2)
        return _separation(a, b, c, axis, radius, low, high)
    best = math.inf
    for i in range(1, count - 1):
        a, b, c = _corner(one, 0), _corner(one, i), _corner(one, i + 1)
        best = min(best, _separation(a, b, c, axis, radius, low, high))
    return best


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _heights(bounds: Any, axis: Any, east: float, north: float) -> Any:
    """Bounds in z of a box, above a plane through the axis with these slopes."""
    if east == 0.0 and north == 0.0:
        return bounds[2], bounds[5]
    west_rise, east_rise = east * (bounds[0] - axis[0]), east * (bounds[3] - axis[0])
    south_rise, north_rise = north * (bounds[1] - axis[1]), north * (bounds[4] - axis[1])
    return (
        bounds[2] - max(west_rise, east_rise) - max(south_rise, north_rise),
        bounds[5] - min(west_rise, east_rise) - min(south_rise, north_rise),
    )


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def copied(corners: Any, out: Any) -> None:
    """A triangle in double precision: slices would be allocated by the thousand."""
    for i in range(3):
        for k in range(3):
            out[i, k] = corners[i, k]


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _sheared(corners: Any, axis: Any, east: float, north: float, out: Any) -> None:
    """A triangle with its heights taken above that plane; vertical walls stay vertical and in place."""
    copied(corners, out)
    for i in range(3):
        if east != 0.0 or north != 0.0:
            out[i, 2] -= east * (out[i, 0] - axis[0]) + north * (out[i, 1] - axis[1])


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def cylinder_clearance(
    triangles: NDArray[np.float32],
    boxes: Floats,
    starts: Ints,
    members: Ints,
    shape: tuple[int, int],
    corner: Floats,
    cell: float,
    axis: Floats,
    radius: float,
    low: float,
    high: float,
    cut: bool,
    reach: float,
    east: float,
    north: float,
) -> float:
    """Smallest clearance between an upright cylinder and all triangles [m], at most `reach`.

    Args:
        triangles: (m, 3, 3) float32 corners.
        boxes: (m, 6) bounds of each triangle: lower xyz, upper xyz.
        starts: (nx*ny + 1,) where each column's members begin.
        members: Triangle numbers by column of the xy grid.
        shape: (nx, ny) columns.
        corner: (2,) lower corner of the grid.
        cell: Width of a column [m].
        axis: (2,) position of the cylinder.
        radius: Its radius [m].
        low: Its lower end in z [m].
        high: Its upper end in z [m].
        cut: Whether parts of triangles below `low` are left out.
        reach: Largest clearance of interest [m].
        east: Slope of the floor, rise per metre in x; all heights are taken above the tilted plane.
        north: The same in y.
    """
    nx, ny = shape
    one, two, triangle = np.empty((6, 3)), np.empty((6, 3)), np.empty((3, 3))
    ix, iy = math.floor((axis[0] - corner[0]) / cell), math.floor((axis[1] - corner[1]) / cell)
    best = reach
    for ring in range(int((reach + radius) / cell) + 3):
        if (ring - 1) * cell - radius > best:
            break
        for i in range(max(ix - ring, 0), min(ix + ring, nx - 1) + 1):
            edge = i == ix - ring or i == ix + ring
            step = 1 if edge else max(2 * ring, 1)
            for j in range(iy - ring, iy + ring + 1, step):
                if j < 0 or j >= ny:
                    continue
                for k in range(starts[i * ny + j], starts[i * ny + j + 1]):
                    t = members[k]
                    bottom, top = _heights(boxes[t], axis, east, north)
                    if cut and top <= low:
                        continue
                    dx = max(boxes[t, 0] - axis[0], axis[0] - boxes[t, 3], 0.0)
                    dy = max(boxes[t, 1] - axis[1], axis[1] - boxes[t, 4], 0.0)
                    dz = max(bottom - high, low - top, 0.0)
                    side = math.hypot(dx, dy) - radius
                    bound = math.hypot(max(side, 0.0), dz) if side > 0.0 or dz > 0.0 else side
                    if bound >= best:
                        continue
                    _sheared(triangles[t], axis, east, north, triangle)
                    found = _triangle_clearance(triangle, axis, radius, low, high, cut, one, two)
                    best = min(best, found)
    return best


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def clear_of(
    triangles: NDArray[np.float32],
    boxes: Floats,
    starts: Ints,
    members: Ints,
    shape: tuple[int, int],
    corner: Floats,
    cell: float,
    axes: Floats,
    radius: float,
    lows: Floats,
    highs: Floats,
    cut: bool,
    margin: float,
    slopes: Floats,
) -> NDArray[np.bool_]:
    """Whether `cylinder_clearance` is at least `margin` for each cylinder, (n,).

    A radius of zero and equal ends ask for the distance of points. `slopes` (n, 2) are those of the floor.
    """
    nx, ny = shape
    one, two, triangle = np.empty((6, 3)), np.empty((6, 3)), np.empty((3, 3))
    out = np.ones(len(axes), np.bool_)
    reach = radius + margin
    for p in range(len(axes)):
        x, y, low, high = axes[p, 0], axes[p, 1], lows[p], highs[p]
        east, north = slopes[p, 0], slopes[p, 1]
        i0, i1 = math.floor((x - reach - corner[0]) / cell), math.floor((x + reach - corner[0]) / cell)
        j0, j1 = math.floor((y - reach - corner[1]) / cell), math.floor((y + reach - corner[1]) / cell)
        for i in range(max(i0, 0), min(i1, nx - 1) + 1):
            for j in range(max(j0, 0), min(j1, ny - 1) + 1):
                if not out[p]:
                    break
                for k in range(starts[i * ny + j], starts[i * ny + j + 1]):
                    t = members[k]
                    bottom, top = _heights(boxes[t], axes[p], east, north)
                    if top <= low - (0.0 if cut else margin) or bottom >= high + margin:
                        continue
                    dx = max(boxes[t, 0] - x, x - boxes[t, 3], 0.0)
                    dy = max(boxes[t, 1] - y, y - boxes[t, 4], 0.0)
                    if dx * dx + dy * dy >= reach * reach:
                        continue
                    _sheared(triangles[t], axes[p], east, north, triangle)
                    if radius == 0.0:
                        a, b, c = _corner(triangle, 0), _corner(triangle, 1), _corner(triangle, 2)
                        q = _closest_on_triangle((x, y, low), a, b, c)
                        gap = math.sqrt((q[0] - x) ** 2 + (q[1] - y) ** 2 + (q[2] - low) ** 2)
                    else:
                        gap = _triangle_clearance(triangle, axes[p], radius, low, high, cut, one, two)
                    if gap < margin:
                        out[p] = False
                        break
    return out


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def headrooms(
    triangles: NDArray[np.float32],
    boxes: Floats,
    starts: Ints,
    members: Ints,
    shape: tuple[int, int],
    corner: Floats,
    cell: float,
    axes: Floats,
    radius: float,
    lows: Floats,
) -> Floats:
    """Height up to which upright cylinders that begin at `lows` meet nothing, (n,) in z; inf under the sky.

    A slanted triangle counts from its lowest corner above the beginning on: never too high.
    """
    nx, ny = shape
    one, triangle = np.empty((6, 3)), np.empty((3, 3))
    out = np.empty(len(axes))
    for p in range(len(axes)):
        x, y, low = axes[p, 0], axes[p, 1], lows[p]
        best = math.inf
        i0, i1 = math.floor((x - radius - corner[0]) / cell), math.floor((x + radius - corner[0]) / cell)
        j0, j1 = math.floor((y - radius - corner[1]) / cell), math.floor((y + radius - corner[1]) / cell)
        for i in range(max(i0, 0), min(i1, nx - 1) + 1):
            for j in range(max(j0, 0), min(j1, ny - 1) + 1):
                for k in range(starts[i * ny + j], starts[i * ny + j + 1]):
                    t = members[k]
                    if boxes[t, 5] <= low or boxes[t, 2] >= best:
                        continue
                    dx = max(boxes[t, 0] - x, x - boxes[t, 3], 0.0)
                    dy = max(boxes[t, 1] - y, y - boxes[t, 4], 0.0)
                    if dx * dx + dy * dy >= radius * radius:
                        continue
                    copied(triangles[t], triangle)
                    count = _clip(triangle, 3, low, 1.0, one)
                    if count > 0 and _flat_distance(one, count, x, y) < radius:
                        best = min(best, one[:count, 2].min())
        out[p] = best
    return out
