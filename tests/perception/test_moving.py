"""Who walks about is noticed and kept away from; who stands, is thin, or drifts with the pose is not."""

from __future__ import annotations

import numpy as np
import pytest
from floor_scenes import BELOW_M, CONFIG, LEVEL, OPTICS, box, clear, seen, standing

from labr_autonomy.perception.moving import HOLD_S
from labr_autonomy.perception.rolling_map import RollingMap
from labr_autonomy.types import DepthFrame

PERIOD_S = 0.1
EMPTY_FRAMES = 18  # until the floor ahead is surely free


def watched(frames, at=None):
    """The map after images of what each frame holds."""
    grid, rng = RollingMap(CONFIG), np.random.default_rng(0)
    at = at or standing()
    for k, things in enumerate(frames):
        image = seen([LEVEL, *things], at, rng)
        grid.update(DepthFrame(k, k * PERIOD_S, image, OPTICS), at, float(at.position_m[2]) - BELOW_M)
        grid.clear_robot(at)
    return grid


def person(x, y):
    return box([x - 0.2, y - 0.25, 0.0], [x + 0.2, y + 0.25, 1.75])


def walking(speed_mps, frames):
    return [[person(1.8, 1.6 - speed_mps * PERIOD_S * k)] for k in range(frames)]


@pytest.mark.parametrize("speed_mps", [0.7, 1.5])
def test_a_person_who_crosses_is_given_room(speed_mps):
    grid = watched([[]] * EMPTY_FRAMES + walking(speed_mps, 8))
    y = 1.6 - speed_mps * PERIOD_S * 7
    assert len(grid.driving.moving.places_m)
    room, drawn = grid.land_room(standing(), 0.0, 3.0), grid.land_field(standing(), 0.0)
    front = y - 0.25
    assert clear(drawn, 1.6, front - 0.3) > 0.2
    assert clear(room, 1.6, front - 0.3) < 0.0  # where they walk to


def test_the_room_is_given_back_when_they_have_gone():
    grid = watched([[]] * EMPTY_FRAMES + walking(1.5, 6) + [[]] * (round(HOLD_S / PERIOD_S) + 25))
    assert not len(grid.driving.moving.places_m)
    assert clear(grid.land_room(standing(), 0.0, 3.0), 1.2) > 0.4


def test_what_always_stood_there_does_not_move():
    grid = watched([[person(1.8, 0.4)]] * 20)
    assert not len(grid.driving.moving.places_m)


def test_a_thin_leg_that_comes_to_be_seen_does_not_move():
    leg = box([1.8, 0.0, 0.0], [1.84, 0.04, 0.7])
    grid = watched([[]] * EMPTY_FRAMES + [[leg]] * 5)
    assert not len(grid.driving.moving.places_m)


def test_a_wall_that_the_pose_drifts_against_does_not_move():
    walls = [[box([1.8 - 0.01 * k, -2.0, 0.0], [2.0, 2.0, 1.5])] for k in range(12)]
    grid = watched([[box([1.8, -2.0, 0.0], [2.0, 2.0, 1.5])]] * EMPTY_FRAMES + walls)
    assert not len(grid.driving.moving.places_m)


def test_walls_that_come_into_view_from_afar_do_not_move():
    """Far returns scatter over floor that was surely free: a wall is not a body for that."""
    wall, grid, rng = box([7.0, -6.0, 0.0], [7.2, 6.0, 2.0]), RollingMap(CONFIG), np.random.default_rng(1)
    count = 0
    for k in range(40):
        at = standing(x=0.08 * k)
        grid.update(DepthFrame(k, k * PERIOD_S, seen([LEVEL, wall], at, rng), OPTICS), at, 0.0)
        count += len(grid.driving.moving.places_m)
    assert count == 0
