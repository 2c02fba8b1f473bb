"""Driving: turn first, solve, or fall back."""

from __future__ import annotations

import math

import numpy as np

from labr_autonomy.clock import Clock
from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import wrap_pi
from labr_autonomy.refine import reference
from labr_autonomy.refine.check import Verdict, dense_check
from labr_autonomy.refine.choice import (
    ARRIVED_M,
    BLOCKED_M,
    CLOSE_M,
    LOOK_AHEAD_M,
    TURN_MOVING_RAD,
    TURN_RAD,
    Call,
    best_plan,
)
from labr_autonomy.refine.land import LandModel, vector
from labr_autonomy.refine.polytopes import Polytopes
from labr_autonomy.refine.rti import Task
from labr_autonomy.refine.solver import QpStep
from labr_autonomy.refine.values import STEP_S, DistanceField, LandState, RefineResult
from labr_autonomy.types import Array, Mode, Source, Trajectory

TURN_CLOSE_RAD = math.radians(25.0)  # close to the goal a unicycle has no room to swing in
SLOW_MPS = 0.25
SIDE_M = 0.03  # lateral error that is not worth a turn
LOOK_TO_M = 0.8  # along a path into the unknown
SOON_M = 2.0  # a path that ends farther away than this is followed first
BEYOND_M = 0.5  # past the end of what is free
LOOK_RAD = math.radians(12.0)  # a smaller turn shows nothing new
VIEW_RAD = math.radians(38.0)  # what lies farther off the heading than this may be out of view
SEED_GIVE_M = 0.1  # a previous plan this much too close is still worth linearising at


class LandPlanner:
    """The driving half of the refiner."""

    def __init__(self, config: RobotConfig, clock: Clock) -> None:
        self.config = config
        self._clock = clock
        self._model = LandModel(config.land)
        self._step = QpStep(self._model.problem)
        self.hard_m = config.body.radius_m + config.clearance.hard_m
        self.aim_m = config.body.radius_m + config.clearance.soft_m

    def plan(
        self,
        state: LandState,
        key_points_m: Array,
        field: DistanceField,
        now_s: float,
        previous: Trajectory | None,
        *,
        source: Source = Source.GKPN,
        speed_mps: float | None = None,
    ) -> RefineResult:
        """A driving trajectory from `state` along key points (n, 2 or 3) odom; z is ignored.

        Args:
            state: Where the trajectory begins, exactly.
            key_points_m: What to follow; the last is where to stop.
            field: The 2D map.
            now_s: Stamp of `state`.
            previous: The last trajectory, of any start, or None.
            source: Written into a plan that was solved for these key points.
            speed_mps: Lower cruise speed than the robot's limit.
        """
        call = Call(self._clock, now_s, self._clock.now_s(), source, previous)
        lim = self.config.land
        x0 = vector(state)
        brake = self._model.brake(x0)
        points = np.asarray(key_points_m, dtype=float)[:, :2]
        task = Task(
            self._model.problem,
            self._step,
            x0,
            self._model.bounds(brake),
            self._model.settle,
            self._model.dense,
            field,
            self.hard_m,
            lambda x, u: self._model.over(x, u, brake),
        )

        def give(x: Array, u: Array, verdict: Verdict, source: Source, why: str) -> RefineResult:
            out = self._model.trajectory(x, u, state, now_s, source)
            return call.result(out, verdict, self.config.body.radius_m, why)

        def turned(yaw_rad: float, why: str) -> RefineResult | None:
            x, u = self._model.turn(x0, yaw_rad)
            verdict = task.judge(x, u)
            return give(x, u, verdict, Source.TURN, why) if verdict.may_leave else None

        if not np.isfinite(points).all():
            return self._fallback(task, state, call, "the key points are not finite numbers")
        path = reference.shape(x0[:2], points, field, self.hard_m, self.aim_m)
        if path.blocked and path.length_m < BLOCKED_M:
            look = self._look_needed(state, points, path, field)
            looks = None if look is None else turned(look, "looking where the path leads")
            blocked = f"the key points are blocked after {path.length_m:.1f} m"
            return looks or self._fallback(task, state, call, blocked)
        turn = self._turn_first(state, points, path, field)
        if turn is not None:
            no_room = "no room to stop while turning towards the path"
            return turned(*turn) or self._fallback(task, state, call, no_room)
        pace = reference.Pace(
            min(speed_mps or lim.speed_mps, lim.speed_mps),
            lim.acceleration_mps2,
            self.config.body.radius_m,
            reference.BLIND_LAND_M,
        )
        timed = reference.timed(path, abs(state.speed), pace, field)
        seeds = [self._model.cold(x0, timed)]
        kept = call.previous_of(Mode.LAND)
        if kept is not None:
            shifted = self._model.shifted(kept, now_s, x0)
            if dense_check(shifted[0][:, :2], field, self.hard_m - SEED_GIVE_M).free:
                seeds.insert(0, shifted)
        plan = best_plan(task, seeds, timed, Polytopes(field, self.aim_m))
        if isinstance(plan, str):
            return self._fallback(task, state, call, plan)
        return give(plan.x, plan.u, plan.verdict, source, "follows the key points")

    def _look_needed(
        self, state: LandState, key_points: Array, path: reference.Path, field: DistanceField
    ) -> float | None:
        """Heading to look to where a path ends before something that nobody has seen, or None.

        First along the path; where that is in view already, to the nearest of what it lacks beside it.
        """
        unseen = self._unseen(path.points_m[-1], field)
        if not len(unseen):
            return None
        wanted = reference.along(np.vstack([state.position_xy, key_points]), np.array([LOOK_TO_M]))[0]
        ahead = _off_rad(state, wanted[None])[0]
        if abs(ahead) <= VIEW_RAD:
            beside = _off_rad(state, unseen)
            beside = beside[np.abs(beside) > VIEW_RAD]
            if len(beside):
                ahead = beside[np.abs(beside).argmin()]
        return wrap_pi(state.yaw + float(ahead)) if abs(ahead) > LOOK_RAD else None

    def _turn_first(
        self, state: LandState, key_points: Array, path: reference.Path, field: DistanceField
    ) -> tuple[float, str] | None:
        """Heading to turn to before driving on and why, or None."""
        look = self._opening(state, key_points, path, field)
        if look is not None:
            return look, "looking where the path will lead"
        turn = self._turn_needed(state, path)
        if turn is None:
            return None
        return turn, f"turning by {math.degrees(wrap_pi(turn - state.yaw)):.0f} degrees towards the path"

    def _opening(
        self, state: LandState, key_points: Array, path: reference.Path, field: DistanceField
    ) -> float | None:
        """Heading to look to before setting out on a path that soon ends where nobody has seen, or None.

        A robot at rest turns in less time than it loses by driving up to there first. Where the path sets
        out in quite another direction it drives first: one turn would undo the other.
        """
        soon = path.blocked and BLOCKED_M <= path.length_m <= SOON_M
        if not soon or abs(state.speed) > SLOW_MPS or not len(self._unseen(path.points_m[-1], field)):
            return None
        way = np.vstack([state.position_xy, key_points])
        beyond = float(_off_rad(state, reference.along(way, np.array([path.length_m + BEYOND_M])))[0])
        first = float(_off_rad(state, path.at(LOOK_AHEAD_M)[None])[0])
        if abs(beyond) <= LOOK_RAD or abs(wrap_pi(first - beyond)) > TURN_RAD:
            return None
        return wrap_pi(state.yaw + beyond)

    def _unseen(self, end_m: Array, field: DistanceField) -> Array:
        """What of the surroundings of a path's end (2,) nobody has seen, (n, 2)."""
        around = np.linspace(0.0, 2.0 * math.pi, 16, endpoint=False)
        ring = end_m + (self.hard_m + 2.0 * field.cell_m) * np.column_stack([np.cos(around), np.sin(around)])
        out: Array = ring[~field.is_known(ring)]
        return out

    def _turn_needed(self, state: LandState, path: reference.Path) -> float | None:
        """Heading to turn to before driving on, or None."""
        length = path.length_m
        offset = path.at(min(LOOK_AHEAD_M, length)) - path.points_m[0]
        away = float(np.hypot(*offset))
        if length < ARRIVED_M or away < 1e-6:
            return None
        heading = math.atan2(offset[1], offset[0])
        error = abs(wrap_pi(heading - state.yaw))
        slow = abs(state.speed) < SLOW_MPS
        if length < CLOSE_M and not path.blocked:
            back = error > math.pi / 2.0
            bend = math.pi - error if back else error
            if slow and bend > TURN_CLOSE_RAD and away * math.sin(bend) > SIDE_M:
                return wrap_pi(heading + math.pi) if back else heading
            return None
        return heading if error > (TURN_RAD if slow else TURN_MOVING_RAD) else None

    def _fallback(self, task: Task, state: LandState, call: Call, why: str) -> RefineResult:
        previous = call.previous_of(Mode.LAND)
        if previous is not None and previous.end_s > call.now_s + STEP_S:
            seed = self._model.shifted(previous, call.now_s, task.x0)
            kept = task.solve(seed, seed[0][:, :2], None)
            if kept is not None and kept.verdict.may_leave:
                out = self._model.trajectory(kept.x, kept.u, state, call.now_s, Source.PREVIOUS)
                return call.result(out, kept.verdict, self.config.body.radius_m, why, stopped=True)
        x, u = self._model.brake(task.x0)
        out = self._model.trajectory(x, u, state, call.now_s, Source.BRAKE)
        return call.result(out, task.judge(x, u), self.config.body.radius_m, why, stopped=True)

    def brake(self, state: LandState, now_s: float) -> Trajectory:
        """To rest as fast as the limits allow, wherever that is."""
        x, u = self._model.brake(vector(state))
        return self._model.trajectory(x, u, state, now_s, Source.BRAKE)

    def turn(self, state: LandState, yaw_rad: float, now_s: float) -> Trajectory:
        """Turn on the spot to a heading in odom, the short way; a moving robot comes to rest meanwhile."""
        x, u = self._model.turn(vector(state), yaw_rad)
        return self._model.trajectory(x, u, state, now_s, Source.TURN)


def _off_rad(state: LandState, places_m: Array) -> Array:
    """Angles (n,) from the robot's heading to places (n, 2), -pi to pi."""
    offset = places_m - state.position_xy
    away = np.arctan2(offset[:, 1], offset[:, 0]) - state.yaw
    out: Array = np.arctan2(np.sin(away), np.cos(away))
    return out
