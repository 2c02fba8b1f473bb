"""Flying: turn first, solve, or fall back."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from labr_autonomy.clock import Clock
from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import wrap_pi
from labr_autonomy.refine import profile, reference
from labr_autonomy.refine.air import (
    OCTAGON,
    YAW_ACCELERATION_RPS2,
    AirModel,
    Envelope,
    follow_yaw,
    trajectory,
    vector,
)
from labr_autonomy.refine.check import dense_check
from labr_autonomy.refine.choice import (
    BLOCKED_M,
    CLOSE_M,
    LOOK_AHEAD_M,
    TURN_MOVING_RAD,
    TURN_RAD,
    Call,
    best_plan,
)
from labr_autonomy.refine.polytopes import Polytopes
from labr_autonomy.refine.problem import TIGHT
from labr_autonomy.refine.rti import Plan, Task
from labr_autonomy.refine.solver import QpStep
from labr_autonomy.refine.values import STEP_S, AirState, DistanceField, RefineResult, grid_s
from labr_autonomy.types import Array, Mode, Source, Trajectory

SLOW_MPS = 0.3
TURN_AHEAD_M = 2.0 * LOOK_AHEAD_M  # where along the path the heading to turn to is taken
SEED_GIVE_M = 0.1  # a previous plan this much too close is still worth linearising at


def turn_first(state: AirState, offset_m: Array) -> float | None:
    """Heading to turn to before flying on towards a point ahead, or None.

    Args:
        state: Heading and speed now.
        offset_m: (2|3,) from the robot to the point, `TURN_AHEAD_M` along its path, odom.
    """
    if math.hypot(offset_m[0], offset_m[1]) < CLOSE_M:
        return None
    heading = math.atan2(offset_m[1], offset_m[0])
    error = abs(wrap_pi(heading - state.yaw))
    slow = float(np.linalg.norm(state.velocity)) < SLOW_MPS
    return heading if error > (TURN_RAD if slow else TURN_MOVING_RAD) else None


class AirPlanner:
    """The flying half of the refiner."""

    def __init__(self, config: RobotConfig, clock: Clock) -> None:
        self.config = config
        self._clock = clock
        self._model = AirModel()
        self._step = QpStep(self._model.problem)
        body, clearance = config.body, config.clearance
        self.hard_m = max(body.radius_m + clearance.hard_m, self.outline_m)
        self.aim_m = max(body.radius_m + clearance.soft_m, self.hard_m + 0.05)

    def plan(
        self,
        state: AirState,
        key_points_m: Array,
        field: DistanceField,
        now_s: float,
        previous: Trajectory | None,
        *,
        source: Source = Source.GKPN,
        speed_mps: float | None = None,
        climb_mps: float | None = None,
        descend_mps: float | None = None,
        floor_m: float = 0.0,
    ) -> RefineResult:
        """A flying trajectory from `state` along key points (n, 3) odom, looking where it goes.

        Args:
            state: Where the trajectory begins, exactly.
            key_points_m: What to follow; the last is where to stop.
            field: The 3D map.
            now_s: Stamp of `state`.
            previous: The last trajectory, of any start, or None.
            source: Written into a plan that was solved for these key points.
            speed_mps: Lower horizontal speed than the robot's limit.
            climb_mps: Lower climb rate than the robot's limit.
            descend_mps: Lower rate of descent than the robot's limit.
            floor_m: Height of the floor in odom, for the limits of height.
        """
        call = Call(self._clock, now_s, self._clock.now_s(), source, previous)
        env = self._envelope(floor_m, speed_mps, climb_mps, descend_mps)
        x0 = vector(state)
        brake = self._model.brake(x0, env)
        points = np.array(key_points_m, dtype=float)
        points[:, 2] = np.clip(points[:, 2], env.height_min_m, env.height_max_m)
        task = Task(
            self._model.problem,
            self._step,
            x0,
            self._model.bounds(env, brake),
            self._model.settle,
            self._model.dense,
            field,
            self.hard_m,
            lambda x, u: self._model.over(x, u, env, brake),
        )
        if not np.isfinite(points).all():
            return self._fallback(task, state, env, call, "the key points are not finite numbers")
        path = reference.shape(x0[:3], points, field, self.hard_m, self.aim_m)
        if path.blocked and path.length_m < BLOCKED_M:
            return self._fallback(
                task, state, env, call, f"the key points are blocked after {path.length_m:.1f} m"
            )
        turn = turn_first(state, path.at(TURN_AHEAD_M) - path.points_m[0])
        if turn is not None:
            verdict = task.judge(*brake)
            if verdict.may_leave:
                out = self._turn(state, turn, brake[0], env, call)
                degrees = math.degrees(wrap_pi(turn - state.yaw))
                why = f"turning by {degrees:.0f} degrees towards the path"
                return call.result(out, verdict, self.outline_m, why)
        flat = TIGHT * OCTAGON * env.speed_mps
        pace = reference.Pace(
            self._slant(path, flat, env),
            env.acceleration_mps2 * math.sqrt(0.5),
            self.config.body.radius_m,
            reference.BLIND_AIR_M,
        )
        along = path.at(LOOK_AHEAD_M) - path.points_m[0]
        speed0 = float(x0[3:6] @ along) / max(float(np.linalg.norm(along)), 1e-6)
        timed = reference.timed(path, speed0, pace, field)
        seeds = [self._model.cold(x0, timed)]
        kept = call.previous_of(Mode.AIR)
        if kept is not None:
            shifted = self._model.shifted(kept, now_s, x0)
            if dense_check(shifted[0][:, :3], field, self.hard_m - SEED_GIVE_M).free:
                seeds.insert(0, shifted)
        plan = best_plan(task, seeds, timed, Polytopes(field, self.aim_m))
        if isinstance(plan, str):
            return self._fallback(task, state, env, call, plan)
        yaw = self._yaw_along(state, plan.x, env, call)
        out = trajectory(plan.x, yaw, now_s, source)
        return call.result(out, plan.verdict, self.outline_m, "follows the key points")

    @property
    def outline_m(self) -> float:
        """Radius of the sphere that stands for the body in the air [m]."""
        body = self.config.body
        return math.hypot(body.radius_m, max(body.below_m, body.above_m))

    def _envelope(
        self,
        floor_m: float,
        speed: float | None = None,
        climb: float | None = None,
        descend: float | None = None,
    ) -> Envelope:
        lim = self.config.air
        full = Envelope.of(lim, floor_m, self.config.body.below_m)
        return replace(
            full,
            speed_mps=min(speed or lim.speed_mps, lim.speed_mps),
            climb_mps=min(climb or lim.climb_mps, lim.climb_mps),
            descend_mps=min(descend or lim.descend_mps, lim.descend_mps),
        )

    @staticmethod
    def _slant(path: reference.Path, flat_mps: float, env: Envelope) -> float:
        """Speed along a path whose steepest part obeys the vertical limits too."""
        step = np.diff(path.points_m, axis=0)
        length = np.maximum(np.linalg.norm(step, axis=1), 1e-9)
        near = np.cumsum(length) < 2.5 * flat_mps
        near[0] = True
        up, across = step[:, 2] / length, np.hypot(step[:, 0], step[:, 1]) / length
        vertical = np.where(up > 0.0, TIGHT * env.climb_mps, TIGHT * env.descend_mps)
        most = np.minimum(flat_mps / np.maximum(across, 1e-6), vertical / np.maximum(np.abs(up), 1e-6))
        return float(most[near].min())

    @staticmethod
    def _yaw_rate(call: Call) -> float:
        previous = call.previous
        return previous.sample(call.now_s).yaw_rate_rps if previous is not None else 0.0

    def _yaw_along(self, state: AirState, x: Array, env: Envelope, call: Call) -> Array:
        """Yaw (n, 2) towards a point ahead on the plan; kept where nothing lies ahead."""
        ahead = x[np.minimum(np.arange(len(x)) + 6, len(x) - 1), :2] - x[:, :2]
        wanted = np.empty(len(x))
        heading = state.yaw
        for k, (dx, dy) in enumerate(ahead):
            if math.hypot(dx, dy) > 0.15:
                heading = math.atan2(dy, dx)
            wanted[k] = heading
        return follow_yaw(state.yaw, self._yaw_rate(call), wanted, env.yaw_rate_rps)

    def _turn(self, state: AirState, yaw_rad: float, x: Array, env: Envelope, call: Call) -> Trajectory:
        """Come to a hover by braking states x (n, 9) and turn; as many intervals as that takes."""
        rate0 = self._yaw_rate(call)
        most = max(env.yaw_rate_rps, abs(rate0))
        angle = wrap_pi(yaw_rad - state.yaw)
        lasts = profile.turn_duration(angle, rate0, most, YAW_ACCELERATION_RPS2)
        steps = max(len(x) - 1, math.ceil(lasts / STEP_S))
        x = np.concatenate([x, np.repeat(x[-1:], steps + 1 - len(x), axis=0)])
        times = grid_s(steps + 1)
        yaw = profile.turn_rates(angle, rate0, most, YAW_ACCELERATION_RPS2, times)
        yaw[:, 0] += state.yaw
        yaw[-1, 1] = 0.0
        return trajectory(x, yaw, call.now_s, Source.TURN)

    def _fallback(self, task: Task, state: AirState, env: Envelope, call: Call, why: str) -> RefineResult:
        options: list[tuple[Source, Plan]] = []
        previous = call.previous_of(Mode.AIR)
        if previous is not None and previous.end_s > call.now_s + STEP_S:
            kept = self._model.rest_of(previous, call.now_s, task.x0)
            if kept is not None:
                options.append((Source.PREVIOUS, Plan(*kept, task.judge(*kept))))
            if not any(plan.verdict.may_leave for _, plan in options):
                seed = self._model.shifted(previous, call.now_s, task.x0)
                tracked = task.solve(seed, seed[0][:, :3], None)
                options += [] if tracked is None else [(Source.PREVIOUS, tracked)]
        options = [option for option in options if not option[1].verdict.over]
        brake = self._model.brake(task.x0, env)
        options.append((Source.BRAKE, Plan(*brake, task.judge(*brake))))
        free = [option for option in options if option[1].verdict.may_leave]
        # braking may lead into what the previous plan went round: the farther one, then
        source, plan = free[0] if free else max(options, key=lambda option: option[1].verdict.nearest_m)
        if previous is None or source is Source.BRAKE:
            out = _hovering(plan.x, state, call.now_s)
        else:
            wanted = np.full(len(plan.x), previous.yaw_rad[-1])
            yaw = follow_yaw(state.yaw, self._yaw_rate(call), wanted, env.yaw_rate_rps)
            out = trajectory(plan.x, yaw, call.now_s, source)
        return call.result(out, plan.verdict, self.outline_m, why, stopped=True)

    def brake(self, state: AirState, now_s: float) -> Trajectory:
        """To a hover as fast as jerk and acceleration allow, wherever that is; the yaw is kept."""
        x, _ = self._model.brake(vector(state), self._envelope(0.0))
        return _hovering(x, state, now_s)


def _hovering(x: Array, state: AirState, now_s: float) -> Trajectory:
    """Braking states (n, 9) with the yaw kept."""
    yaw = np.stack([np.full(len(x), state.yaw), np.zeros(len(x))], axis=1)
    return trajectory(x, yaw, now_s, Source.BRAKE)
