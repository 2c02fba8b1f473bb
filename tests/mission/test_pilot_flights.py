"""When the pilot takes off and comes down: room, policy, battery."""

from dataclasses import replace

import numpy as np
import pytest
from pilot_rig import AIR_GOAL, CONFIG, FLOOR_GOAL, HOME, Robot, airborne

from labr_autonomy.mission.steps import Kind, Policy, Status, Step
from labr_autonomy.modes.transition import Phase


@pytest.mark.parametrize("by_command", [False, True], ids=["by set-points", "by command"])
def test_it_turns_towards_where_it_will_fly_while_it_climbs(by_command):
    robot = Robot(AIR_GOAL)
    robot.lifts_by_command, robot.depart_rad = by_command, 1.3
    robot.run(60, until=lambda r: r.actions and r.actions.phase is Phase.LIFTING)
    before = robot.yaw
    robot.run(30, until=lambda r: r.actions.phase is Phase.FLYING)
    assert robot.yaw == pytest.approx(before if by_command else 1.3, abs=0.05)  # the autopilot's own climb


def test_it_does_not_come_down_where_there_is_no_room():
    robot = Robot(AIR_GOAL, HOME)
    robot.landing_clear = False
    robot.run(40, until=lambda r: r.pilot.steps.index == 1)
    robot.run(4)
    assert robot.actions.phase is Phase.FLYING
    robot.landing_clear = True
    robot.run(60)
    assert robot.pilot.steps.status is Status.DONE


def test_an_air_policy_flies_to_a_goal_on_the_floor_and_stays_down():
    robot = Robot(Step(Kind.GOTO, "hop", np.array([2.0, 0.0, 0.0]), policy=Policy.AIR)).run(90)
    assert robot.pilot.steps.status is Status.DONE
    assert robot.phases.count(Phase.FLYING) == 1


def test_a_ground_policy_never_takes_off():
    robot = Robot(replace(AIR_GOAL, policy=Policy.GROUND, timeout_s=10.0)).run(30)
    assert robot.phases == [Phase.DRIVING]
    assert robot.pilot.steps.status is Status.FAILED


@pytest.mark.parametrize(
    ("policy", "left", "may"),
    [
        (Policy.AUTO, 0.9, True),
        (Policy.GROUND, 0.9, False),
        (Policy.AUTO, CONFIG.energy.reserve + 0.01, False),
    ],
    ids=["allowed", "a ground policy", "the battery is near its reserve"],
)
def test_the_planner_is_told_whether_it_may_hop(policy, left, may):
    robot = Robot(Step(Kind.GOTO, "far", np.array([5.0, 0.0, 0.0]), policy=policy))
    robot.health = {"battery_left": left}
    robot.run(1)
    odometry = robot.look().odometry
    assert robot.pilot.request(1, 1, odometry.pose, odometry, robot.now_s).may_hop is may


@pytest.mark.parametrize("asked", [AIR_GOAL, replace(FLOOR_GOAL, policy=Policy.AIR)])
def test_a_flight_that_the_battery_does_not_last_for_is_refused_with_its_joules(asked):
    """faults.md, row 52: above the reserve, but not by a flight."""
    robot = Robot(asked, HOME)
    robot.health = {"battery_left": CONFIG.energy.reserve + 0.005}
    robot.run(40)
    assert not robot.armed
    assert Phase.ARMING not in robot.phases
    assert robot.pilot.steps.status is Status.FAILED
    assert any("flying there takes" in e and "2735 J above its reserve" in e for e in robot.events)
    enough = Robot(asked, HOME)
    enough.health = {"battery_left": CONFIG.energy.reserve + 0.05}
    assert Phase.FLYING in enough.run(40).phases


@pytest.mark.parametrize("after", [(Step(Kind.LAND, "l"),), ()], ids=["a landing", "the mission's end"])
def test_it_comes_down_only_where_there_is_room(after):
    robot = airborne(Robot(AIR_GOAL, *after))
    robot.landing_clear = False
    robot.run(30.0)
    assert robot.actions.phase is Phase.FLYING, "it looks for a place"
    assert robot.events.count("no room to come down here: looking for a place") == 1
    robot.landing_clear = True
    robot.run(30.0)
    assert robot.actions.finished
    assert robot.height < 0.01


@pytest.mark.parametrize(
    ("step", "health"),
    [(Step(Kind.LAND, "now", here=True), {}), (Step(Kind.LAND, "l"), {"battery_left": 0.1}),
     (Step(Kind.LAND, "l"), {"depth_age_s": 1.0})],
    ids=["the operator says so", "the battery is at its end", "nobody can tell"],
)  # fmt: skip
def test_it_comes_down_where_it_is_when_it_must(step, health):
    robot = airborne(Robot(AIR_GOAL, step))
    robot.run(30, until=lambda r: r.pilot.steps.index == 1)
    robot.landing_clear, robot.health = False, health
    robot.run(20.0)
    assert robot.height < 0.01
    assert Phase.DISARMING in robot.phases


def test_a_flying_robot_stops_before_it_comes_down():
    robot = airborne(Robot(AIR_GOAL, Step(Kind.GOTO, "far", np.array([9.0, 1.0, 1.5]), in_air=True)))
    robot.run(30, until=lambda r: r.pilot.steps.index == 1 and np.hypot(*r.velocity[:2]) > 0.5)
    robot.pilot.insert([Step(Kind.LAND, "l")], robot.now_s, keep=False)
    robot.run(30, until=lambda r: r.actions.phase is Phase.DESCENDING)
    assert np.hypot(*robot.velocity[:2]) < 0.35


def test_an_air_policy_needs_room_above():
    robot = Robot(Step(Kind.GOTO, "hop", np.array([2.0, 0.0, 0.0]), policy=Policy.AIR))
    robot.take_off_clear = False
    robot.run(10.0)
    assert Phase.STOPPING not in robot.phases


def test_two_goals_in_the_air_need_one_take_off():
    on = Step(Kind.GOTO, "on", np.array([4.0, 1.0, 1.5]), in_air=True)
    robot = Robot(replace(AIR_GOAL, policy=Policy.AIR), on, HOME).run(120)
    assert robot.pilot.steps.status is Status.DONE
    assert robot.phases.count(Phase.FLYING) == 1
