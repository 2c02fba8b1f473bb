"""Where a drive to a goal in the air ends."""

from __future__ import annotations

import math

import numpy as np
import pytest

from labr_autonomy.config import RobotConfig
from labr_autonomy.modes.energy import EnergyModel
from labr_autonomy.perception.fields import Field2
from labr_autonomy.planner.refusals import WAITS_S, Refusals
from labr_autonomy.planner.take_off import NEAR_GOAL_M, SPARE_M, offers_by_air
from labr_autonomy.refine.search import CostToGo

ENERGY = EnergyModel.of(RobotConfig())
WORTH = ENERGY.air_j(1.0) / ENERGY.land_j(1.0)
SIDE_M, CELL_M, RADIUS_M = 16.0, 0.1, 0.5


def plan(*boxes):
    """A square with solid boxes (x0, y0, x1, y1)."""
    n = round(SIDE_M / CELL_M)
    occupied = np.zeros((n, n), bool)
    for box in boxes:
        x0, y0, x1, y1 = np.round(np.array(box) / CELL_M).astype(int)
        occupied[x0:x1, y0:y1] = True
    return Field2.from_occupied(occupied, np.ones_like(occupied), np.zeros(2), CELL_M)


def end_of_drive(land, air, column, goal, start, refused=()):
    goal = np.array([*goal, 1.5])
    ways = CostToGo(air, goal[:2], 0.35)
    no_room = Refusals(0.4)
    for place in refused:
        no_room.step(True, np.array(place), 0.0)
        no_room.step(True, np.array(place), WAITS_S + 0.1)
    offers = offers_by_air(land, ways, column, RADIUS_M, goal, ENERGY, no_room)
    return CostToGo(land, goal[:2], 0.35, offers=offers).end(np.array(start)), offers


def test_on_free_floor_it_drives_until_it_is_below_the_goal():
    free = plan()
    end, _ = end_of_drive(free, free, free, (10.0, 8.0), (3.0, 8.0))
    assert end == pytest.approx([10.0, 8.0], abs=0.11)


def test_a_place_that_was_refused_is_not_driven_to_again():
    free = plan()
    end, _ = end_of_drive(free, free, free, (10.0, 8.0), (3.0, 8.0), refused=[(10.0, 8.0)])
    assert 0.4 < np.hypot(*(end - [10.0, 8.0])) < 0.6


def test_a_place_with_more_room_is_worth_a_little_way():
    """It stops beside the place, not on it."""
    lamp = plan((10.5, 7.5, 10.6, 8.5))
    end, _ = end_of_drive(plan(), plan(), lamp, (10.0, 8.0), (3.0, 8.0))
    assert lamp.lookup(end[None])[0] > RADIUS_M + SPARE_M - 0.02


def test_it_flies_over_what_only_the_wheels_cannot_pass_as_far_as_that_saves_joules():
    bed = plan((8.0, 6.0, 12.0, 10.0))
    end, _ = end_of_drive(bed, plan(), plan(), (10.0, 8.0), (3.0, 8.0))
    gap_m = math.dist(end, (10.0, 8.0))
    assert 2.2 < gap_m < 2.6  # beside the bed, as near as its outline allows
    assert end[0] < 8.0  # on its own side: round the bed costs more than it saves


def test_a_wall_in_the_air_as_well_makes_it_drive_round():
    wall = plan((8.0, 2.0, 8.2, 16.0))
    end, _ = end_of_drive(wall, wall, plan(), (10.0, 8.0), (5.0, 8.0))
    assert end == pytest.approx([10.0, 8.0], abs=0.11)


def test_a_take_off_needs_room():
    low_ceiling = plan((9.0, 7.0, 11.0, 9.0))
    end, offers = end_of_drive(plan(), plan(), low_ceiling, (10.0, 8.0), (3.0, 8.0))
    assert 8.3 < end[0] < 8.6
    assert low_ceiling.lookup(end[None])[0] > RADIUS_M
    assert np.isinf(offers[100, 80])


def test_the_price_is_that_of_the_energy_and_nothing_is_offered_far_away():
    free = plan()
    _, offers = end_of_drive(free, free, free, (10.0, 8.0), (3.0, 8.0))
    assert offers[80, 80] == pytest.approx(2.0 * WORTH, rel=0.06)
    away = np.hypot(*(np.argwhere(np.isfinite(offers)) * CELL_M + 0.05 - [10.0, 8.0]).T)
    assert away.max() <= NEAR_GOAL_M + CELL_M
