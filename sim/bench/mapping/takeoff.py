"""When the mapping method takes off: an air goal that is out of the sensor's sight (paper, section V-C).

"When encountering an air goal beyond the sensor coverage, mapping-based methods typically activate air
mode in advance." In sight is a goal inside the camera's frustum and range, with nothing occupied and
nothing unseen on the straight line to it.
"""

from __future__ import annotations

import math

import numpy as np

from labr_autonomy.config import Camera
from labr_autonomy.frames import rotation_matrix
from labr_autonomy.perception.rolling_map import RollingMap
from labr_autonomy.types import Array, Pose

CHECK_M = 0.05  # spacing along the line of sight
BLIND_M = 0.6  # in front of the camera the map cannot have seen all
GAP_M = 0.25  # an unseen stretch shorter than this is a gap between rays


def in_frustum(camera: Camera, pose: Pose, goal_m: Array) -> bool:
    """Whether the camera of a body at `pose` could see a place (3,) odom if nothing stood between."""
    place = rotation_matrix(pose.quaternion).T @ (np.asarray(goal_m, float) - pose.position_m)
    x, y, z = place - np.array([camera.x_m, 0.0, camera.z_m])
    if not camera.range_min_m <= x <= camera.range_max_m:
        return False
    u, v = camera.cx - camera.fx * y / x, camera.cy - camera.fy * z / x
    return bool(0.0 <= u < camera.width and 0.0 <= v < camera.height)


def line_seen(rolling: RollingMap, eye_m: Array, goal_m: Array) -> bool:
    """Whether the map has seen the straight line between two places (3,) odom, and seen it free."""
    away = np.asarray(goal_m, float) - eye_m
    distance = float(np.linalg.norm(away))
    arcs = np.arange(min(BLIND_M, distance), distance, CHECK_M)
    if not len(arcs):
        return True
    cells = np.floor((eye_m + arcs[:, None] * away / distance - rolling.origin_m) / rolling.cell_m).astype(
        int
    )
    if ((cells < 0) | (cells >= rolling.log_odds.shape)).any():
        return False
    at = tuple(cells.T)
    if rolling.occupied[at].any():
        return False
    run = 0
    for unseen in rolling.unknown[at]:
        run = run + 1 if unseen else 0
        if run * CHECK_M > GAP_M:
            return False
    return True


def in_sight(camera: Camera, rolling: RollingMap, pose: Pose, goal_m: Array) -> bool:
    """Whether an air goal is in view of the body at `pose`."""
    if not in_frustum(camera, pose, goal_m):
        return False
    eye = pose.position_m + rotation_matrix(pose.quaternion) @ np.array([camera.x_m, 0.0, camera.z_m])
    return line_seen(rolling, eye, goal_m)


def lift_off_m(camera: Camera, rolling: RollingMap, pose: Pose, goal_m: Array, in_air: bool) -> float:
    """Way to drive before taking off [m]: 0 with an air goal out of sight, else inf.

    Before the first image nothing is known, which is no reason to take off.
    """
    if not in_air or rolling.frames == 0 or in_sight(camera, rolling, pose, goal_m):
        return math.inf
    return 0.0
