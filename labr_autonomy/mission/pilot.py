"""The pilot: one look at the robot in, one set of commands out. No I/O, no clock, no simulator.

It joins the pure machines (steps, failsafe, mode decision, transition) and holds the trajectory that is
being followed. The executive feeds it at 50 Hz; a lock-step runner can feed it from a simulated clock.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import yaw_of
from labr_autonomy.ground.tracking import LOST_M, follow
from labr_autonomy.guard import failsafe, takeover, wheel_faults
from labr_autonomy.guard.failsafe import Reaction
from labr_autonomy.guard.fence import Zone
from labr_autonomy.guard.setpoint import check_setpoint
from labr_autonomy.guard.takeover import FOLLOWING
from labr_autonomy.mission import steps
from labr_autonomy.mission.course import Course
from labr_autonomy.mission.steps import Kind, Policy, Status, Step
from labr_autonomy.modes import decision, transition
from labr_autonomy.modes.energy import EnergyModel
from labr_autonomy.modes.transition import Command, Phase
from labr_autonomy.planner.messages import PlanRequest, PlanResult
from labr_autonomy.types import Mode, Odometry, Pose, SetPoint

PLAN_LEAD_S = 0.08  # a new trajectory begins this long after its request
LIFT_MIN_M = 0.8  # a hop is never lower than this above driving height
LIFT_TRAVEL_M = 1.2  # height to travel at when the goal itself is on the floor
PRESS_DOWN_M = 0.3  # a landing aims this far below the floor, so that the weight comes onto the wheels
DESCEND_MPS = 0.4
STOPPED_MPS = 0.03
STOPPED_RPS = 0.1
SAY_AGAIN_S = 5.0  # the guard's word on the same matter
LATE_PLAN_S = 0.3  # a plan whose beginning is longer ago than this is not followed
FLOOR_GAIN = 0.2  # a tick; slower ones lag by decimetres on a ramp, quicker ones take jolts for floor
TAKE_OFFS_MAX = 3  # refused that often, the mission has failed
ROTORS_OURS = frozenset({Phase.LIFTING, Phase.FLYING, Phase.DESCENDING})  # entered following, as reported


class Order(enum.IntEnum):
    """What the operator asked for, by severity."""

    FLY = 0
    HOLD = 1
    LAND = 2


@dataclass(frozen=True, slots=True)
class Look:
    """Everything the pilot may know at one instant."""

    odometry: Odometry | None  # predicted to now
    wheel_speed_mps: float
    wheel_yaw_rate_rps: float
    wheel_load: bool
    armed: bool
    autopilot_mode: str  # "offboard", "guided", "land", ...
    landed: bool
    health: failsafe.Health
    order: Order = Order.FLY
    lifts_by_command: bool = False  # the autopilot ignores set-points on the floor
    in_doubt: bool = False  # somebody else may be about to fly: nothing may be sent to the autopilot


@dataclass(frozen=True, slots=True)
class Actions:
    """What leaves now. Wheels get a command in every tick; the rotors only where `air` is set."""

    speed_mps: float
    yaw_rate_rps: float
    engaged: bool
    air_lock: bool
    air: SetPoint | None
    reference: SetPoint | None  # what is being followed, for the log
    command: Command | None
    events: tuple[str, ...]
    reached: Step | None
    failed: Step | None
    phase: Phase
    mode: Mode
    step: Step | None
    distance_m: float
    reaction: Reaction
    plan_used_s: float | None  # exposure stamp of the depth frame behind the followed plan
    finished: bool


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
        self._zones = tuple(zones)
        self._duration_s = duration_s
        self._energy = EnergyModel.of(config)
        self.steps = steps.State()
        self.transition = transition.State()
        self.failsafe = failsafe.State()
        self._decision = decision.State()
        self._facts: PlanResult | None = None
        self._wants = Mode.LAND
        self._course = Course()
        self._floor_z_m: float | None = None
        self._refused = 0
        self._started_s: float | None = None
        self._now_s = self._before_s = 0.0
        self._commanded_land = False
        self._takeover = takeover.State()
        self._wheel_faults = wheel_faults.State()
        self._restarts_seen = 0  # of the autopilot, while it stood
        self.take_off_m = 0.0  # height above the floor that a take-off by command climbs to
        self._guard_said_s: dict[str, float] = {}
        self._staying = False  # a place in the air is held, whatever the planner says
        self._passed: SetPoint | None = None  # the last air set-point that the guard let pass
        self.failure = ""

    @property
    def mode(self) -> Mode:
        """Land while the wheels carry the robot or could, air otherwise."""
        return Mode.LAND if self.transition.phase in (Phase.DRIVING, Phase.STOPPING) else Mode.AIR

    @property
    def floor_z_m(self) -> float:
        """Floor below the robot, odom."""
        return 0.0 if self._floor_z_m is None else self._floor_z_m

    @property
    def planning_mode(self) -> Mode | None:
        """Mode to plan for now; None while the transition flies by itself."""
        return {Phase.DRIVING: Mode.LAND, Phase.FLYING: Mode.AIR}.get(self.transition.phase)

    def taken_over(
        self,
        mode: str,
        intended: str,
        critical: bool,
        restarts: int,
        now_s: float,
        *,
        resumes: bool = True,
    ) -> str:
        """Why the autopilot no longer follows us, "" while it does.

        Args:
            mode: The mode that it reports.
            intended: The mode that it was asked for, "" where it does not tell.
            critical: It calls its own state critical.
            restarts: How often it has restarted.
            now_s: The present.
            resumes: It comes back by itself after lost set-points.
        """
        flying, arming = self.transition.phase in ROTORS_OURS, self.transition.phase is Phase.ARMING
        if not (flying or arming):
            self._restarts_seen = restarts
        inputs = takeover.Inputs(
            flying=flying,
            mode=mode,
            intended=intended,
            critical=critical,
            landing_asked=self._commanded_land,
            restarted=restarts > self._restarts_seen,
            resumes=resumes,
            arming=arming,
        )
        self._takeover, sentence = takeover.step(self._takeover, inputs, now_s)
        return sentence

    @property
    def in_doubt(self) -> bool:
        """By the last call of `taken_over`, somebody else may be about to fly."""
        return self._takeover.in_doubt

    def wheel_fault(self, latched: tuple[str, ...], now_s: float) -> str:
        """Why the wheels have to rest, "" while they need not.

        Args:
            latched: Faults that the land controller keeps until it is told to let go, in words.
            now_s: The present.
        """
        self._wheel_faults, sentence = wheel_faults.step(self._wheel_faults, latched, now_s)
        return sentence

    def load(self, mission: Sequence[Step], zones: Sequence[Zone]) -> None:
        """Set what is to be done, before the first tick."""
        self._mission, self._zones = tuple(mission), tuple(zones)

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
        before = self.failsafe
        self.failsafe = failsafe.step(self.failsafe, look.health, now_s)
        if self.failsafe.reaction is not before.reaction and self.failsafe.sentence:
            events.append(f"{self.failsafe.reaction.name.lower()}: {self.failsafe.sentence}")
        if look.odometry is None:
            return self._idle(tuple(events))
        self._follow_floor(look.odometry)
        progress = self._progress(look, now_s, events)
        wants = self._wanted(progress, look, now_s, events)
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

    def _progress(self, look: Look, now_s: float, events: list[str]) -> steps.Outputs:
        assert look.odometry is not None
        free = look.order is Order.FLY and self.failsafe.reaction is Reaction.NONE
        inputs = steps.Inputs(
            position_m=look.odometry.pose.position_m,
            speed_mps=float(np.linalg.norm(look.odometry.velocity_mps)),
            mode=self.mode,
            settled=self.transition.phase in (Phase.DRIVING, Phase.FLYING),
            stuck=free and self._facts is not None and self._facts.stuck,
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

    def _wanted(self, progress: steps.Outputs, look: Look, now_s: float, events: list[str]) -> Mode:
        """Mode that mission, operator and failsafe ask for."""
        order, health = look.order, look.health
        step, driving = progress.step, self.transition.phase is Phase.DRIVING
        if self.failsafe.reaction >= Reaction.LAND or order is Order.LAND:
            return Mode.LAND
        if step is None:
            return Mode.LAND if self.steps.status is not Status.HOLDING else self.mode
        if step.kind is Kind.LAND or step.policy is Policy.GROUND:
            return Mode.LAND
        held = order is Order.HOLD or self.failsafe.reaction is Reaction.HOLD
        if (
            held or health.estop or health.ground_age_s > failsafe.GROUND_LATE_S
        ) and self.transition.phase in (
            Phase.STOPPING,
            Phase.ARMING,
        ):
            return Mode.LAND  # a take-off that has not left the floor is called off
        if step.kind is Kind.WAIT or held:
            return self._wants if self.transition.phase not in (Phase.DRIVING, Phase.FLYING) else self.mode
        if step.policy is Policy.AIR:
            if driving and not (self._facts and self._facts.take_off_clear):
                return Mode.LAND
            share = 1.0 if self.mode is Mode.LAND else 0.5  # come down well inside, then stay down
            over_goal = not step.in_air and progress.distance_m < share * step.accept_m
            self._wants = Mode.LAND if over_goal else Mode.AIR
            return self._wants
        assert look.odometry is not None
        facts = self._decision_facts(step, look.odometry)
        if facts is not None:
            self._decision, wanted = decision.step(self._decision, facts, self._energy, now_s)
            if wanted is not facts.mode and wanted is not self._wants:
                where = f"lift-off {facts.lift_off_m:.1f} m ahead, goal {facts.goal_distance_xy_m:.1f} m off"
                events.append(f"{wanted.value} wanted: {where}")
            self._wants = wanted
        return self._wants

    def _decision_facts(self, step: Step, odometry: Odometry) -> decision.Facts | None:
        plan = self._facts
        if plan is None or self.transition.phase not in (Phase.DRIVING, Phase.FLYING) or step.goal_m is None:
            return None
        return decision.Facts(
            mode=self.mode,
            goal_in_air=step.in_air,
            goal_distance_xy_m=float(np.hypot(*(step.goal_m[:2] - odometry.pose.position_m[:2]))),
            lift_off_m=plan.lift_off_m,
            land_path_ends=plan.land_path_ends,
            take_off_clear=plan.take_off_clear,
            landing_clear=plan.landing_clear,
            hop=plan.hop,
        )

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
            self._enter(self.transition.phase, before, look.odometry, step, now_s, events)
        return outputs

    def _enter(
        self,
        phase: Phase,
        before: Phase,
        odometry: Odometry,
        step: Step | None,
        now_s: float,
        events: list[str],
    ) -> None:
        course, air = self._course, self._config.air
        match phase:
            case Phase.DRIVING:
                course.drop()
                self._commanded_land = False
                self._wants = Mode.LAND
            case Phase.STOPPING:
                course.drop()
            case Phase.ARMING:
                course.hold_here(odometry, now_s)
            case Phase.LIFTING:
                self._refused = 0
                self.take_off_m = self.lift_to_m(step) - self._drive_z_m
                course.climb(self.lift_to_m(step), air.climb_mps, now_s)
            case Phase.FLYING:
                course.hold_reference(now_s)
                self._commanded_land = False
                self._wants = Mode.AIR
            case Phase.DESCENDING:
                if before not in (Phase.FLYING, Phase.LIFTING):
                    course.hold_here(odometry, now_s)
                course.climb(self._drive_z_m - PRESS_DOWN_M, min(DESCEND_MPS, air.descend_mps), now_s)
            case Phase.DISARMING if before is Phase.ARMING and self._wants is Mode.AIR:
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
            reference, speed, turn = self._drive(look, now_s, events)
        elif outputs.rotors and not (yields or look.in_doubt):
            staying = progress.step is None or progress.step.kind is not Kind.GOTO
            reference = self._fly(held or staying, now_s, events)
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
            plan_used_s=self._course.frame_stamp_s,
            finished=self._finished(),
        )

    def _drive(self, look: Look, now_s: float, events: list[str]) -> tuple[SetPoint | None, float, float]:
        reference = self._course.land(now_s)
        if reference is None or look.odometry is None:
            return None, 0.0, 0.0
        pose = look.odometry.pose
        wanted = follow(
            reference, float(pose.position_m[0]), float(pose.position_m[1]), yaw_of(pose.quaternion)
        )
        if wanted.error_m > LOST_M:
            events.append(f"{wanted.error_m:.2f} m off the trajectory; planning anew")
            self._course.drop()
            return None, 0.0, 0.0
        asked = replace(reference, speed_mps=wanted.speed_mps, yaw_rate_rps=wanted.yaw_rate_rps)
        checked = self._checked(asked, now_s, events)
        return (
            (reference, 0.0, 0.0) if checked is None else (reference, checked.speed_mps, checked.yaw_rate_rps)
        )

    def _fly(self, held: bool, now_s: float, events: list[str]) -> SetPoint | None:
        course, flying = self._course, self.transition.phase is Phase.FLYING
        self._staying = flying and held
        if self._staying:
            course.hold_reference(now_s)
        checked = self._checked(course.air(now_s), now_s, events)
        if checked is None and flying and self._passed is not None:  # stay where the guard let it be
            course.hold_place(self._passed, now_s)
            checked = course.air(now_s)
        self._passed = checked
        return checked

    def _checked(self, setpoint: SetPoint, now_s: float, events: list[str]) -> SetPoint | None:
        verdict = check_setpoint(setpoint, self._config, self._zones, self.floor_z_m, now_s)
        if verdict.setpoint is None and now_s - self._guard_said_s.get(verdict.code, -math.inf) > SAY_AGAIN_S:
            events.append(f"guard: {verdict.reason}")
            self._guard_said_s[verdict.code] = now_s
        return verdict.setpoint

    # ------------------------------------------------------------------ planning
    def request(
        self, sequence: int, frame_sequence: int, frame_pose: Pose, odometry: Odometry, now_s: float
    ) -> PlanRequest:
        """What to plan next; without a goal, to stay here."""
        step = self.step_at(self.steps.index)
        goal = odometry.pose.position_m if step is None or step.goal_m is None else step.goal_m
        mode = self.planning_mode or Mode.AIR
        start_s = now_s + PLAN_LEAD_S
        return PlanRequest(
            sequence=sequence,
            frame_sequence=frame_sequence,
            frame_pose=frame_pose,
            body_pose=odometry.pose,
            start_s=start_s,
            motion=self._course.motion_at(start_s, self.planning_mode, odometry, now_s),
            mode=mode,
            goal_m=goal,
            goal_in_air=step is not None and step.in_air,
            floor_z_m=self.floor_z_m,
            lift_to_m=self.lift_to_m(step),
            fresh=self._course.wants_fresh(),
        )

    def accept(self, result: PlanResult, now_s: float) -> None:
        """Take over a plan that came back, unless it came too late or nothing is to be followed."""
        self._facts = result
        plan = result.trajectory
        if plan is None or plan.mode is not self.planning_mode or now_s > plan.start_s + LATE_PLAN_S:
            return
        if plan.mode is Mode.AIR and self._staying:
            return
        self._course.take(plan, result.frame_stamp_s)

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
