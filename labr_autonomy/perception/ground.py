"""Which returns of a depth image are floor, on slopes and uneven ground as well.

Each image column is walked from its bottom upwards, away from the robot: what continues the floor found so
far, within a slope and a change of slope that wheels manage, is floor; what rises above it stands on it. A
step up a wall gains no distance and so is no floor, however small. (As the elevation scan of stereo
perception: no plane is assumed, and no normal, which the depth noise of 4 cm at 3 m would not allow.)

Frame: odom; metres.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.perception.compiled import compiled

NOTHING, FLOOR, STANDS, BELOW = 0, 1, 2, 3  # kinds of return
SLOPE_MAX = 0.36  # rise over run; 20 degrees
BASE_M = 0.035  # the floor may be this far from where it is expected ...
BEND = 0.12  # ... and per metre since it was last seen ...
LOOSE_M = 0.15  # ... but never more than this
ADVANCE_M = 0.05  # nearer than this to the last floor it must be as high as that
SLOPE_OVER_M = 0.25  # a slope is told by floors this far apart: nearer ones are noise
SETTLE = 0.5  # share of a new slope in the expected one


@compiled
def _scan(
    depth: Any,
    optics: Any,
    rotation: Any,
    eye: Any,
    floor_z: float,
    incline: Any,
    sampling: Any,
    kinds: Any,
    floors: Any,
) -> None:
    h, w = depth.shape
    fx, fy, cx, cy, sigma_1 = optics
    nearest, sensible, known = sampling[2], sampling[3], sampling[4]
    for u in range(int(sampling[1]), w, int(sampling[0])):
        left = -(u - cx) / fx
        at, height, slope = 0.0, floor_z, 0.0  # the last floor seen, along the column
        from_at, from_height = at, height  # and an earlier one
        fresh = True
        for v in range(h - 1, -1, -1):
            z = depth[v, u]
            if not nearest <= z <= sensible:  # also NaN
                continue
            up = -(v - cy) / fy
            dx = rotation[0, 0] + rotation[0, 1] * left + rotation[0, 2] * up
            dy = rotation[1, 0] + rotation[1, 1] * left + rotation[1, 2] * up
            dz = rotation[2, 0] + rotation[2, 1] * left + rotation[2, 2] * up
            flat = math.sqrt(dx * dx + dy * dy)
            if fresh and flat > 0.0:
                slope, fresh = (incline[0] * dx + incline[1] * dy) / flat, False
                at, height = known, height + slope * known
                from_at, from_height = at, height
            run = z * flat
            top = eye[2] + z * dz
            gone = run - at
            expected = height + slope * max(gone, 0.0)
            noise = 3.0 * sigma_1 * z * z * abs(dz)  # of heights: large for rays that fall steeply
            slack = min(BASE_M + BEND * max(gone, 0.0), LOOSE_M) + noise
            floors[v, u] = expected
            if top > expected + slack or (gone < ADVANCE_M and top > height + BASE_M + noise):
                kinds[v, u] = STANDS
            elif top < expected - slack:
                kinds[v, u] = BELOW
            else:
                kinds[v, u] = FLOOR
                floors[v, u] = top
                if gone >= ADVANCE_M:  # noise puts the farthest lowest: the noisier, the less it counts
                    at, height = run, expected + (top - expected) * BASE_M / (BASE_M + noise)
                if run - from_at >= SLOPE_OVER_M:
                    seen = min(max((top - from_height) / (run - from_at), -SLOPE_MAX), SLOPE_MAX)
                    slope += SETTLE * (seen - slope)
                    from_at, from_height = run, top


def scan(
    depth_m: NDArray[np.float32],
    optics: tuple[float, float, float, float, float],
    rotation: NDArray[np.float64],
    eye_m: NDArray[np.float64],
    floor_z_m: float,
    incline: tuple[float, float],
    *,
    stride: int,
    first: int,
    range_m: tuple[float, float],
    known_m: float = 0.0,
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Kinds of the returns of every `stride`-th column.

    Args:
        depth_m: (h, w) along the optical axis, 0 = invalid.
        optics: fx, fy, cx, cy [px] and the noise at one metre: sigma_z = optics[4] * z^2 [1/m].
        rotation: (3, 3) camera FLU to odom.
        eye_m: (3,) camera, odom.
        floor_z_m: Floor below the camera, odom.
        incline: Rise of the floor under the robot per metre along x and y of odom.
        stride: Every how many columns.
        first: First column.
        range_m: Shortest and longest depth that is believed.
        known_m: So far ahead of the camera the robot itself stands on the floor.

    Returns:
        (h, w) kind of each return, `NOTHING` where none was looked at, and (h, w) height of the floor there,
        odom: as seen, or as expected below what stands and above what lies lower.
    """
    kinds = np.zeros(depth_m.shape, np.uint8)
    floors = np.zeros(depth_m.shape, np.float32)
    _scan(
        depth_m,
        optics,
        rotation,
        eye_m,
        floor_z_m,
        incline,
        (stride, first, *range_m, known_m),
        kinds,
        floors,
    )
    return kinds, floors
