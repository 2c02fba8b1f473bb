"""An ideal robot for the tests of the pilot: whole missions in simulated time, faults at chosen moments."""

import math
from dataclasses import replace

import numpy as np

from labr_autonomy.air.telemetry import AirState
from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.guard.failsafe import Health
from labr_autonomy.mission.pilot import Pilot
from labr_autonomy.mission.pilot_io import Look, Order
from labr_autonomy.mission.steps import Kind, Step
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


def airborne(robot):
    return robot.run(60, until=lambda r: r.actions.phase is Phase.FLYING).run(0.5)


def arming(robot, until):
    return robot.run(60, until=lambda r: r.actions.phase is Phase.ARMING and until(r))


def asked_to_arm(robot):
    return any(command is Command.ARM for _, command in robot.pending)


def stopping(robot):
    return robot.run(30, until=lambda r: r.actions.phase is Phase.STOPPING)
