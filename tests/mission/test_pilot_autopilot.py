"""The pilot beside an autopilot that refuses, restarts, or is taken over."""

import pytest
from pilot_rig import AIR_GOAL, CONFIG, HOME, TICK_S, Robot, airborne, arming, asked_to_arm, stopping

from labr_autonomy.guard.failsafe import Reaction
from labr_autonomy.mission.pilot_io import Order
from labr_autonomy.mission.steps import Status
from labr_autonomy.modes.transition import Command, Phase


def test_arming_refused_three_times_fails_the_mission():
    robot = Robot(AIR_GOAL)
    robot.refuse_arming = True
    robot.run(120)
    assert robot.actions.finished
    assert "did not arm" in robot.pilot.failure


def test_a_lost_pose_in_the_air_brings_it_down_by_the_autopilot_and_ends_the_mission():
    robot = airborne(Robot(AIR_GOAL, HOME))
    robot.health = {"vio_age_s": 4.0}
    commands = []
    robot.run(40, until=lambda r: commands.append(r.actions.command) or False)
    assert Command.LAND in commands
    assert robot.actions.finished
    assert robot.height < 0.01
    assert "VIO" in robot.pilot.failsafe.sentence


def test_whoever_takes_over_gets_the_robot_within_one_tick_and_nothing_more_is_sent():
    robot = airborne(Robot(AIR_GOAL, HOME))
    robot.mode = robot.intended = "position"
    robot.step()
    assert robot.actions.reaction is Reaction.YIELD
    assert "in position" in robot.pilot.failsafe.sentence
    for _ in range(200):
        assert robot.actions.air is None
        assert robot.actions.command is None
        robot.step()


def test_set_points_that_were_lost_for_a_while_are_taken_up_again():
    robot = airborne(Robot(AIR_GOAL, HOME))
    robot.mode, robot.intended, robot.critical = "land", "offboard", True
    for _ in range(50):
        robot.step()
        assert robot.actions.air is not None, "without set-points it would never come back"
    robot.mode, robot.critical = "offboard", False
    robot.run(1.0)
    assert robot.actions.reaction is Reaction.NONE


def test_a_failsafe_of_the_autopilot_that_stays_is_followed_to_the_floor():
    robot = airborne(Robot(AIR_GOAL, HOME))
    robot.mode, robot.intended, robot.critical = "land", "offboard", True
    robot.run(3.0)
    assert robot.actions.reaction is Reaction.YIELD
    assert robot.pilot.failsafe.sentence == "the autopilot's own failsafe went to land"
    assert robot.actions.air is None


def test_an_autopilot_that_restarts_in_flight_is_given_up_and_never_armed_again():
    robot = airborne(Robot(AIR_GOAL, HOME))
    robot.restarts += 1
    robot.mode, robot.armed = "hold", False
    robot.step()
    assert "restarted in flight" in robot.pilot.failsafe.sentence
    for _ in range(200):
        robot.step()
        assert robot.actions.command is None
        assert robot.actions.air is None


def test_a_restart_on_the_floor_is_no_reason_to_yield():
    robot = Robot(AIR_GOAL, HOME).run(1.0)
    robot.restarts += 1
    airborne(robot)
    assert robot.actions.reaction is Reaction.NONE


@pytest.mark.parametrize("armed", [False, True])
def test_whoever_changes_the_mode_while_arming_gets_the_robot_and_it_neither_lifts_nor_disarms(armed):
    robot = arming(Robot(AIR_GOAL, HOME), asked_to_arm)
    robot.pending = []
    robot.armed, robot.mode, robot.intended = armed, "position", "position"
    for _ in range(round(8.0 / TICK_S)):
        robot.step()
        assert robot.actions.command is None
        assert robot.actions.air is None
    assert robot.armed is armed
    assert Phase.LIFTING not in robot.phases
    assert robot.actions.reaction is Reaction.YIELD
    assert "in position" in robot.pilot.failsafe.sentence


def test_whoever_changes_the_mode_before_the_autopilot_follows_is_not_overruled():
    robot = arming(Robot(AIR_GOAL, HOME), lambda r: r.pending)
    robot.pending, robot.mode = [], "position"
    for _ in range(round(8.0 / TICK_S)):
        robot.step()
        assert robot.actions.command is None
    assert robot.actions.reaction is Reaction.YIELD


def test_a_take_off_survives_a_message_that_came_late():
    robot = arming(Robot(AIR_GOAL, HOME), asked_to_arm)
    robot.mode = "hold"
    for _ in range(5):
        robot.step()
        assert robot.actions.command is None, "if it is a person, nothing may undo the choice meanwhile"
    robot.mode = "offboard"
    airborne(robot)
    assert robot.actions.phase is Phase.FLYING


def test_a_called_off_take_off_waits_until_it_is_clear_who_flies():
    robot = arming(Robot(AIR_GOAL, HOME), asked_to_arm)
    robot.pending, robot.armed = [], True
    robot.mode, robot.order = "position", Order.LAND
    robot.run(8.0)
    assert robot.armed, "disarming is not ours to do any more"


def test_a_failsafe_of_the_autopilot_while_arming_ends_in_another_try():
    robot = arming(Robot(AIR_GOAL, HOME), asked_to_arm)
    robot.mode, robot.intended, robot.critical = "land", "offboard", True
    robot.run(3.0)
    assert robot.actions.reaction is Reaction.NONE


def test_an_autopilot_that_restarts_while_arming_is_not_armed_again():
    robot = arming(Robot(AIR_GOAL, HOME), asked_to_arm)
    robot.pending, robot.mode = [], "hold"
    robot.restarts += 1
    for _ in range(200):
        robot.step()
        assert robot.actions.command is None
    assert "restarted while arming" in robot.pilot.failsafe.sentence


def test_an_autopilot_that_lifts_off_by_command_gets_no_set_points_until_it_flies():
    robot = Robot(AIR_GOAL, HOME)
    robot.follow_mode, robot.lifts_by_command = "guided", True
    commands = []
    robot.run(60, until=lambda r: commands.append(r.actions.command) or r.actions.phase is Phase.FLYING)
    assert robot.actions.phase is Phase.FLYING
    asked = [c for c in commands if c is not None]
    assert asked[0] is Command.OFFBOARD
    assert Command.ARM in asked
    assert asked[-1] is Command.TAKE_OFF
    assert asked.count(Command.TAKE_OFF) == 1
    assert robot.pilot.take_off_m == pytest.approx(1.5 - CONFIG.body.below_m, abs=0.01)
    assert robot.sent_while_lifting == 0
    robot.run(60, until=lambda r: r.actions.finished)
    assert robot.pilot.steps.status is Status.DONE


def test_no_reaction_ever_asks_for_the_autopilots_hold():
    assert {c.value for c in Command} == {"offboard", "arm", "take off", "land", "disarm"}
    robot = airborne(Robot(AIR_GOAL, HOME))
    robot.health = {"depth_age_s": 1.0}
    robot.step()
    assert robot.actions.reaction is Reaction.HOLD
    assert robot.actions.command is None
    assert robot.actions.air is not None  # it hovers on our set-points; PX4 refuses Hold without GPS


@pytest.mark.parametrize("fault", [{"estop": True}, {"ground_age_s": 5.0}, {"vio_age_s": 0.5}, "hold"])
def test_a_take_off_that_has_not_left_the_floor_is_called_off(fault):
    robot = stopping(Robot(AIR_GOAL))
    if fault == "hold":
        robot.order = Order.HOLD
    else:
        robot.health = fault
    robot.run(8.0)
    assert Phase.LIFTING not in robot.phases
    assert not robot.armed
    assert "did not arm" not in robot.pilot.failure


def test_a_called_off_take_off_leaves_no_rotors_turning():
    robot = Robot(AIR_GOAL).run(30, until=lambda r: any(c is Command.ARM for _, c in r.pending))
    robot.order = Order.LAND
    robot.run(6.0)
    assert robot.actions.phase is Phase.DRIVING
    assert not robot.armed
