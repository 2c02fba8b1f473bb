"""The pilot on whole missions: what it drives, holds, skips and ends."""

from dataclasses import replace

import numpy as np
import pytest
from pilot_rig import AIR_GOAL, CONFIG, FLOOR_GOAL, HOME, Robot, airborne

from labr_autonomy.guard.failsafe import Reaction
from labr_autonomy.guard.fence import Zone
from labr_autonomy.mission.pilot_io import Order
from labr_autonomy.mission.steps import Kind, OnFail, Status, Step
from labr_autonomy.modes.transition import Phase


def test_a_mission_drives_flies_lands_and_drives_home():
    robot = Robot(FLOOR_GOAL, AIR_GOAL, HOME).run(90)
    assert robot.pilot.steps.status is Status.DONE
    assert robot.actions.finished
    assert not robot.pilot.failure
    assert robot.phases == [
        Phase.DRIVING, Phase.STOPPING, Phase.ARMING, Phase.LIFTING, Phase.FLYING,
        Phase.DESCENDING, Phase.SETTLING, Phase.DISARMING, Phase.DRIVING,
    ]  # fmt: skip
    assert np.hypot(*robot.position[:2]) < 0.3


@pytest.mark.parametrize(
    "fault", [{"vio_age_s": 0.5}, {"depth_age_s": 1.0}, {"plan_age_s": 3.0}, {"estop": True}]
)
def test_a_link_fault_stops_the_wheels_and_they_go_on_when_it_clears(fault):
    robot = Robot(FLOOR_GOAL).run(2.0)
    assert robot.actions.speed_mps > 0.2
    robot.health = fault
    robot.step()
    assert not robot.actions.engaged
    assert robot.actions.reaction is Reaction.HOLD
    robot.health = {}
    robot.run(30)
    assert robot.pilot.steps.status is Status.DONE


def test_a_link_fault_in_the_air_holds_the_place():
    robot = airborne(Robot(AIR_GOAL, Step(Kind.GOTO, "on", np.array([9.0, 1.0, 1.5]), in_air=True)))
    robot.run(30, until=lambda r: r.pilot.steps.index == 1).run(2.0)
    robot.health = {"depth_age_s": 1.0}
    robot.step()
    place = robot.actions.air.position_m.copy()
    robot.run(3.0)
    assert np.allclose(robot.actions.air.position_m, place)
    assert not robot.actions.air.velocity_mps.any()


def test_the_operator_holds_and_then_brings_it_down():
    robot = airborne(Robot(AIR_GOAL, HOME))
    robot.order = Order.HOLD
    robot.run(2.0)
    assert robot.actions.phase is Phase.FLYING
    robot.order = Order.LAND
    robot.run(20, until=lambda r: r.actions.phase is Phase.DRIVING)
    assert robot.actions.phase is Phase.DRIVING
    assert not robot.actions.engaged


def test_outside_the_fence_nothing_is_commanded():
    fence = Zone(((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)), keep_in=True)
    robot = Robot(FLOOR_GOAL, zones=[fence]).run(10.0)
    assert robot.position[0] < 1.05
    assert any("outside the fence" in event for event in robot.events)


def test_a_mission_that_takes_too_long_fails():
    robot = Robot(Step(Kind.WAIT, "w", wait_s=60.0), duration_s=5.0).run(10.0)
    assert robot.actions.finished
    assert "longer than 5 s" in robot.pilot.failure


def test_far_off_the_trajectory_it_stops_and_plans_anew():
    robot = Robot(FLOOR_GOAL).run(2.0)
    robot.plans = False
    robot.position[1] += 1.0
    robot.step()
    assert robot.actions.speed_mps == 0.0
    assert any("off the trajectory" in event for event in robot.events)


def test_without_a_pose_nothing_moves():
    robot = Robot(FLOOR_GOAL)
    actions = robot.pilot.tick(replace(robot.look(), odometry=None), robot.now_s)
    assert not actions.engaged
    assert actions.air is None


def test_a_skipped_step_is_no_failure_of_the_mission():
    far = Step(Kind.GOTO, "far", np.array([90.0, 0.0, 0.0]), timeout_s=2.0, on_fail=OnFail.SKIP)
    robot = Robot(far, HOME).run(30)
    assert robot.pilot.steps.status is Status.DONE
    assert not robot.pilot.failure


def test_the_time_limit_also_ends_a_mission_on_hold():
    far = Step(Kind.GOTO, "far", np.array([90.0, 0.0, 0.0]), timeout_s=1.0, on_fail=OnFail.HOLD)
    robot = Robot(far, duration_s=5.0).run(20)
    assert robot.actions.finished
    assert "longer than 5 s" in robot.pilot.failure


def test_a_wait_in_the_air_does_not_drift_with_the_estimate():
    robot = airborne(Robot(AIR_GOAL, Step(Kind.WAIT, "w", wait_s=20.0), HOME))
    robot.run(30, until=lambda r: r.pilot.steps.index == 1)
    place = robot.actions.air.position_m.copy()
    look = robot.look
    shift = np.array([0.05, 0.0, 0.0])

    def biased():
        seen = look()
        pose = replace(seen.odometry.pose, position_m=seen.odometry.pose.position_m + shift)
        return replace(seen, odometry=replace(seen.odometry, pose=pose))

    robot.look = biased
    robot.run(15.0)
    assert np.allclose(robot.actions.air.position_m, place, atol=1e-6)


def test_a_plan_that_comes_too_late_is_not_followed():
    robot = Robot(FLOOR_GOAL).run(2.0)
    robot.plans = False
    robot._plan()
    late = robot.pilot._following.course.trajectory
    robot.pilot._following.course.drop()
    result = robot.pilot._facts
    robot.pilot.accept(result, late.start_s + 1.0)
    assert robot.pilot._following.course.trajectory is None
    robot.pilot.accept(result, late.start_s)
    assert robot.pilot._following.course.trajectory is late


def test_a_hold_stops_the_clock_of_the_mission():
    robot = airborne(Robot(AIR_GOAL, Step(Kind.WAIT, "w", wait_s=3.0), Step(Kind.LAND, "l")))
    robot.run(30, until=lambda r: r.pilot.steps.index == 1)
    robot.order = Order.HOLD
    robot.run(30.0)
    assert robot.actions.phase is Phase.FLYING
    robot.order = Order.FLY
    robot.run(30.0)
    assert robot.pilot.steps.status is Status.DONE


def test_an_air_set_point_outside_the_fence_is_replaced_by_the_last_good_one():
    fence = Zone(((-1.0, -1.0), (2.5, -1.0), (2.5, 2.0), (-1.0, 2.0)), keep_in=True)
    inside = Step(Kind.GOTO, "in", np.array([1.0, 1.0, 1.5]), in_air=True)
    robot = airborne(
        Robot(inside, Step(Kind.GOTO, "out", np.array([6.0, 1.0, 1.5]), in_air=True), zones=[fence])
    )
    robot.run(15.0)
    assert robot.pilot.steps.index == 1
    assert robot.actions.air is not None
    assert robot.position[0] < 2.55
    assert sum("outside the fence" in event for event in robot.events) <= 4


@pytest.mark.parametrize("rise", [0.12, -0.12])
def test_the_floor_follows_a_ramp_closely(rise):
    """The band in which the map looks for obstacles over the floor is 4 cm."""
    robot = Robot(FLOOR_GOAL)
    move, worst = robot._move, [0.0]

    def on_a_ramp(actions):
        move(actions)
        robot.position[2] = CONFIG.body.below_m + rise * robot.position[0]

    robot._move = on_a_ramp

    def watch(r):
        worst[0] = max(worst[0], abs(r.pilot.floor_z_m - rise * r.position[0]))
        return False

    robot.run(20, until=watch)
    assert robot.position[0] > 1.5
    assert worst[0] < 0.02


def test_a_planner_without_any_way_left_ends_the_mission_but_not_while_it_is_held():
    robot = Robot(Step(Kind.GOTO, "a", np.array([9.0, 0.0, 0.0])))
    robot.order, robot.stuck = Order.HOLD, True
    robot.run(3.0)
    assert robot.pilot.failure == ""
    robot.order = Order.FLY
    robot.run(3.0)
    assert "a: no way there" in robot.pilot.failure
