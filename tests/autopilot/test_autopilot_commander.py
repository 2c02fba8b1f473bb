"""The commander in every state and under every input and request."""

import itertools
import math

import pytest

from sim.autopilot.commander import (
    CommanderInputs,
    CommanderState,
    Kind,
    Request,
    Result,
    base_mode,
    can_arm,
    can_run,
    request,
    step,
    system_status,
)
from sim.autopilot.modes import FlightMode, find_mode

NOW = 50.0
FLYING = FlightMode.OFFBOARD
STATES = [
    CommanderState(
        intended=mode, armed=armed, failsafe=armed and failsafe, armed_s=10.0, flown_s=flown, landed_s=landed
    )
    for mode, armed, failsafe, flown, landed in itertools.product(
        FlightMode, (False, True), (False, True), (None, 12.0), (None, 40.0, 49.5)
    )
]
INPUTS = [
    CommanderInputs(setpoint_age_s=age, setpoint_usable=usable, landed=landed, tilt_rad=tilt)
    for age, usable, landed, tilt in itertools.product(
        (0.02, 3.0, math.inf), (True, False), (True, False), (0.0, 1.5)
    )
]
REQUESTS = [
    *(Request(kind, force=force) for kind in (Kind.ARM, Kind.DISARM) for force in (False, True)),
    *(Request(Kind.MODE, mode) for mode in (*FlightMode, None)),
    Request(Kind.TAKEOFF),
    Request(Kind.LAND),
]


@pytest.mark.parametrize("asked", REQUESTS, ids=str)
def test_every_request_in_every_state_keeps_the_rules(asked):
    for state, inputs in itertools.product(STATES, INPUTS):
        after, result = request(state, asked, inputs, NOW)
        if result is not Result.ACCEPTED:
            assert after == state, "a refused request changes nothing"
        if after.armed and not state.armed:
            assert asked.kind is Kind.ARM
            assert asked.force or can_arm(state, inputs)
            assert after.armed_s == NOW
        if state.armed and not after.armed:
            assert asked.kind is Kind.DISARM
            assert asked.force or inputs.landed
        if asked.kind is Kind.MODE and state.armed and result is Result.ACCEPTED:
            assert can_run(asked.mode, inputs)


def test_every_step_in_every_state_keeps_the_rules():
    for state, inputs in itertools.product(STATES, INPUTS):
        after = step(state, inputs, NOW)
        if not state.armed:
            assert after == state
            continue
        if after.armed:
            assert after.failsafe == (not can_run(after.intended, inputs))
            assert after.mode in (after.intended, FlightMode.LAND)
            assert after.intended is state.intended, "the intention survives a failsafe"
        else:
            assert inputs.landed or inputs.tilt_rad > 1.2 or state.flown_s is None
        assert system_status(after, inputs) in (0, 3, 4, 5)


def test_arming_needs_offboard_with_fresh_setpoints():
    fresh = CommanderInputs(setpoint_age_s=0.05)
    hold, offboard = CommanderState(), CommanderState(intended=FLYING)
    arm = Request(Kind.ARM)
    assert request(hold, arm, fresh, NOW)[1] is Result.TEMPORARILY_REJECTED
    assert request(offboard, arm, CommanderInputs(), NOW)[1] is Result.TEMPORARILY_REJECTED
    assert (
        request(offboard, arm, CommanderInputs(0.05, setpoint_usable=False), NOW)[1]
        is Result.TEMPORARILY_REJECTED
    )
    armed, result = request(offboard, arm, fresh, NOW)
    assert (result, armed.armed) == (Result.ACCEPTED, True)
    assert request(armed, arm, fresh, NOW + 1.0) == (armed, Result.ACCEPTED)


def in_flight(**changes):
    values = {"intended": FLYING, "armed": True, "armed_s": 10.0, "flown_s": 12.0}
    return CommanderState(**(values | changes))


def test_losing_the_setpoints_lands_and_their_return_resumes():
    state = in_flight()
    lost = CommanderInputs(setpoint_age_s=1.01, landed=False)
    state = step(state, CommanderInputs(setpoint_age_s=0.99, landed=False), NOW)
    assert state.mode is FLYING
    state = step(state, lost, NOW + 0.1)
    assert (state.mode, system_status(state, lost)) == (FlightMode.LAND, 5)
    back = CommanderInputs(setpoint_age_s=0.01, landed=False)
    state = step(state, back, NOW + 2.0)
    assert (state.mode, system_status(state, back)) == (FLYING, 4)


def test_the_loss_time_is_the_parameter():
    short = CommanderInputs(setpoint_age_s=0.6, loss_s=0.5, landed=False)
    assert step(in_flight(), short, NOW).failsafe


def test_take_off_in_the_air_is_accepted_and_lands():
    flying = CommanderInputs(setpoint_age_s=0.02, landed=False)
    state, result = request(in_flight(), Request(Kind.TAKEOFF), flying, NOW)
    assert result is Result.ACCEPTED
    state = step(state, flying, NOW)
    assert (state.mode, system_status(state, flying)) == (FlightMode.LAND, 5)
    state, result = request(state, Request(Kind.MODE, FLYING), flying, NOW)
    assert (result, state.mode) == (Result.ACCEPTED, FLYING)


def test_disarming_goes_back_to_the_mode_before_the_landing():
    flying = CommanderInputs(setpoint_age_s=0.02, landed=False)
    state, _ = request(in_flight(), Request(Kind.LAND), flying, NOW)
    again, _ = request(state, Request(Kind.LAND), flying, NOW)
    assert again == state
    standing = CommanderInputs(setpoint_age_s=0.02, landed=True)
    state = step(state, standing, NOW + 5.0)
    assert step(state, standing, NOW + 6.99).armed
    state = step(state, standing, NOW + 7.0)
    assert (state.armed, state.mode) == (False, FLYING)


def test_it_disarms_when_nobody_takes_off():
    state = in_flight(flown_s=None)
    ready = CommanderInputs(setpoint_age_s=0.02)
    assert step(state, ready, 19.9).armed
    assert not step(state, ready, 20.1).armed


@pytest.mark.parametrize(("flown_s", "disarms"), [(None, True), (NOW - 3.0, True), (NOW - 30.0, False)])
def test_a_tip_over_disarms_only_near_the_ground(flown_s, disarms):
    over = CommanderInputs(setpoint_age_s=0.02, landed=flown_s is None, tilt_rad=1.2)
    state = step(in_flight(flown_s=flown_s, armed_s=NOW - 2.0), over, NOW)
    assert state.armed
    assert step(state, over, NOW + 0.31).armed is not disarms
    upright = CommanderInputs(setpoint_age_s=0.02, landed=flown_s is None)
    assert step(step(state, upright, NOW + 0.1), over, NOW + 0.31).armed


def test_custom_modes_are_px4s():
    codes = {mode.name: mode.custom_mode for mode in FlightMode}
    assert codes["HOLD"] == 0x03040000
    assert codes["TAKEOFF"] == 0x02040000
    assert codes["OFFBOARD"] == 0x00060000
    assert codes["RETURN"] == 0x05040000
    assert codes["LAND"] == 0x06040000
    assert find_mode(6, 3) is FlightMode.OFFBOARD
    assert find_mode(4, 99) is None


@pytest.mark.parametrize(
    ("state", "seen", "flags"),
    [
        (CommanderState(), False, 0x1D),
        (CommanderState(intended=FLYING), False, 0x01),
        (CommanderState(intended=FLYING), True, 0x11),
        (in_flight(), True, 0x91),
        (in_flight(failsafe=True), True, 0x9D),
    ],
)
def test_base_mode_is_as_recorded(state, seen, flags):
    assert base_mode(state, setpoint_seen=seen) == flags
