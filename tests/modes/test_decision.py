"""Drive while it saves energy, fly when it does not, and never chatter."""

import numpy as np
import pytest

from labr_autonomy.config import RobotConfig
from labr_autonomy.modes import decision
from labr_autonomy.modes.decision import (
    CONFIRM_S,
    DWELL_S,
    Facts,
    State,
    classify,
    lift_off_distance_m,
    step,
    wish,
)
from labr_autonomy.modes.energy import EnergyModel
from labr_autonomy.types import Mode

ENERGY = EnergyModel.of(RobotConfig())


def facts(**changes):
    base = {
        "mode": Mode.LAND,
        "goal_in_air": True,
        "goal_distance_xy_m": 6.0,
        "lift_off_m": 5.0,
        "land_path_ends": False,
        "take_off_clear": True,
        "landing_clear": True,
    }
    return Facts(**(base | changes))


def test_an_air_goal_far_away_is_first_driven_to():
    assert wish(facts(), ENERGY) is Mode.LAND


def test_it_takes_off_close_to_the_goal():
    assert wish(facts(lift_off_m=0.2, goal_distance_xy_m=0.5), ENERGY) is Mode.AIR


def test_it_rolls_to_the_end_of_its_way_before_it_takes_off():
    near = {"lift_off_m": 0.3, "land_path_ends": True}
    assert wish(facts(**near, speed_mps=0.5), ENERGY) is Mode.LAND
    assert wish(facts(**near, speed_mps=0.2), ENERGY) is Mode.AIR
    assert wish(facts(lift_off_m=0.0, land_path_ends=True, speed_mps=0.5), ENERGY) is Mode.AIR


def test_it_does_not_take_off_without_room():
    assert wish(facts(lift_off_m=0.2, take_off_clear=False), ENERGY) is Mode.LAND


def test_a_blocked_way_on_land_is_left_by_air():
    assert wish(facts(land_path_ends=True), ENERGY) is Mode.AIR


def test_a_land_goal_brings_it_down_where_there_is_room():
    assert wish(facts(mode=Mode.AIR, goal_in_air=False), ENERGY) is Mode.LAND
    assert wish(facts(mode=Mode.AIR, goal_in_air=False, landing_clear=False), ENERGY) is Mode.AIR


def test_chatter_at_the_threshold_switches_at_most_once_in_ten_seconds():
    state, mode, switches = State(), Mode.LAND, 0
    for k in range(500):
        near = k % 2 == 0
        state, wanted = step(
            state, facts(mode=mode, lift_off_m=0.2 if near else 0.6), ENERGY, 10.0 + 0.02 * k
        )
        switches += wanted is not mode
        mode = wanted
    assert switches <= 1


def test_a_steady_wish_switches_after_the_confirmation_time():
    state, wanted = step(State(), facts(lift_off_m=0.0), ENERGY, 50.0)
    assert wanted is Mode.LAND
    state, wanted = step(state, facts(lift_off_m=0.0), ENERGY, 50.0 + CONFIRM_S + 0.01)
    assert wanted is Mode.AIR
    _, wanted = step(state, facts(mode=Mode.AIR, goal_in_air=False), ENERGY, 50.0 + CONFIRM_S + DWELL_S / 2)
    assert wanted is Mode.AIR


def test_lift_off_distance_is_the_length_of_the_land_part():
    points = np.array([[1.0, 0, 0.12], [2.0, 0, 0.12], [3.0, 0, 0.2], [4.0, 0, 0.9], [5.0, 0, 1.6]])
    air = classify(points, 0.12)
    assert list(air) == [False, False, False, True, True]
    assert lift_off_distance_m(np.zeros(3), points, air) == pytest.approx(3.0)
    assert lift_off_distance_m(np.zeros(3), points, np.zeros(5, bool)) == float("inf")
    assert lift_off_distance_m(np.zeros(3), points, np.ones(5, bool)) == 0.0


def test_closed_form_threshold_balances_both_ways():
    detour_m = ENERGY.detour_worth_flying_m(air_m=2.0, climb_m=1.0)
    assert ENERGY.land_j(detour_m) == pytest.approx(ENERGY.transition_j() + ENERGY.air_j(2.0, 1.0))


def test_driving_costs_about_a_tenth_of_flying_for_the_same_time():
    assert 5.0 < ENERGY.air_w / ENERGY.land_w < 15.0
    assert decision.SAVING_MIN_J > 0


def test_a_planned_hop_leaves_the_floor_for_a_goal_on_it_and_comes_down_where_it_ends():
    on_land = facts(goal_in_air=False, lift_off_m=0.1)
    assert wish(on_land, ENERGY) is Mode.LAND
    hop = facts(goal_in_air=False, lift_off_m=0.1, hop=True)
    assert wish(hop, ENERGY) is Mode.AIR
    assert wish(facts(goal_in_air=False, lift_off_m=4.0, hop=True), ENERGY) is Mode.LAND
    assert wish(facts(goal_in_air=False, lift_off_m=0.1, hop=True, take_off_clear=False), ENERGY) is Mode.LAND
    flying = facts(mode=Mode.AIR, goal_in_air=True, hop=True)
    assert wish(flying, ENERGY) is Mode.LAND
    assert wish(facts(mode=Mode.AIR, goal_in_air=True, hop=True, landing_clear=False), ENERGY) is Mode.AIR
    assert wish(facts(mode=Mode.AIR, goal_in_air=True), ENERGY) is Mode.AIR
