"""One trial on a simulated clock: what `mission.flight` does with tasks and links, done step by step."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from labr_autonomy.clock import SystemClock
from labr_autonomy.config import RobotConfig
from labr_autonomy.estimation.filter import PoseFilter
from labr_autonomy.guard.failsafe import VIO_LATE_S
from labr_autonomy.mission.instruments import look
from labr_autonomy.mission.pilot import Pilot
from labr_autonomy.mission.pilot_io import Actions, Order
from labr_autonomy.mission.steps import Kind, Status, Step
from labr_autonomy.mission.watchers import Watchers
from labr_autonomy.modes.transition import ROTORS, Phase
from labr_autonomy.planner.messages import PlanRequest, PlanResult
from labr_autonomy.types import DepthFrame, Mode, Odometry, Pose
from sim.camera.process import Eye
from sim.lockstep.air import AirSeam
from sim.lockstep.land import LandSeam
from sim.lockstep.planner import Planner
from sim.lockstep.trial import Outcome
from sim.movers.crowd import Crowd
from sim.plant import STEP_S, Plant
from sim.referee import Referee
from sim.vio import VioStandIn

STEPS_A_TICK = 5
TICK_S = STEPS_A_TICK * STEP_S  # set-points at 50 Hz, as in flight
VIO_EVERY = 8  # steps: 31 Hz
VISION_EVERY = 2  # ticks: poses to the autopilot at 25 Hz
PLAN_EVERY = 5  # ticks: 10 Hz
LOOK_TICKS = 1  # from exposure to request: the camera's transfer
THINK_TICKS = 3  # from request to plan: 60 ms, the planner's median cycle beside a running flight
DEPTH_AGE_S = 0.04  # age of the newest image of a 30 Hz stream
TRACK_EVERY = 10  # ticks
ACCEPT_M = 0.25  # stricter than a mission file's default
STUCK_S, STUCK_M = 45.0, 0.5  # who has not left a circle of this radius for so long will not arrive


@dataclass
class Joules:
    """Energy at the battery's terminals by what the robot was doing [J]."""

    land: float = 0.0
    air: float = 0.0
    transition: float = 0.0
    used_j: float = 0.0  # at the last account

    def add(self, phase: Phase, used_j: float) -> None:
        """Account for what was used since the last call."""
        spent, self.used_j = used_j - self.used_j, used_j
        match phase:
            case Phase.DRIVING | Phase.STOPPING:
                self.land += spent
            case Phase.FLYING:
                self.air += spent
            case _:
                self.transition += spent


@dataclass
class Record:
    """What a flight leaves behind."""

    plan_cycle_s: list[float] = field(default_factory=list)
    sources: Counter[str] = field(default_factory=Counter)
    track: list[tuple[float, float, float, float, int]] = field(default_factory=list)
    events: list[tuple[float, str]] = field(default_factory=list)
    joules: Joules = field(default_factory=Joules)


def to_goal(goal_m: tuple[float, float, float], in_air: bool) -> Step:
    """The step of reaching a goal.

    Args:
        goal_m: (3,) body origin at the goal, odom.
        in_air: It is to be reached flying.
    """
    return Step(Kind.GOTO, "goal", np.array(goal_m), in_air, accept_m=ACCEPT_M, timeout_s=math.inf)


class LockstepFlight:
    """Flies a mission of a few steps.

    Args:
        config: The robot.
        plant: Its physics in its world.
        vio: The pose source.
        eye: The camera; None for a method that does not look.
        planner: The method.
        mission: What is to be done; see `to_goal`.
        seed: Of the IMU.
        crowd: Who walks about in its world; nobody when left out.
    """

    def __init__(
        self,
        config: RobotConfig,
        plant: Plant,
        vio: VioStandIn,
        eye: Eye | None,
        planner: Planner,
        mission: Sequence[Step],
        seed: int,
        crowd: Crowd | None = None,
    ) -> None:
        self._config, self._plant, self._vio, self._eye = config, plant, vio, eye
        self._planner = planner
        self._pilot = Pilot(config, mission)
        self._filter = PoseFilter()
        self._watchers = Watchers()
        self._air = AirSeam(seed)
        self._land = LandSeam(config)
        self._wall = SystemClock()
        self._now_s = 0.0
        self._start_s = 0.0
        self._ticks = 0
        self._steps = 0
        self._frame: DepthFrame | None = None
        self._due: tuple[int, PlanResult] | None = None  # tick at which the plan is there
        self._result_s = 0.0
        self._stay: tuple[float, np.ndarray] | None = None  # since when, and where
        self._crowd = crowd
        self.on_tick: Callable[[float, Actions], None] | None = None  # told the time and what left
        self.on_step: Callable[[float], None] | None = None  # told the time after each step of the physics
        self.referee = Referee(crowd=crowd)
        self.record = Record()

    def run(self, limit_s: float) -> tuple[Outcome, str]:
        """Fly until the goal is reached, something is touched, the robot gives up, or the time is over."""
        self._settle()
        limit_s += self._now_s
        while self._now_s < limit_s:
            for _ in range(STEPS_A_TICK):
                self._step()
            if self._stuck():
                return "timeout", f"it has not left its place for {STUCK_S:.0f} s"
            if self.referee.contacts:
                return "contact", f"touched {self._touched()} at {self.referee.contact_places_m[0]}"
            actions = self._tick()
            if self._pilot.steps.status is Status.DONE:
                return "reached", "the goal is reached"
            if self._pilot.steps.status is Status.FAILED or actions.finished:
                return "stopped", self._pilot.failure or self._pilot.failsafe.sentence or "it stopped"
        return "timeout", f"not there after {limit_s - self._start_s:.0f} s"

    @property
    def time_s(self) -> float:
        """Duration of the flight so far [s]."""
        return self._now_s - self._start_s

    def _touched(self) -> str:
        """What the first contact was with."""
        if not self.referee.mover_contacts or self._crowd is None or self._crowd.nearest is None:
            return "something"
        unseen = " out of view" if self.referee.unseen_contacts else ""
        return f"a {self._crowd.movers[self._crowd.nearest].shape.kind}{unseen}"

    def _stuck(self) -> bool:
        """Whether the robot has stayed where it is for too long."""
        place = self._plant.state.position_m
        if self._stay is None or float(np.linalg.norm(place - self._stay[1])) > STUCK_M:
            self._stay = self._now_s, place.copy()
        return self._now_s - self._stay[0] > STUCK_S

    def _settle(self) -> None:
        """Stand until estimate and links are there, as before a take-off of any flight."""
        while not self._filter.ready or self._now_s < 1.0:
            for _ in range(STEPS_A_TICK):
                self._step()
            self._sense()
            self._land.send_velocity(self._now_s, 0.0, 0.0, engaged=False, air_lock=False)
        self._start_s = self._result_s = self._now_s
        self.record.joules = Joules(used_j=self._plant.battery.used_j)

    def _step(self) -> None:
        """One step of the physics and of what is wired to it."""
        self._steps += 1
        self._now_s = self._steps * STEP_S
        plant = self._plant
        motors = self._air.step(self._now_s, STEP_S, plant.state, plant.battery)
        drive = self._land.step(self._now_s, STEP_S, plant.pins(armed=self._air.armed))
        plant.step(None if motors is None else np.array(motors), drive)
        if self._crowd is not None:
            self._crowd.watch(STEP_S, plant.state)
        self.referee.watch(self._now_s, plant)
        if self.on_step is not None:
            self.on_step(self._now_s)
        if self._steps % VIO_EVERY == 0:
            state = plant.state
            self._vio.feed(self._now_s, Pose(state.position_m, state.quaternion), state.velocity_mps)

    def _sense(self) -> None:
        now_s = self._now_s
        for sample in self._vio.due(now_s):
            self._filter.add_vio(sample)
        self._filter.add_imu(self._air.imu(now_s, self._plant.state))
        standing = self._pilot.mode is Mode.LAND and self._plant.wheel_load
        self._filter.add_wheels(self._land.odometry(now_s), standing)

    def _tick(self) -> Actions:
        self._ticks += 1
        now_s = self._now_s
        self._sense()
        self._take_plan()
        seen = look(
            self._pilot,
            self._watchers,
            self._config,
            self._filter,
            self._land.state(now_s),
            self._air.state(now_s),
            depth_stamp_s=now_s - DEPTH_AGE_S,
            plan_age_s=now_s - self._result_s,
            order=Order.FLY,
            now_s=now_s,
        )
        actions = self._pilot.tick(seen, now_s)
        self._send(actions)
        self._plan(seen.odometry)
        known = self._filter.ages(now_s)["vio_accepted"] <= VIO_LATE_S
        if known and seen.odometry is not None and self._ticks % VISION_EVERY == 0:
            self._air.send_vision(seen.odometry)
        self._note(actions)
        return actions

    def _send(self, actions: Actions) -> None:
        speed, turn, lock = actions.speed_mps, actions.yaw_rate_rps, actions.air_lock
        taken = self._land.send_velocity(self._now_s, speed, turn, engaged=actions.engaged, air_lock=lock)
        if actions.engaged and not taken:
            self._land.send_velocity(self._now_s, 0.0, 0.0, engaged=False, air_lock=lock)
        if actions.air is not None:
            self._air.send_setpoint(actions.air)
        if actions.command is not None:
            refused = self._air.request(actions.command)
            if refused:
                self._say(f"air: {refused}")
        for sentence in actions.events:
            self._say(sentence)

    # ------------------------------------------------------------------ planning
    def _plan(self, estimate: Odometry | None) -> None:
        """Expose an image, ask for a plan from it a little later, and keep the answer until it is due."""
        beat = self._ticks % PLAN_EVERY
        if beat == 0 and self._eye is not None:
            state = self._plant.state
            movers = self._crowd.placed if self._crowd is not None else ()
            image = self._eye.look(Pose(state.position_m, state.quaternion), movers)
            self._frame = DepthFrame(self._ticks, self._now_s, image, self._config.camera.intrinsics)
        if beat != LOOK_TICKS or estimate is None:
            return
        if self._eye is not None and self._frame is None:
            return
        then = estimate if self._frame is None else self._filter.at(self._frame.stamp_s)
        if then is None:
            return
        sequence = self._ticks
        request = self._pilot.request(sequence, sequence, then.pose, estimate, self._now_s)
        self._due = (self._ticks + THINK_TICKS, self._cycle(request))

    def _cycle(self, request: PlanRequest) -> PlanResult:
        began_s = self._wall.now_s()
        result = self._planner.cycle(request, self._frame)
        self.record.plan_cycle_s.append(self._wall.now_s() - began_s)
        self.record.sources[result.source.value] += 1
        return result

    def _take_plan(self) -> None:
        if self._due is None or self._ticks < self._due[0]:
            return
        result, self._due = self._due[1], None
        self._result_s = self._now_s
        self._pilot.accept(result, self._now_s)

    # ------------------------------------------------------------------ records
    def _note(self, actions: Actions) -> None:
        self.record.joules.add(actions.phase, self._plant.battery.used_j)
        if self.on_tick is not None:
            self.on_tick(self._now_s, actions)
        if self._ticks % TRACK_EVERY == 0:
            x, y, z = (round(float(v), 3) for v in self._plant.state.position_m)
            flown = int(actions.phase in ROTORS)
            self.record.track.append((round(self.time_s, 2), x, y, z, flown))

    def _say(self, sentence: str) -> None:
        self.record.events.append((round(self.time_s, 2), sentence))
