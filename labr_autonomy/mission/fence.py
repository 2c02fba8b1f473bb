"""Whether a fence of a mission file bounds a region at all."""

from __future__ import annotations

import math
from collections.abc import Sequence

XY = tuple[float, float]
AREA_MIN_M2 = 1e-6


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
    if max(a[0], b[0]) < min(c[0], d[0]) or max(c[0], d[0]) < min(a[0], b[0]):
        return False
    t1, t2, t3, t4 = _turn(a, b, c), _turn(a, b, d), _turn(c, d, a), _turn(c, d, b)
    if t1 * t2 < 0.0 and t3 * t4 < 0.0:
        return True
    ends = ((t1, a, b, c), (t2, a, b, d), (t3, c, d, a), (t4, c, d, b))
    return any(t == 0.0 and _within(p, q, r) for t, p, q, r in ends)
