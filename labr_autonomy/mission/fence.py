"""Geometry of fences: how far a point is inside what it may not leave or outside what it may not enter.

Plain arithmetic on tuples: cheap enough for every tick and free of imports.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from labr_autonomy.mission.schema import Fence

XY = tuple[float, float]
AREA_MIN_M2 = 1e-6


def region_distance_m(fence: Fence, x_m: float, y_m: float) -> float:
    """Distance from (x, y) to the region's edge in the plane [m]; positive outside, negative inside."""
    if fence.circle is not None:
        return math.hypot(x_m - fence.circle.x, y_m - fence.circle.y) - fence.circle.radius_m
    corners = fence.polygon or []
    edge = min(_segment_distance_m((x_m, y_m), a, b) for a, b in _edges(corners))
    return -edge if contains(corners, x_m, y_m) else edge


def contains(corners: Sequence[XY], x_m: float, y_m: float) -> bool:
    """Whether the polygon holds the point (even-odd rule)."""
    inside = False
    for (ax, ay), (bx, by) in _edges(corners):
        if (ay > y_m) != (by > y_m) and x_m < ax + (y_m - ay) / (by - ay) * (bx - ax):
            inside = not inside
    return inside


def margin_m(
    fence: Fence, x_m: float, y_m: float, bottom_z_m: float, top_z_m: float, radius_m: float
) -> float:
    """How far the outline of the robot is from breaking the fence [m]; negative when it breaks it.

    Args:
        fence: The region and whether it keeps in or out.
        x_m: Body in odom.
        y_m: Body in odom.
        bottom_z_m: Lowest point of the outline.
        top_z_m: Highest point of the outline.
        radius_m: Radius of the outline, an upright cylinder.
    """
    distance = region_distance_m(fence, x_m, y_m)
    if fence.keep == "in":
        plane = -distance - radius_m
        if fence.z is None:
            return plane
        return min(plane, bottom_z_m - fence.z[0], fence.z[1] - top_z_m)
    plane = distance - radius_m
    if fence.z is None:
        return plane
    return max(plane, fence.z[0] - top_z_m, bottom_z_m - fence.z[1])  # beside it, below it or above it


def polygon_fault(corners: Sequence[XY]) -> str | None:
    """Why a polygon does not bound a region, or None."""
    for i, (a, b) in enumerate(_edges(corners)):
        if math.dist(a, b) < 1e-6:
            return f"corners {i + 1} and {(i + 1) % len(corners) + 1} are the same point"
    edges = list(_edges(corners))
    count = len(edges)
    for i in range(count):
        for j in range(i + 2, count):
            if (i, j) != (0, count - 1) and _cross(*edges[i], *edges[j]):
                return f"the edges after corners {i + 1} and {j + 1} cross"
    area = 0.5 * sum(ax * by - bx * ay for (ax, ay), (bx, by) in edges)
    return "it has no area" if abs(area) < AREA_MIN_M2 else None


def _edges(corners: Sequence[XY]) -> list[tuple[XY, XY]]:
    return [(corners[i], corners[(i + 1) % len(corners)]) for i in range(len(corners))]


def _segment_distance_m(p: XY, a: XY, b: XY) -> float:
    dx, dy = b[0] - a[0], b[1] - a[1]
    square = dx * dx + dy * dy
    t = 0.0 if square == 0.0 else min(1.0, max(0.0, ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / square))
    return math.hypot(p[0] - a[0] - t * dx, p[1] - a[1] - t * dy)


def _turn(a: XY, b: XY, c: XY) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _cross(a: XY, b: XY, c: XY, d: XY) -> bool:
    """Whether the segments ab and cd share a point."""
    t1, t2, t3, t4 = _turn(a, b, c), _turn(a, b, d), _turn(c, d, a), _turn(c, d, b)
    if t1 * t2 < 0.0 and t3 * t4 < 0.0:
        return True
    between = ((t1, a, b, c), (t2, a, b, d), (t3, c, d, a), (t4, c, d, b))
    return any(t == 0.0 and _segment_distance_m(r, p, q) == 0.0 for t, p, q, r in between)
