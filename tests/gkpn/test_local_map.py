"""The network's map: what stands where, in the robot's own frame, whatever its heading."""

import math

import numpy as np
import pytest

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.gkpn.local_map import (
    BANDS_M,
    BEHIND_M,
    CELL_M,
    CHANNELS,
    DISTANCE_MAX_M,
    SIDE,
    local_map,
    with_distances,
)
from labr_autonomy.perception.rolling_map import HIGHEST, LOWEST, RollingMap
from labr_autonomy.types import Pose

HERE = np.array([1.0, -2.0, 0.62])
FLOOR_M = 0.5


def _map_with_a_post(ahead_m, left_m, low_m, high_m, yaw):
    """A map seen as free all over but for a post at a place of the level frame."""
    rolling = RollingMap(RobotConfig())
    rolling._follow(HERE, FLOOR_M)
    rolling.frames = 1
    rolling.log_odds[:] = LOWEST
    x = HERE[0] + ahead_m * math.cos(yaw) - left_m * math.sin(yaw)
    y = HERE[1] + ahead_m * math.sin(yaw) + left_m * math.cos(yaw)
    centres = [
        rolling.origin_m[axis] + (np.arange(rolling.log_odds.shape[axis]) + 0.5) * rolling.cell_m
        for axis in range(3)
    ]
    near = np.hypot(centres[0][:, None] - x, centres[1][None] - y) < 0.25
    tall = (centres[2] > FLOOR_M + low_m) & (centres[2] < FLOOR_M + high_m)
    rolling.log_odds[near[:, :, None] & tall] = HIGHEST
    return rolling


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.3, math.pi / 2])
@pytest.mark.parametrize(("ahead", "left", "band"), [(3.0, 1.0, 0), (-1.5, -2.0, 1), (6.0, 0.0, 3)])
def test_a_post_is_where_it_stands_seen_from_the_robot(yaw, ahead, left, band):
    low, high = BANDS_M[band]
    rolling = _map_with_a_post(ahead, left, low + 0.05, high - 0.05, yaw)
    seen = local_map(rolling, Pose(HERE, quaternion_from_rpy(0.0, 0.0, yaw)), FLOOR_M)
    assert seen.shape == (CHANNELS, SIDE, SIDE)
    for b in range(len(BANDS_M)):
        assert seen[2 * b + 1].all()  # all was seen
        assert seen[2 * b].any() == (b == band)
    i, j = np.nonzero(seen[2 * band])
    assert (i.mean() + 0.5) * CELL_M - BEHIND_M == pytest.approx(ahead, abs=0.1)
    assert (j.mean() + 0.5 - 0.5 * SIDE) * CELL_M == pytest.approx(left, abs=0.1)


def test_what_has_not_been_seen_is_neither_solid_nor_seen():
    rolling = RollingMap(RobotConfig())
    level = Pose(HERE, quaternion_from_rpy(0.0, 0.0, 0.0))
    assert not local_map(rolling, level, FLOOR_M).any()  # before the first image
    rolling._follow(HERE, FLOOR_M)
    rolling.frames = 1
    assert not local_map(rolling, level, FLOOR_M).any()


def test_the_distances_fall_from_one_at_something_solid_to_nothing_far_away():
    seen = np.zeros((CHANNELS, SIDE, SIDE), np.uint8)
    seen[2, 10, 20] = 1  # in the second band
    shown = with_distances(seen)
    assert (shown[:CHANNELS] == seen).all()
    near = shown[CHANNELS + 1]
    assert near[10, 20] == 1.0
    assert near[10, 24] == pytest.approx(1.0 - 4 * CELL_M / DISTANCE_MAX_M, abs=0.01)
    assert near[10, 40] == 0.0
    assert not shown[CHANNELS].any()  # nothing stands in the first band: all is free there
    assert not shown[CHANNELS + 2 :].any()
