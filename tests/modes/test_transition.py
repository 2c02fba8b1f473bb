"""The hand-over in every phase x every input."""

import itertools

import pytest

from labr_autonomy.modes.transition import (
    ARM_TIMEOUT_S,
    ROTORS,
    SETTLE_S,
    STOP_SETTLE_S,
    Command,
    Inputs,
    Phase,
    State,
    step,
)
from labr_autonomy.types import Mode

EVERY_INPUT = [
    Inputs(
        wants=w,
        wheels_stopped=ws,
        armed=a,
        offboard=o,
        height_m=h,
        lift_height_m=1.0,
        v_down_mps=v,
        landed=ld,
        wheel_load=wl,
    )
    for w, ws, a, o, h, v, ld, wl in itertools.product(
        Mode,
        (False, True),
        (False, True),
        (False, True),
        (0.0, 0.3, 0.8, 1.2),
        (0.2, 2.0),
        (False, True),
        (False, True),
    )
]
AGES_S = (0.0, 0.5, 5.0, 20.0)


def inputs(**changes):
    base = {
        "wants": Mode.AIR,
        "wheels_stopped": True,
        "armed": False,
        "offboard": False,
        "height_m": 0.0,
        "lift_height_m": 1.0,
        "v_down_mps": 0.0,
        "landed": True,
        "wheel_load": True,
    }
    return Inputs(**(base | changes))


@pytest.mark.parametrize("phase", Phase)
@pytest.mark.parametrize("age_s", AGES_S)
def test_rotors_and_wheels_are_never_commanded_together(phase, age_s):
    for i in EVERY_INPUT:
        state, out = step(State(phase, 100.0 - age_s), i, 100.0)
        assert not (out.rotors and out.wheels)
        assert out.wheels == (state.phase is Phase.DRIVING)
        assert out.rotors == (state.phase in ROTORS)


@pytest.mark.parametrize("phase", Phase)
def test_rotors_stop_only_with_the_wheels_carrying(phase):
    for i in EVERY_INPUT:
        _, out = step(State(phase, 90.0), i, 100.0)
        if out.command is Command.DISARM:
            assert i.wheel_load


@pytest.mark.parametrize("phase", [Phase.LIFTING, Phase.FLYING, Phase.DESCENDING])
def test_an_airborne_robot_never_gets_its_wheels(phase):
    for i in EVERY_INPUT:
        state, _ = step(State(phase, 90.0), i, 100.0)
        if state.phase is Phase.DRIVING:
            assert i.landed
            assert not i.armed


def test_arming_waits_for_wheels_at_rest():
    state, _ = step(State(Phase.STOPPING, 0.0), inputs(wheels_stopped=False), 1.0)
    state, _ = step(state, inputs(), 1.1)
    assert state.phase is Phase.STOPPING
    state, _ = step(state, inputs(wheels_stopped=False), 1.2)  # moved again: the wait restarts
    state, _ = step(state, inputs(), 1.3)
    state, _ = step(state, inputs(), 1.3 + STOP_SETTLE_S - 0.01)
    assert state.phase is Phase.STOPPING
    state, out = step(state, inputs(), 1.3 + STOP_SETTLE_S + 0.01)
    assert state.phase is Phase.ARMING
    assert out.rotors


def test_offboard_comes_before_arming_and_commands_are_not_repeated_at_once():
    state, out = step(State(Phase.ARMING, 0.0), inputs(), 0.1)
    assert out.command is Command.OFFBOARD
    state, out = step(state, inputs(), 0.2)
    assert out.command is None
    state, out = step(state, inputs(offboard=True), 0.3)
    assert out.command is Command.ARM
    state, out = step(state, inputs(offboard=True, armed=True), 0.4)
    assert state.phase is Phase.LIFTING


def test_arming_that_never_happens_is_given_up():
    state, _ = step(State(Phase.ARMING, 0.0), inputs(offboard=True), ARM_TIMEOUT_S + 0.1)
    assert state.phase is Phase.DISARMING
    state, _ = step(state, inputs(), ARM_TIMEOUT_S + 0.2)
    assert state.phase is Phase.DRIVING


def test_bounce_restarts_the_settling_time():
    down = {"wants": Mode.LAND, "armed": True}
    state, _ = step(State(Phase.SETTLING, 0.0), inputs(wheel_load=False, **down), SETTLE_S - 0.01)
    assert state.phase is Phase.DESCENDING
    state, _ = step(state, inputs(**down), SETTLE_S)
    state, out = step(state, inputs(**down), SETTLE_S + 0.1)
    assert state.phase is Phase.SETTLING
    assert out.rotors


def test_neither_landed_state_nor_wheel_load_alone_is_a_touchdown():
    for landed, load in ((True, False), (False, True)):
        state, _ = step(
            State(Phase.DESCENDING, 0.0),
            inputs(wants=Mode.LAND, armed=True, landed=landed, wheel_load=load),
            5.0,
        )
        assert state.phase is Phase.DESCENDING


def test_without_a_pose_the_autopilot_lands_from_any_height():
    high = {
        "wants": Mode.LAND,
        "armed": True,
        "offboard": True,
        "height_m": 1.5,
        "landed": False,
        "wheel_load": False,
    }
    _, out = step(State(Phase.DESCENDING, 0.0), inputs(**high), 1.0)
    assert out.command is None
    _, out = step(State(Phase.DESCENDING, 0.0), inputs(**high, blind=True), 1.0)
    assert out.command is Command.LAND


def test_a_called_off_arming_is_waited_for_and_disarmed():
    state, out = step(State(Phase.ARMING, 0.0), inputs(offboard=True), 0.1)
    assert out.command is Command.ARM
    state, _ = step(state, inputs(wants=Mode.LAND, offboard=True), 0.2)
    assert state.phase is Phase.DISARMING
    state, out = step(
        state, inputs(wants=Mode.LAND, offboard=True), 0.3
    )  # the heartbeat does not show it yet
    assert state.phase is Phase.DISARMING
    assert out.command is Command.DISARM
    state, _ = step(state, inputs(wants=Mode.LAND, offboard=True, armed=True), 1.5)
    assert state.phase is Phase.DISARMING
    state, _ = step(state, inputs(wants=Mode.LAND), 3.0)
    assert state.phase is Phase.DRIVING


def test_an_autopilot_that_landed_by_itself_ends_the_descent():
    gone = inputs(wants=Mode.LAND, landed=True, wheel_load=False, height_m=0.0)  # no word from the wheels
    state, out = step(State(Phase.DESCENDING, 0.0), gone, 5.0)
    assert state.phase is Phase.DRIVING
    assert not out.rotors


def test_a_climb_that_gets_stuck_is_given_up():
    stuck = inputs(armed=True, offboard=True, landed=False, wheel_load=False, height_m=0.5)
    assert step(State(Phase.LIFTING, 0.0), stuck, 10.0)[0].phase is Phase.LIFTING
    assert step(State(Phase.LIFTING, 0.0), stuck, 21.0)[0].phase is Phase.DESCENDING


def test_a_take_off_by_command_is_asked_for_once_and_again_only_when_it_stays_on_the_floor():
    standing = inputs(armed=True, offboard=True, lifts_by_command=True)
    state, out = step(State(Phase.LIFTING, 0.0), standing, 0.0)
    assert out.command is Command.TAKE_OFF
    for now_s in (0.1, 3.9, 5.9):
        state, out = step(state, standing, now_s)
        assert out.command is None
    state, out = step(state, standing, 6.1)
    assert out.command is Command.TAKE_OFF
    _, out = step(state, inputs(armed=True, offboard=True, lifts_by_command=True, landed=False), 7.0)
    assert out.command is None
    gone, _ = step(state, standing, 12.1)
    assert gone.phase is Phase.DESCENDING


def test_set_points_lift_off_where_no_command_is_wanted():
    for i in EVERY_INPUT:
        _, out = step(State(Phase.LIFTING, 90.0), i, 100.0)
        assert out.command is not Command.TAKE_OFF
