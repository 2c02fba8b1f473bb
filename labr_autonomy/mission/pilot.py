"""The pilot: one look at the robot in, one set of commands out. No I/O, no clock, no simulator.

It joins the pure machines (steps, failsafe, mode decision, transition) and holds the trajectory that is
being followed. The executive feeds it at 50 Hz; a lock-step runner can feed it from a simulated clock.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.guard import failsafe
from labr_autonomy.guard.failsafe import Reaction
from labr_autonomy.guard.fence import Zone
from labr_autonomy.guard.takeover import FOLLOWING
from labr_autonomy.mission import steps
from labr_autonomy.mission.following import Following
from labr_autonomy.mission.mode_wish import ModeWish, Situation
from labr_autonomy.mission.pilot_io import Actions, Look, Order
from labr_autonomy.mission.spare import Spare
from labr_autonomy.mission.steps import Kind, Status, Step
from labr_autonomy.modes import transition
from labr_autonomy.modes.energy import EnergyModel
from labr_autonomy.modes.transition import Command, Phase
from labr_autonomy.planner.messages import PlanRequest, PlanResult
from labr_autonomy.types import Array, Mode, Odometry, Pose, SetPoint

PLAN_LEAD_S = 0.08  # a new trajectory begins this long after its request
LIFT_MIN_M = 0.8  # a hop is never lower than this above driving height
LIFT_TRAVEL_M = 1.2  # height to travel at when the goal itself is on the floor
PRESS_DOWN_M = 0.3  # a landing aims this far below the floor, so that the weight comes onto the wheels
DESCEND_MPS = 0.4
STOPPED_MPS = 0.03
STOPPED_RPS = 0.1
FLOOR_GAIN = 0.2  # a tick; slower ones lag by decimetres on a ramp, quicker ones take jolts for floor
TAKE_OFFS_MAX = 3  # refused that often, the mission has failed


class Pilot:
    """Flies one mission.

    Args:
        config: The robot.
        mission: Steps in order.
        zones: Fences.
        duration_s: The mission comes down and ends after this.
    """

    def __init__(
        self,
        config: RobotConfig,
        mission: Sequence[Step] = (),
        zones: Sequence[Zone] = (),
        duration_s: float = math.inf,
    ) -> None:
        self._config = config
        self._mission = tuple(mission)
        self._following = Following(config)
        self._following.zones = tuple(zones)
        self._duration_s = duration_s
        self.steps = steps.State()
        self.transition = transition.State()
        self.failsafe = failsafe.State()
        self._facts: PlanResult | None = None
        self._wish = ModeWish(EnergyModel.of(config))
        self._spare = Spare(config)
        self._floor_z_m: float | None = None
        self._refused = 0
        self._started_s: float | None = None
        self._now_s = self._before_s = 0.0
        self._commanded_land = False
        self._down_m: Array | None = None  # the floor below where it was to come down, while it flies
        self.take_off_m = 0.0  # height above the floor that a take-off by command climbs to
        self.failure = ""
        self.depth_fault = ""  # what the planner says of the camera's images

    @property
    def mode(self) -> Mode:
        """Land while the wheels carry the robot or could, air otherwise."""
        return Mode.LAND if self.transition.phase in (Phase.DRIVING, Phase.STOPPING) else Mode.AIR

    @property
    def floor_z_m(self) -> float:
        """Floor below the robot, odom."""
        return 0.0 if self._floor_z_m is None else self._floor_z_m

    @property
    def landing_asked(self) -> bool:
        """The autopilot was asked to land and has not put it down yet."""
        return self._commanded_land

    @property
    def planning_mode(self) -> Mode | None:
        """Mode to plan for now; None while the transition flies by itself."""
        return {Phase.DRIVING: Mode.LAND, Phase.FLYING: Mode.AIR}.get(self.transition.phase)

    def load(self, mission: Sequence[Step], zones: Sequence[Zone]) -> None:
        """Set what is to be done, before the first tick."""
        self._mission, self._following.zones = tuple(mission), tuple(zones)

    def step_at(self, index: int) -> Step | None:
        """One step of the mission, None beyond its end."""
        return self._mission[index] if index < len(self._mission) else None

    def begin(self, now_s: float) -> None:
        """The mission's clocks start now: it has waited for its operator."""
        self._started_s = now_s
        self.steps = replace(self.steps, entered_s=now_s)

    @property
    def mission(self) -> tuple[Step, ...]:
        """Every step, with what the operator put in."""
        return self._mission

    def steps_left(self) -> tuple[Step, ...]:
        """What is still to be done, the present step first."""
        return self._mission[self.steps.index :]

    def insert(self, new: Sequence[Step], now_s: float, *, keep: bool = True) -> None:
        """Do other steps now.

        Args:
            new: In order.
            now_s: The present.
            keep: Go on with the rest of the mission afterwards; otherwise it is dropped.
        """
        index = self.steps.index
        rest = self._mission[index:] if keep else ()
        self._mission = (*self._mission[:index], *new, *rest)
        self._move_to(index, now_s)

    def skip(self, now_s: float) -> None:
        """Give the present step up and go on with the next one."""
        self._move_to(self.steps.index + 1, now_s)

    def _move_to(self, index: int, now_s: float) -> None:
        self.steps = steps.State(index, now_s)
        self._facts = None

    def fail(self, reason: str) -> None:
        """Something outside the pilot makes going on impossible: come down and end."""
        if self.steps.status is not Status.FAILED:
            self.failure = reason
            self.steps = replace(self.steps, status=Status.FAILED)

    # ------------------------------------------------------------------ the tick
    def tick(self, look: Look, now_s: float) -> Actions:
        """Decide what leaves at `now_s`."""
        events: list[str] = []
        self._before_s, self._now_s = self._now_s, now_s
        if self._started_s is None:
            self._started_s = self._before_s = now_s
            self.steps = replace(self.steps, entered_s=now_s)
        before, self._spare.battery_left = self.failsafe, look.health.battery_left
        self.failsafe = failsafe.step(self.failsafe, look.health, now_s)
        if self.failsafe.reaction is not before.reaction and self.failsafe.sentence:
            events.append(f"{self.failsafe.reaction.name.lower()}: {self.failsafe.sentence}")
        if look.odometry is None:
            return self._idle(tuple(events))
        self._follow_floor(look.odometry)
        progress = self._progress(look, now_s, events)
        status, reaction = self.steps.status, self.failsafe.reaction
        short = self._spare.short_of(progress.step, look.odometry.pose.position_m)
        situation = Situation(
            self.transition.phase, self.mode, status, reaction, progress, self._facts, short
        )
        wants = self._wish.step(situation, look, now_s, events)
        outputs = self._hand_over(look, progress.step, wants, now_s, events)
        return self._command(look, outputs, progress, now_s, events)

    def _idle(self, events: tuple[str, ...]) -> Actions:
        """Nothing leaves: there is no pose."""
        return Actions(
            speed_mps=0.0,
            yaw_rate_rps=0.0,
            engaged=False,
            air_lock=self.mode is Mode.AIR,
            air=None,
            reference=None,
            command=None,
            events=events,
            reached=None,
            failed=None,
            phase=self.transition.phase,
            mode=self.mode,
            step=None,
            distance_m=0.0,
            reaction=self.failsafe.reaction,
            plan_used_s=None,
            finished=self._finished(),
        )

    def _follow_floor(self, odometry: Odometry) -> None:
        if self.transition.phase is not Phase.DRIVING:
            return
        floor = float(odometry.pose.position_m[2]) - self._config.body.below_m
        if self._floor_z_m is None:
            self._floor_z_m = floor
        self._floor_z_m += FLOOR_GAIN * (floor - self._floor_z_m)
        self._following.floor_z_m = self._floor_z_m

    def _progress(self, look: Look, now_s: float, events: list[str]) -> steps.Outputs:
        assert look.odometry is not None
        free = look.order is Order.FLY and self.failsafe.reaction is Reaction.NONE
        inputs = steps.Inputs(
            position_m=look.odometry.pose.position_m,
            speed_mps=float(np.linalg.norm(look.odometry.velocity_mps)),
            mode=self.mode,
            settled=self.transition.phase in (Phase.DRIVING, Phase.FLYING),
            nearest=free and self._facts is not None and self._facts.nearest,
            stuck=self._stuck() if free else "",
        )
        index = self.steps.index
        paused = look.order is Order.HOLD and self.steps.status is Status.RUNNING
        if paused:  # the operator's hold stops the mission's clock as well
            self.steps = replace(self.steps, entered_s=self.steps.entered_s + now_s - self._before_s)
            step = self.step_at(index)
            left_m = 0.0 if step is None else steps.goal_distance_m(step, inputs.position_m)
            return steps.Outputs(step, left_m)
        self.steps, progress = steps.step(self.steps, self._mission, inputs, now_s)
        if progress.say:
            events.append(progress.say)
        if self.steps.index != index:
            self._facts = None
        if progress.failed and self.steps.status is Status.FAILED:
            self.failure = progress.say
        over = self.steps.status in (Status.DONE, Status.FAILED)
        if not over and self._started_s is not None and now_s - self._started_s > self._duration_s:
            self.fail(f"mission took longer than {self._duration_s:.0f} s")
            events.append(self.failure)
        return progress

    def _hand_over(
        self, look: Look, step: Step | None, wants: Mode, now_s: float, events: list[str]
    ) -> transition.Outputs:
        assert look.odometry is not None
        if look.in_doubt and self.failsafe.reaction is not Reaction.YIELD:
            return transition.Outputs(wheels=False, rotors=True)  # not even a disarming: it may be theirs now
        before = self.transition.phase
        inputs = transition.Inputs(
            wants=wants,
            wheels_stopped=(
                abs(look.wheel_speed_mps) < STOPPED_MPS
                and abs(look.wheel_yaw_rate_rps) < STOPPED_RPS
                and look.health.ground_age_s < failsafe.GROUND_LATE_S
            ),
            armed=look.armed,
            offboard=look.autopilot_mode in FOLLOWING,
            height_m=self._height_m(look.odometry),
            lift_height_m=self.lift_to_m(step) - self._drive_z_m - 0.1,
            lifts_by_command=look.lifts_by_command,
            v_down_mps=-float(look.odometry.velocity_mps[2]),
            landed=look.landed,
            wheel_load=look.wheel_load,
            blind=look.health.vio_age_s > failsafe.VIO_LATE_S,
        )
        self.transition, outputs = transition.step(self.transition, inputs, now_s)
        if outputs.say:
            events.append(outputs.say)
        if outputs.command is Command.LAND:
            self._commanded_land = True
        if self.transition.phase is not before:
            self._enter(self.transition.phase, before, look, step, now_s, events)
        return outputs

    def _enter(
        self,
        phase: Phase,
        before: Phase,
        look: Look,
        step: Step | None,
        now_s: float,
        events: list[str],
    ) -> None:
        course, air, odometry, facts = self._following.course, self._config.air, look.odometry, self._facts
        assert odometry is not None
        match phase:
            case Phase.DRIVING:
                course.drop()
                self._commanded_land = False
                self._wish.mode = Mode.LAND
            case Phase.STOPPING:
                course.drop()
            case Phase.ARMING:
                course.hold_here(odometry, now_s)
            case Phase.LIFTING:
                self._refused = 0
                self.take_off_m = self.lift_to_m(step) - self._drive_z_m
                heading_rad = math.nan if facts is None or look.lifts_by_command else facts.depart_rad
                course.climb(self.lift_to_m(step), air.climb_mps, now_s, heading_rad, air.yaw_rate_rps)
            case Phase.FLYING:
                course.hold_reference(now_s)
                self._commanded_land = False
                self._wish.mode = Mode.AIR
            case Phase.DESCENDING:
                if before not in (Phase.FLYING, Phase.LIFTING):
                    course.hold_here(odometry, now_s)
                course.climb(self._drive_z_m - PRESS_DOWN_M, min(DESCEND_MPS, air.descend_mps), now_s)
            case Phase.DISARMING if before is Phase.ARMING and self._wish.mode is Mode.AIR:
                self._refused += 1
                if self._refused >= TAKE_OFFS_MAX:
                    self.fail(f"the autopilot did not arm in {self._refused} tries")
                    events.append(self.failure)
            case _:
                pass

    # ------------------------------------------------------------------ set-points
    def _command(
        self,
        look: Look,
        outputs: transition.Outputs,
        progress: steps.Outputs,
        now_s: float,
        events: list[str],
    ) -> Actions:
        speed = turn = 0.0
        air: SetPoint | None = None
        reference: SetPoint | None = None
        held = self.failsafe.reaction is not Reaction.NONE or look.order is not Order.FLY
        yields = self.failsafe.reaction is Reaction.YIELD
        if outputs.wheels and not held and progress.step is not None and progress.step.kind is Kind.GOTO:
            reference, speed, turn = self._following.drive(look.odometry, now_s, events)
        elif outputs.rotors and not (yields or look.in_doubt):
            staying = not self._wish.seeks and (progress.step is None or progress.step.kind is not Kind.GOTO)
            flying = self.transition.phase is Phase.FLYING
            reference = self._following.fly(flying, held or staying, now_s, events)
            # while the autopilot lands or lifts off by itself, set-points would only confuse it
            landing = self._commanded_land and look.autopilot_mode == "land"
            lifting = look.lifts_by_command and self.transition.phase is Phase.LIFTING
            air = None if landing or lifting else reference
        return Actions(
            speed_mps=speed,
            yaw_rate_rps=turn,
            engaged=outputs.wheels and reference is not None,
            air_lock=outputs.rotors,
            air=air,
            reference=reference,
            command=None if yields else outputs.command,
            events=tuple(events),
            reached=progress.reached,
            failed=progress.failed,
            phase=self.transition.phase,
            mode=self.mode,
            step=progress.step,
            distance_m=progress.distance_m,
            reaction=self.failsafe.reaction,
            plan_used_s=self._following.course.frame_stamp_s,
            finished=self._finished(),
        )

    # ------------------------------------------------------------------ planning
    def request(
        self, sequence: int, frame_sequence: int, frame_pose: Pose, odometry: Odometry, now_s: float
    ) -> PlanRequest:
        """What to plan next; without a goal, to stay here."""
        step = self.step_at(self.steps.index)
        goal = self._goal_m(step, odometry)
        mode = self.planning_mode or Mode.AIR
        start_s = now_s + PLAN_LEAD_S
        return PlanRequest(
            sequence=sequence,
            frame_sequence=frame_sequence,
            frame_pose=frame_pose,
            body_pose=odometry.pose,
            start_s=start_s,
            motion=self._following.course.motion_at(start_s, self.planning_mode, odometry, now_s),
            mode=mode,
            goal_m=goal,
            goal_in_air=step is not None and step.in_air,
            floor_z_m=self.floor_z_m,
            lift_to_m=self.lift_to_m(step),
            fresh=self._following.course.wants_fresh(),
            may_hop=self._spare.may_hop(step),
            follow=self.planning_mode is not None,
        )

    def _goal_m(self, step: Step | None, odometry: Odometry) -> Array:
        """Where to plan to: without a goal here, or to the floor below where it was to come down."""
        lands = step is None or step.kind is Kind.LAND
        if not lands or self.transition.phase is not Phase.FLYING:
            self._down_m = None
        elif self._down_m is None:
            self._down_m = np.array([*odometry.pose.position_m[:2], self._drive_z_m])
        if step is not None and step.goal_m is not None:
            return step.goal_m
        return odometry.pose.position_m if self._down_m is None else self._down_m

    def _stuck(self) -> str:
        """Why it gets no farther with this step, "" while it may."""
        if self._wish.refused:
            return self._wish.refused
        given_up = self._facts is not None and self._facts.stuck
        return "no way there, and everything was tried" if given_up else ""

    def accept(self, result: PlanResult, now_s: float) -> None:
        """Take over a plan that came back, unless it came too late or nothing is to be followed."""
        self._facts, self.depth_fault = result, result.depth_fault
        self._following.take(result, self.planning_mode, now_s)

    # ------------------------------------------------------------------ small things
    @property
    def _drive_z_m(self) -> float:
        return self.floor_z_m + self._config.body.below_m

    def _height_m(self, odometry: Odometry) -> float:
        return float(odometry.pose.position_m[2]) - self._drive_z_m

    def lift_to_m(self, step: Step | None) -> float:
        """Height of the body in odom that a take-off climbs to."""
        ceiling = self.floor_z_m + self._config.air.height_max_m
        travel = self._drive_z_m + LIFT_TRAVEL_M
        wanted = (
            float(step.goal_m[2]) if step is not None and step.in_air and step.goal_m is not None else travel
        )
        return min(max(wanted, self._drive_z_m + LIFT_MIN_M), ceiling)

    def _finished(self) -> bool:
        """The mission is over and the robot stands on its wheels."""
        over = self.steps.status in (Status.DONE, Status.FAILED) or self.failsafe.reaction >= Reaction.LAND
        return over and self.transition.phase is Phase.DRIVING
