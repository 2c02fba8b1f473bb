"""Mission steps: reached, waited for, timed out."""

from dataclasses import replace

import numpy as np
import pytest

from labr_autonomy.mission.steps import Inputs, Kind, OnFail, State, Status, Step, goal_distance_m, step
from labr_autonomy.types import Mode

LAND_GOAL = Step(Kind.GOTO, "a", np.array([3.0, 0.0, 0.0]))
AIR_GOAL = Step(Kind.GOTO, "b", np.array([3.0, 0.0, 1.5]), in_air=True)


def at(x, z=0.12, mode=Mode.LAND, speed=0.0, settled=True):
    return Inputs(np.array([x, 0.0, z]), speed, mode, settled)


def run(steps, looks, state=None, dt=0.1):
    state = state or State()
    out = None
    reached = []
    for k, look in enumerate(looks):
        state, out = step(state, steps, look, k * dt)
        if out.reached:
            reached.append(out.reached.label)
    return state, out, reached


def test_height_counts_for_air_goals_only():
    assert goal_distance_m(LAND_GOAL, np.array([3.0, 0.0, 0.12])) == 0.0
    assert goal_distance_m(AIR_GOAL, np.array([3.0, 0.0, 0.5])) == pytest.approx(1.0)


def test_a_land_goal_is_reached_at_rest_on_the_wheels():
    state, _, reached = run([LAND_GOAL], [at(2.9)] * 10)
    assert state.status is Status.DONE
    assert reached == ["a"]


@pytest.mark.parametrize(
    "look",
    [at(2.0), at(2.9, speed=0.5), at(2.9, mode=Mode.AIR, z=1.0), at(2.9, settled=False)],
    ids=["far", "moving", "flying", "between modes"],
)
def test_a_land_goal_is_not_reached(look):
    state, _, reached = run([LAND_GOAL], [look] * 20)
    assert state.status is Status.RUNNING
    assert not reached


def test_a_goal_without_room_is_reached_as_near_as_there_is_room():
    beside = replace(at(2.6), nearest=True)
    looks = [beside] * 25
    assert not run([LAND_GOAL], looks[:20])[2]  # it stands for a while first
    state, _, reached = run([LAND_GOAL], looks)
    assert (state.status, reached) == (Status.DONE, ["a"])
    said = step(State(rest_since_s=0.0), [LAND_GOAL], beside, 2.1)[1].say
    assert said == "a: done, 0.40 m off: as near as there is room for the robot; mission complete"
    assert not run([LAND_GOAL], [at(2.6)] * 40)[2]  # there is room nearer by
    assert not run([LAND_GOAL], [replace(at(2.3), nearest=True)] * 40)[2]
    assert run([AIR_GOAL], [replace(at(2.6, 1.5, Mode.AIR), nearest=True)] * 25)[2] == ["b"]


def test_an_air_goal_is_reached_in_the_air_only():
    assert run([AIR_GOAL], [at(3.0, 1.45, Mode.AIR)] * 10)[2] == ["b"]
    assert not run([AIR_GOAL], [at(3.0, 1.45, Mode.LAND)] * 10)[2]


def test_a_touch_in_passing_does_not_count():
    looks = [at(2.9), at(2.9), at(2.9, speed=0.6)] * 5
    assert not run([LAND_GOAL], looks)[2]


def test_waiting_takes_its_time():
    wait = Step(Kind.WAIT, "w", wait_s=1.0)
    assert not run([wait], [at(0)] * 10)[2]
    assert run([wait], [at(0)] * 12)[2] == ["w"]


def test_landing_is_done_on_the_wheels():
    land = Step(Kind.LAND, "l")
    assert not run([land], [at(0, 1.0, Mode.AIR)] * 10)[2]
    assert run([land], [at(0)] * 10)[2] == ["l"]


@pytest.mark.parametrize(
    ("on_fail", "status", "index"),
    [(OnFail.STOP, Status.FAILED, 0), (OnFail.SKIP, Status.RUNNING, 1), (OnFail.HOLD, Status.HOLDING, 0)],
)
def test_a_goal_out_of_time_follows_its_policy(on_fail, status, index):
    steps = [Step(Kind.GOTO, "a", np.array([9.0, 0, 0]), timeout_s=1.0, on_fail=on_fail), AIR_GOAL]
    state, out, _ = run(steps, [at(0)] * 12)
    assert (state.status, state.index) == (status, index)
    assert "9.0 m left" in out.say


def test_a_planner_that_has_tried_everything_ends_the_step_by_its_policy():
    stuck = Inputs(
        np.array([0.5, 0.0, 0.12]), 0.0, Mode.LAND, True, stuck="no way there, and everything was tried"
    )
    state, out, _ = run([LAND_GOAL], [stuck] * 3)
    assert state.status is LAND_GOAL_ON_FAIL[LAND_GOAL.on_fail]
    state, out = step(State(), [LAND_GOAL], stuck, 0.0)
    assert "no way there" in out.say
    assert "2.5 m left" in out.say
    waiting = Step(Kind.WAIT, "w", wait_s=5.0)
    assert step(State(), [waiting], stuck, 0.0)[0].status is Status.RUNNING


LAND_GOAL_ON_FAIL = {OnFail.STOP: Status.FAILED, OnFail.HOLD: Status.HOLDING, OnFail.SKIP: Status.DONE}
