"""Fences of a mission file: as zones for the guard, and whether the robot's outline fits at a place."""

from __future__ import annotations

import math
from collections.abc import Sequence

from labr_autonomy.guard.fence import Zone, signed_depth_m
from labr_autonomy.mission.schema import Fence, Mission

XY = tuple[float, float]
AREA_MIN_M2 = 1e-6


def zone(fence: Fence) -> Zone:
    """One fence as the guard wants it."""
    low, high = fence.z if fence.z is not None else (-math.inf, math.inf)
    if fence.circle is not None:
        centre = ((fence.circle.x, fence.circle.y),)
        return Zone(centre, fence.keep == "in", low, high, fence.circle.radius_m)
    return Zone(tuple(fence.polygon or ()), fence.keep == "in", low, high)


def zones(mission: Mission) -> tuple[Zone, ...]:
    """All fences of a mission."""
    return tuple(zone(fence) for fence in mission.fence)


def outline_margin_m(
    fence: Zone, x_m: float, y_m: float, bottom_z_m: float, top_z_m: float, radius_m: float
) -> float:
    """How far the outline of the robot is from breaking a fence [m]; negative when it breaks it.

    Args:
        fence: The region and whether it keeps in or out.
        x_m: Body in odom.
        y_m: Body in odom.
        bottom_z_m: Lowest point of the outline.
        top_z_m: Highest point of the outline.
        radius_m: Radius of the outline, an upright cylinder.
    """
    depth = signed_depth_m(fence, x_m, y_m)
    if fence.keep_in:
        return min(depth - radius_m, bottom_z_m - fence.z_low_m, fence.z_high_m - top_z_m)
    # beside it, below it or above it
    return max(-depth - radius_m, fence.z_low_m - top_z_m, bottom_z_m - fence.z_high_m)


def polygon_fault(corners: Sequence[XY]) -> str | None:
    """Why a polygon does not bound a region, or None."""
    edges = [(corners[i], corners[(i + 1) % len(corners)]) for i in range(len(corners))]
    count = len(edges)
    for i, (a, b) in enumerate(edges):
        if math.dist(a, b) < 1e-6:
            return f"corners {i + 1} and {(i + 1) % count + 1} are the same point"
    area = 0.5 * sum(ax * by - bx * ay for (ax, ay), (bx, by) in edges)
    for i in range(count):
        for j in range(i + 2, count):
            if (i, j) != (0, count - 1) and _cross(*edges[i], *edges[j]):
                return f"the edges after corners {i + 1} and {j + 1} cross"
    return "it has no area" if abs(area) < AREA_MIN_M2 else None


def _turn(a: XY, b: XY, c: XY) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _within(a: XY, b: XY, p: XY) -> bool:
    """Whether `p`, in line with a and b, lies between them."""
    return min(a[0], b[0]) <= p[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= p[1] <= max(a[1], b[1])


def _cross(a: XY, b: XY, c: XY, d: XY) -> bool:
    """Whether the segments ab and cd share a point."""
    t1, t2, t3, t4 = _turn(a, b, c), _turn(a, b, d), _turn(c, d, a), _turn(c, d, b)
    if t1 * t2 < 0.0 and t3 * t4 < 0.0:
        return True
    ends = ((t1, a, b, c), (t2, a, b, d), (t3, c, d, a), (t4, c, d, b))
    return any(t == 0.0 and _within(p, q, r) for t, p, q, r in ends)
