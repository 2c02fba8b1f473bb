"""Key points where the camera would see them. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from labr_autonomy.frames import rotation_matrix

NEAR_M = 0.15  # points nearer to the camera than this are behind the picture's edge

Body = dict[str, Any]


def project(
    points: Sequence[Sequence[float | None]] | None, pose: Body | None, camera: Body, width: int, height: int
) -> list[list[float]]:
    """Pixels (u, v) of key points, and 1 where the point is flown to.

    Args:
        points: Rows x, y, z, air in odom; a row with null in it is left out.
        pose: `position_m` and `quaternion` (wxyz) of the body; nothing is seen without it or with null in it.
        camera: fx, fy, cx, cy [px] and x_m, z_m in body.
        width: Of the image [px].
        height: Of the image [px].
    """
    if not points or pose is None or None in (*pose["position_m"], *pose["quaternion"]):
        return []
    rotation = rotation_matrix(np.array(pose["quaternion"]))
    offset = np.array([camera["x_m"], 0.0, camera["z_m"]])
    seen = []
    for x, y, z, air in (row for row in points if None not in row):
        ahead, left, up = rotation.T @ (np.array([x, y, z]) - np.array(pose["position_m"])) - offset
        if ahead < NEAR_M:
            continue
        u = camera["cx"] - camera["fx"] * left / ahead
        v = camera["cy"] - camera["fy"] * up / ahead
        if -20.0 <= u <= width + 20.0 and -20.0 <= v <= height + 20.0:
            seen.append([round(float(u), 1), round(float(v), 1), int(bool(air))])
    return seen
