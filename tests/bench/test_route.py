"""The oracle's route against closed forms."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from analytic_worlds import (
    ROBOT,
    detour,
    low_wall,
    ramp_world,
    rooms_of,
    router_of,
    standing_at,
    table_world,
    two_rooms,
)

from labr_autonomy.modes.energy import EnergyModel
from labr_autonomy.types import Mode

ENERGY = EnergyModel.of(ROBOT)


@pytest.fixture(scope="module")
def rooms():
    return router_of(rooms_of(two_rooms()))


def modes(route):
    return [leg.mode for leg in route.legs]


def test_straight_ahead_the_route_is_straight(rooms):
    route = rooms.route(standing_at(-5.0, -2.0), standing_at(-1.0, 1.0))
    assert modes(route) == [Mode.LAND]
    assert route.land_m == pytest.approx(5.0, rel=0.01)
    assert route.bound_j == pytest.approx(ENERGY.land_j(route.land_m))
    assert route.bound_s == pytest.approx(route.land_m / ROBOT.land.speed_mps)


def test_through_a_door_it_is_a_few_percent_longer_than_the_taut_string(rooms):
    start, goal = standing_at(-4.0, -1.5), standing_at(4.0, -1.5)
    route = rooms.route(start, goal)
    sill = 1.0 + 0.35  # the door's lower edge and the outline with its margin
    taut = 2.0 * math.hypot(3.9, sill + 1.5) + 0.2
    assert taut * 0.99 < route.land_m < taut * 1.04
    assert taut * 0.99 < rooms.shortest_m(start, goal) < taut * 1.03


def test_the_route_keeps_its_distance_where_there_is_room(rooms):
    route = rooms.route(standing_at(-4.0, -1.5), standing_at(4.0, -1.5))
    points = route.legs[0].points_m
    fine = np.concatenate([a + np.linspace(0, 1, 40)[:, None] * (b - a) for a, b in pairwise(points)])
    surface = rooms._free.surface
    assert min(surface.clearance(p, on_floor=True) for p in fine) > 0.04


def test_over_a_wall_it_takes_off_and_lands(rooms):
    router = router_of(rooms_of(low_wall()))
    route = router.route(standing_at(-3.0, 0.0), standing_at(3.0, 0.0))
    assert modes(route) == [Mode.LAND, Mode.AIR, Mode.LAND]
    assert route.switches == 2
    expected = ENERGY.land_j(route.land_m) + ENERGY.air_j(route.air_m, route.climb_m) + ENERGY.transition_j()
    assert route.bound_j == pytest.approx(expected)
    # lands and lifts off no nearer to the wall than the ring needs
    assert 0.9 <= route.air_m < 1.7
    assert route.land_m + route.air_m == pytest.approx(6.0, abs=0.4)
    highest = max(leg.points_m[:, 2].max() for leg in route.legs)
    assert 1.0 + math.hypot(0.3, 0.14) < highest < 1.75


@pytest.mark.parametrize(("end_m", "flies"), [(17.0, False), (23.0, True)])
def test_it_flies_where_the_detour_is_longer_than_the_closed_form_says(end_m, flies):
    hop_m, climb_m = 1.3, 1.4
    worth_m = ENERGY.detour_worth_flying_m(hop_m, climb_m) + hop_m
    straight_m = 2.0
    around_m = 2.0 * math.hypot(0.9, end_m + 0.35) + 0.2
    assert (around_m - straight_m > worth_m) is flies  # 33 and 45 m about 39 m: what the test is for
    router = router_of(rooms_of(detour(end_m)))
    route = router.route(standing_at(-1.0, 0.0), standing_at(1.0, 0.0))
    assert (Mode.AIR in modes(route)) is flies
    if not flies:
        assert route.land_m == pytest.approx(around_m, rel=0.04)
    assert router.shortest_m(standing_at(-1.0, 0.0), standing_at(1.0, 0.0)) < 5.5


def test_to_a_goal_in_the_air_it_drives_first_and_ends_flying(rooms):
    route = rooms.route(standing_at(-5.0, 0.0), np.array([-1.5, 0.0, 1.5]), goal_in_air=True)
    assert modes(route) == [Mode.LAND, Mode.AIR]
    assert route.air_m < 0.3
    assert route.land_m == pytest.approx(3.5, abs=0.2)
    assert route.legs[-1].points_m[-1] == pytest.approx([-1.5, 0.0, 1.5])
    half = 0.5 * ENERGY.transition_j()
    climb = ENERGY.air_j(0.0, route.climb_m)
    assert route.bound_j == pytest.approx(
        ENERGY.land_j(route.land_m) + ENERGY.air_j(route.air_m) + climb + half
    )
    assert route.climb_m == pytest.approx(1.38, abs=0.15)


def test_from_the_air_it_lands(rooms):
    route = rooms.route(np.array([-4.0, 0.0, 1.2]), standing_at(-1.0, 0.0), start_in_air=True)
    assert modes(route) == [Mode.AIR, Mode.LAND]
    assert route.land_m > 2.5


def test_up_a_ramp_it_drives_the_slope():
    route = router_of(ramp_world()).route(standing_at(-2.0, 0.0), standing_at(14.0, 0.0, 1.0))
    assert modes(route) == [Mode.LAND]
    assert route.land_m == pytest.approx(6.0 + math.hypot(10.0, 1.0), rel=0.02)
    assert route.legs[0].points_m[-1, 2] == pytest.approx(1.12)


def test_under_a_table_it_drives_straight():
    route = router_of(table_world()).route(standing_at(-3.0, 0.0), standing_at(3.0, 0.0))
    assert modes(route) == [Mode.LAND]
    assert route.land_m == pytest.approx(6.0, rel=0.01)


def test_a_take_off_with_more_room_than_there_is_is_not_taken():
    router = router_of(table_world())
    start, goal = standing_at(0.0, 0.0), np.array([2.8, 0.0, 1.2])
    low = router.route(start, goal, goal_in_air=True, lift_to_m=1.2)
    assert modes(low) == [Mode.LAND, Mode.AIR]
    assert low.legs[0].points_m[-1, 0] > 1.2 + 0.45 - 0.1  # clear of the table's edge and the landing ring


def test_there_is_no_way_out_of_a_closed_room_or_into_a_wall(rooms):
    assert rooms.route(standing_at(-5.0, 0.0), standing_at(9.0, 0.0)) is None
    assert rooms.route(standing_at(-5.0, 0.0), standing_at(0.0, -2.0)) is None
    assert rooms.shortest_m(standing_at(-5.0, 0.0), standing_at(0.0, -2.0)) == math.inf
