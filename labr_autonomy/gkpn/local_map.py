"""What a network may see besides the image: the robot's surroundings from above, in the level frame.

A square of the rolling map, turned to the robot's heading, most of it ahead. For each band of height above
the floor two channels: whether something solid stands in it, and whether it has been seen. So the network
knows what has left the camera's view.
"""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from labr_autonomy.frames import yaw_of
from labr_autonomy.perception.compiled import compiled
from labr_autonomy.perception.rolling_map import OCCUPIED, RollingMap
from labr_autonomy.types import Pose

SIDE = 64  # cells along an edge
CELL_M = 0.15
BEHIND_M = 2.4  # of the square lie behind the robot, the rest of its 9.6 m ahead
BANDS_M = ((0.06, 0.45), (0.45, 1.0), (1.0, 1.6), (1.6, 2.4))  # above the floor: driven, then flown in
CHANNELS = 2 * len(BANDS_M)
SHOWN = CHANNELS + len(BANDS_M)  # channels of `with_distances`
DISTANCE_MAX_M = 1.2  # of the distances beside the map; farther is as good as free
KNOWN_SHARE = 0.5  # of a band's cells that must have been seen

LocalMap = NDArray[np.uint8]  # (CHANNELS, SIDE, SIDE), 0 or 1: solid and seen of the first band, ...


@compiled
def _look(
    log_odds: Any, layers: Any, x0: float, y0: float, ahead: Any, left: Any, solid: int, out: Any
) -> None:
    """Fill `out` (2 b, n, n): row i lies i steps `ahead` of the first corner, column j j steps `left`."""
    nx, ny, _ = log_odds.shape
    n = out.shape[1]
    for i in range(n):
        for j in range(n):
            x = math.floor(x0 + i * ahead[0] + j * left[0])
            y = math.floor(y0 + i * ahead[1] + j * left[1])
            if x < 0 or y < 0 or x >= nx or y >= ny:
                continue
            for b in range(len(layers)):
                hit, seen = 0, 0
                for k in range(layers[b, 0], layers[b, 1]):
                    value = log_odds[x, y, k]
                    hit += value >= solid
                    seen += value < 0
                out[2 * b, i, j] = hit > 0
                out[2 * b + 1, i, j] = hit > 0 or seen >= KNOWN_SHARE * (layers[b, 1] - layers[b, 0])


def local_map(rolling: RollingMap, pose: Pose, floor_z_m: float) -> LocalMap:
    """The network's map around a robot.

    Args:
        rolling: What has been seen.
        pose: Body in odom.
        floor_z_m: Height of the floor below it, odom [m].
    """
    out = np.zeros((CHANNELS, SIDE, SIDE), np.uint8)
    if rolling.frames == 0:
        return out
    cell = rolling.cell_m
    base = (floor_z_m - float(rolling.origin_m[2])) / cell
    edges = np.round(base + np.array(BANDS_M) / cell).astype(np.int64)
    layers = np.clip(edges, 0, rolling.log_odds.shape[2])
    yaw = yaw_of(pose.quaternion)
    ahead = np.array([math.cos(yaw), math.sin(yaw)])
    left = np.array([-ahead[1], ahead[0]])
    corner = pose.position_m[:2] + ahead * (0.5 * CELL_M - BEHIND_M) - left * (0.5 * (SIDE - 1) * CELL_M)
    first = (corner - rolling.origin_m[:2]) / cell
    step = CELL_M / cell
    _look(
        rolling.log_odds, layers, float(first[0]), float(first[1]), ahead * step, left * step, OCCUPIED, out
    )
    return out


def with_distances(seen: NDArray[np.uint8]) -> NDArray[np.float32]:
    """The map's channels, and for each band how near the next solid cell is.

    Returns:
        (SHOWN, SIDE, SIDE): 0 or 1, then 1 in a solid cell, falling to 0 at `DISTANCE_MAX_M`.
    """
    out = np.zeros((SHOWN, SIDE, SIDE), np.float32)
    out[:CHANNELS] = seen
    for band in range(len(BANDS_M)):
        solid = seen[2 * band]
        if solid.any():
            away = cv2.distanceTransform(1 - solid, cv2.DIST_L2, cv2.DIST_MASK_5)
            out[CHANNELS + band] = np.maximum(1.0 - away * (CELL_M / DISTANCE_MAX_M), 0.0)
    return out
