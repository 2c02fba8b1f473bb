"""Driving along a B-spline through the way on the map."""

from __future__ import annotations

import math

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import wrap_pi
from labr_autonomy.perception.fields import Field2
from labr_autonomy.refine.land import vector
from labr_autonomy.refine.planner import Refiner
from labr_autonomy.refine.reference import along
from labr_autonomy.refine.values import LandState
from labr_autonomy.types import Array, Mode, Source, Trajectory
from sim.bench.mapping import bspline, unicycle
from sim.bench.mapping.optimise import Aims, optimised
from sim.bench.mapping.timing import Made, braked, judged, unknown_caps

PITCH_M = 0.3  # between control points
CURVE_M = 0.04  # between points of the curve that is followed
ARRIVED_M = 0.08  # nearer to the end of the way the robot stays
LOOK_AHEAD_M = 0.5  # where along the way its heading is taken
TURN_RAD, TURN_MOVING_RAD, TURN_CLOSE_RAD = math.radians(50.0), math.radians(90.0), math.radians(25.0)
TURN_BLOCKED_RAD = math.radians(15.0)  # turned first where no curve from the present heading is free
CLOSE_M, SLOW_MPS = 0.5, 0.25
BENDING_MPS = 0.15  # slower than this the spline does not start with the present yaw rate
CURVATURE_MAX = 2.5  # 1/m, wanted of control points
BRAKE_PART = 0.85  # of the acceleration is planned with; the rest is left to follow it
TURN_PART = 0.85  # of the yaw rate, likewise
HARDER = (1.0, 8.0)  # weight on obstacles, one attempt each


class Ground:
    """The driving half of the local planner.

    Args:
        config: The robot.
        refiner: For its closed-form turns and brakes, which are every method's own.
    """

    def __init__(self, config: RobotConfig, refiner: Refiner) -> None:
        self._lim = config.land
        self._refiner = refiner
        self._radius_m = config.body.radius_m
        self.hard_m = refiner.land_hard_m
        self.aim_m = config.body.radius_m + config.clearance.soft_m

    def plan(self, state: LandState, way_m: Array, field: Field2, now_s: float) -> Made:
        """A trajectory from `state` along a way (k, 2) odom that starts there, or None and why."""
        length = float(np.hypot(*np.diff(way_m, axis=0).T).sum())
        if length < ARRIVED_M:
            return self._checked(self._refiner.brake_land(state, now_s), field, "there")
        turn = self._turn_needed(state, way_m, length)
        if turn is not None:
            return self._turned(state, turn, field, now_s)
        made = Made(None, math.nan, "")
        for harder in HARDER:
            curve = self._curve(state, way_m, length, field, harder)
            made = self._followed(state, curve, field, now_s)
            if made.trajectory is not None:
                return made
        heading = _heading(way_m, min(LOOK_AHEAD_M, length))
        if abs(wrap_pi(heading - state.yaw)) > TURN_BLOCKED_RAD:
            turned = self._turned(state, heading, field, now_s)
            if turned.trajectory is not None:
                return turned
        return made

    def _turn_needed(self, state: LandState, way_m: Array, length: float) -> float | None:
        heading = _heading(way_m, min(LOOK_AHEAD_M, length))
        error = abs(wrap_pi(heading - state.yaw))
        slow = abs(state.speed) < SLOW_MPS
        most = (TURN_CLOSE_RAD if length < CLOSE_M else TURN_RAD) if slow else TURN_MOVING_RAD
        return heading if error > most else None

    def _turned(self, state: LandState, heading: float, field: Field2, now_s: float) -> Made:
        degrees = math.degrees(wrap_pi(heading - state.yaw))
        plan = self._refiner.turn(state, heading, now_s)
        return self._checked(plan, field, f"turning by {degrees:.0f} degrees towards the way")

    def _curve(self, state: LandState, way_m: Array, length: float, field: Field2, harder: float) -> Array:
        """The optimised spline as points (n, 4): x, y, heading, curvature, evenly spaced."""
        intervals = max(3, round(length / PITCH_M))
        pitch = length / intervals
        control = np.zeros((intervals + 3, 3))
        control[:, :2] = along(way_m, pitch * np.arange(-1.0, intervals + 2.0))
        ahead = np.array([math.cos(state.yaw), math.sin(state.yaw)])
        bend = 0.0
        if state.speed > BENDING_MPS:
            bend = min(max(state.yaw_rate / state.speed, -CURVATURE_MAX), CURVATURE_MAX)
        sideways = np.array([-ahead[1], ahead[0]]) * bend * pitch**2
        control[:3, :2] = bspline.boundary(np.asarray(state.position_xy), ahead * pitch, sideways, 1.0)
        out = control[-3, :2] - way_m[-1]
        size = float(np.hypot(*out))
        final = -out / size if size > 1e-6 else ahead
        control[-3:, :2] = bspline.boundary(way_m[-1], final * pitch, np.zeros(2), 1.0)
        aims = Aims(
            self.aim_m, 1.3 * pitch, math.inf, math.inf, CURVATURE_MAX * pitch**2, limits=20.0
        ).harder(harder)
        control = optimised(control, 1.0, field, aims)
        fine = bspline.evaluate(control[:, :2], 1.0, np.linspace(0.0, intervals, 12 * intervals + 1))[0]
        reached = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(fine, axis=0).T))])
        count = max(3, math.ceil(reached[-1] / CURVE_M) + 1)
        u = np.interp(
            np.linspace(0.0, reached[-1], count), reached, np.linspace(0.0, intervals, len(reached))
        )
        p, v, a = bspline.evaluate(control[:, :2], 1.0, u)
        speed = np.maximum(np.hypot(v[:, 0], v[:, 1]), 1e-6)
        curvature = (v[:, 0] * a[:, 1] - v[:, 1] * a[:, 0]) / speed**3
        heading = np.unwrap(np.arctan2(v[:, 1], v[:, 0]))
        return np.column_stack([p, heading, np.clip(curvature, -20.0, 20.0)])

    def _followed(self, state: LandState, curve: Array, field: Field2, now_s: float) -> Made:
        lim = self._lim
        spacing = float(np.hypot(*np.diff(curve[:, :2], axis=0).T).mean())
        arcs = spacing * np.arange(float(len(curve)))
        bend = np.abs(curve[:, 3])
        change = np.abs(np.gradient(curve[:, 3], spacing))
        caps = np.minimum(lim.speed_mps, TURN_PART * lim.yaw_rate_rps / np.maximum(bend, 1e-6))
        caps = np.minimum(caps, np.sqrt(TURN_PART * lim.yaw_acceleration_rps2 / np.maximum(change, 1e-6)))
        caps = np.maximum(caps, 0.1)
        brake = BRAKE_PART * lim.acceleration_mps2
        caps = np.minimum(caps, unknown_caps(curve[:, :2], arcs, field, self._radius_m, brake))
        rates = np.array([lim.acceleration_mps2, lim.yaw_rate_rps, lim.yaw_acceleration_rps2])
        x = unicycle.rollout(vector(state), curve, braked(caps, spacing, brake), spacing, rates)
        plan = _trajectory(x, state.height_m, now_s)
        if plan.end_s - now_s > unicycle.LONGEST_S + 5.0:
            return Made(None, math.nan, "the curve could not be followed to rest")
        return self._checked(plan, field, "follows the way on the map")

    def _checked(self, plan: Trajectory, field: Field2, why: str) -> Made:
        verdict = judged(plan, field, self.hard_m, 2)
        if verdict.free:
            return Made(plan, verdict.nearest_m, why)
        return Made(None, verdict.nearest_m, f"{why}: within {verdict.nearest_m:.2f} m of an obstacle")


def _heading(way_m: Array, arc_m: float) -> float:
    offset = along(way_m, np.array([arc_m]))[0] - way_m[0]
    return math.atan2(offset[1], offset[0])


def _trajectory(x: Array, height_m: float, now_s: float) -> Trajectory:
    c, s, v, w = np.cos(x[:, 2]), np.sin(x[:, 2]), x[:, 3], x[:, 4]
    zero = np.zeros(len(x))
    return Trajectory(
        mode=Mode.LAND,
        start_s=now_s,
        step_s=unicycle.STEP_S,
        position_m=np.column_stack([x[:, :2], np.full(len(x), height_m)]),
        velocity_mps=np.column_stack([v * c, v * s, zero]),
        acceleration_mps2=np.column_stack([x[:, 5] * c - v * w * s, x[:, 5] * s + v * w * c, zero]),
        yaw_rad=x[:, 2].copy(),
        yaw_rate_rps=w.copy(),
        speed_mps=v.copy(),
        source=Source.SEARCH,
    )
