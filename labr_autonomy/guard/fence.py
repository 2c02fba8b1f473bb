"""Where the robot may be: polygons and circles to stay in or out of, with height bands. Odom ENU, metres."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Zone:
    """One fence: a polygon, or a circle when `radius_m` is set (then `outline` holds its centre)."""

    outline: tuple[Point, ...]
    keep_in: bool
    z_low_m: float = -math.inf
    z_high_m: float = math.inf
    radius_m: float | None = None
    outset_m: float = 0.0  # radius of the outline that must obey, around the tested point
    below_m: float = 0.0  # and its extent below and above the point
    above_m: float = 0.0


def _edge_distance_m(p: Point, a: Point, b: Point) -> float:
    ax, ay, bx, by = *a, *b
    dx, dy = bx - ax, by - ay
    length2 = dx * dx + dy * dy
    t = 0.0 if length2 == 0.0 else max(0.0, min(1.0, ((p[0] - ax) * dx + (p[1] - ay) * dy) / length2))
    return math.hypot(p[0] - ax - t * dx, p[1] - ay - t * dy)


def _inside(p: Point, outline: Sequence[Point]) -> bool:
    """Even-odd rule."""
    inside = False
    for (ax, ay), (bx, by) in zip(outline, (*outline[1:], outline[0]), strict=True):
        if (ay > p[1]) != (by > p[1]) and p[0] < (bx - ax) * (p[1] - ay) / (by - ay) + ax:
            inside = not inside
    return inside


def signed_depth_m(zone: Zone, x_m: float, y_m: float) -> float:
    """Distance to the outline in the plane, positive inside [m]."""
    if zone.radius_m is not None:
        cx, cy = zone.outline[0]
        return zone.radius_m - math.hypot(x_m - cx, y_m - cy)
    edges = zip(zone.outline, (*zone.outline[1:], zone.outline[0]), strict=True)
    distance = min(_edge_distance_m((x_m, y_m), a, b) for a, b in edges)
    return distance if _inside((x_m, y_m), zone.outline) else -distance


def margin_m(zones: Sequence[Zone], x_m: float, y_m: float, z_m: float) -> float:
    """Room to the nearest fence at a point [m]; negative when a fence is broken, inf without fences.

    A keep-in zone binds everywhere: outside its height band the robot is outside the zone. A keep-out zone
    binds within its height band only.
    """
    room = math.inf
    for zone in zones:
        depth = signed_depth_m(zone, x_m, y_m)
        bottom, top = z_m - zone.below_m, z_m + zone.above_m
        if zone.keep_in:
            room = min(room, depth - zone.outset_m, bottom - zone.z_low_m, zone.z_high_m - top)
        else:
            room = min(room, max(-depth - zone.outset_m, bottom - zone.z_high_m, zone.z_low_m - top))
    return room
