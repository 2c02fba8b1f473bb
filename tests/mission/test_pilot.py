"""The pilot against an ideal robot: whole missions in simulated time, faults at chosen moments."""

import math
from dataclasses import replace

import numpy as np
import pytest

from labr_autonomy.air.telemetry import AirState
from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.guard.failsafe import Health, Reaction
from labr_autonomy.guard.fence import Zone
from labr_autonomy.mission.pilot import Pilot
from labr_autonomy.mission.pilot_io import Look, Order
from labr_autonomy.mission.steps import Kind, OnFail, Policy, Status, Step
from labr_autonomy.mission.watchers import Watchers
from labr_autonomy.modes.transition import Command, Phase
from labr_autonomy.planner.messages import PlanResult, Timings
from labr_autonomy.types import KeyPoints, Mode, Odometry, Pose, Source, Trajectory

TICK_S = 0.02
AIR = AirState(1.0, True, False, "hold", "on_ground", None, None, None, 20.5, 0.9, 1.0, 0.1, False)
CONFIG = RobotConfig()
FLOOR_GOAL = Step(Kind.GOTO, "floor", np.array([2.0, 0.0, 0.0]))
AIR_GOAL = Step(Kind.GOTO, "air", np.array([3.0, 1.0, 1.5]), in_air=True)
HOME = Step(Kind.GOTO, "home", np.array([0.0, 0.0, 0.0]))


class Robot:
    """Does at once what it is told, except that arming shows a second later."""

    def __init__(self, *mission, zones=(), duration_s=math.inf):
        self.pilot = Pilot(CONFIG, mission, zones, duration_s)
        self.watchers = Watchers()
        self.now_s = 100.0
        self.position = np.array([0.0, 0.0, CONFIG.body.below_m])
        self.velocity = np.zeros(3)
        self.yaw = 0.0
        self.armed = False
        self.mode = "hold"
        self.follow_mode, self.intended, self.critical, self.restarts = "offboard", "", False, 0
        self.lifts_by_command, self.lifting_to, self.sent_while_lifting = False, None, 0
        self.pending = []  # (due, what)
        self.refuse_arming = False
        self.plans = True
        self.landing_clear = self.take_off_clear = True
        self.stuck = False
        self.depart_rad = math.nan
        self.health = {}
        self.order = Order.FLY
        self.actions = None
        self.events = []
        self.phases = []

    @property
    def height(self):
        return self.position[2] - CONFIG.body.below_m

    def look(self):
        pose = Pose(self.position.copy(), quaternion_from_rpy(0, 0, self.yaw))
        odometry = Odometry(self.now_s, pose, self.velocity, np.zeros(3), np.eye(6) * 1e-4)
        health = Health(self.pilot.mode, 0.05, 0.05, 0.02, 0.5, 0.1, 0, False, "", 0.9, 0.15)
        air = replace(AIR, mode=self.mode, intended=self.intended, failsafe=self.critical)
        phase, asked = self.pilot.transition.phase, self.pilot.landing_asked
        taken = self.watchers.taken_over(phase, asked, air, self.restarts, self.now_s)
        health = replace(health, taken_over=taken)
        low = self.height < 0.01
        speed = float(np.hypot(*self.velocity[:2])) if low else 0.0
        return Look(
            odometry,
            speed,
            0.0,
            low,
            self.armed,
            self.mode,
            low,
            replace(health, **self.health),
            self.order,
            self.lifts_by_command,
            self.watchers.in_doubt,
        )

    def step(self):
        self.now_s += TICK_S
        self.pending, due = (
            [p for p in self.pending if p[0] > self.now_s],
            [p for p in self.pending if p[0] <= self.now_s],
        )
        for _, what in due:
            self._obey(what)
        a = self.actions = self.pilot.tick(self.look(), self.now_s)
        self.events += a.events
        if not self.phases or self.phases[-1] is not a.phase:
            self.phases.append(a.phase)
        assert not (a.engaged and a.air is not None), "wheels and rotors commanded together"
        assert not (a.engaged and a.air_lock)
        if a.command is not None:
            self.pending.append((self.now_s + 1.0, a.command))
        self._move(a)
        if self.plans and self.pilot.planning_mode is not None and round(self.now_s / TICK_S) % 5 == 0:
            self._plan()
        return a

    def _obey(self, command):
        match command:
            case Command.OFFBOARD:
                self.mode = self.follow_mode
            case Command.TAKE_OFF:
                self.lifting_to = self.pilot.take_off_m + CONFIG.body.below_m
            case Command.ARM if not self.refuse_arming:
                self.armed = True
            case Command.LAND:
                self.mode = "land"
            case Command.DISARM:
                assert self.height < 0.01, "disarmed in the air"
                self.armed = False

    def _move(self, a):
        before = self.position.copy()
        if a.engaged:
            self.yaw += a.yaw_rate_rps * TICK_S
            self.position[:2] += a.speed_mps * TICK_S * np.array([math.cos(self.yaw), math.sin(self.yaw)])
        elif self.armed and self.mode == "land":
            self.position[2] -= 0.4 * TICK_S
        elif self.armed and self.lifting_to is not None:
            self.sent_while_lifting += a.phase is Phase.LIFTING and a.air is not None
            self.position[2] = min(self.position[2] + 0.5 * TICK_S, self.lifting_to)
            self.lifting_to = None if self.position[2] >= self.lifting_to else self.lifting_to
        elif self.lifts_by_command and self.height < 0.01:
            pass  # set-points mean nothing to it on the floor
        elif self.armed and a.air is not None and self.mode == self.follow_mode:
            self.position += np.clip(a.air.position_m - self.position, -0.05, 0.05)
            self.yaw = a.air.yaw_rad
        self.position[2] = max(self.position[2], CONFIG.body.below_m)
        self.velocity = (self.position - before) / TICK_S

    def _plan(self):
        pose = Pose(self.position.copy(), quaternion_from_rpy(0, 0, self.yaw))
        odometry = Odometry(self.now_s, pose, self.velocity, np.zeros(3), np.eye(6) * 1e-4)
        request = self.pilot.request(1, 1, pose, odometry, self.now_s)
        assert request.follow is (self.pilot.transition.phase in (Phase.DRIVING, Phase.FLYING))
        start, goal = request.motion.position_m, np.array(request.goal_m, float)
        goal[2] = start[2] if request.mode is Mode.LAND or not request.goal_in_air else goal[2]
        way = float(np.linalg.norm(goal - start))
        speed = min(0.6, way) if way > 0.05 else 0.0
        duration = way / speed if speed else 0.1
        k = max(2, int(duration / 0.1) + 1)
        line = start + (goal - start) * np.linspace(0, 1, k)[:, None]
        velocity = np.tile((goal - start) / duration if speed else np.zeros(3), (k, 1))
        yaw = math.atan2(goal[1] - start[1], goal[0] - start[0]) if way > 0.05 else self.yaw
        plan = Trajectory(
            request.mode,
            request.start_s,
            0.1,
            line,
            velocity,
            np.zeros((k, 3)),
            np.full(k, yaw),
            np.zeros(k),
            np.full(k, speed),
        )
        flat = float(np.hypot(*(goal[:2] - start[:2])))
        lift = max(flat - 0.3, 0.0) if request.goal_in_air else math.inf
        points = KeyPoints(line[-1:], np.array([request.goal_in_air]), 0.1, Source.GKPN)
        self.pilot.accept(
            PlanResult(
                1, self.now_s - 0.05, plan, points, points, Source.GKPN, 1.0, "", lift, False,
                self.take_off_clear, self.landing_clear, Timings(), stuck=self.stuck,
                depart_rad=self.depart_rad,
            ),
            self.now_s,
        )  # fmt: skip

    def run(self, seconds, until=lambda r: False):
        for _ in range(round(seconds / TICK_S)):
            self.step()
            if self.actions.finished or until(self):
                return self
        return self


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


def test_arming_refused_three_times_fails_the_mission():
    robot = Robot(AIR_GOAL)
    robot.refuse_arming = True
    robot.run(120)
    assert robot.actions.finished
    assert "did not arm" in robot.pilot.failure


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


def airborne(robot):
    return robot.run(60, until=lambda r: r.actions.phase is Phase.FLYING).run(0.5)


def test_a_link_fault_in_the_air_holds_the_place():
    robot = airborne(Robot(AIR_GOAL, Step(Kind.GOTO, "on", np.array([9.0, 1.0, 1.5]), in_air=True)))
    robot.run(30, until=lambda r: r.pilot.steps.index == 1).run(2.0)
    robot.health = {"depth_age_s": 1.0}
    robot.step()
    place = robot.actions.air.position_m.copy()
    robot.run(3.0)
    assert np.allclose(robot.actions.air.position_m, place)
    assert not robot.actions.air.velocity_mps.any()


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


def arming(robot, until):
    return robot.run(60, until=lambda r: r.actions.phase is Phase.ARMING and until(r))


def asked_to_arm(robot):
    return any(command is Command.ARM for _, command in robot.pending)


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


def stopping(robot):
    return robot.run(30, until=lambda r: r.actions.phase is Phase.STOPPING)


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
