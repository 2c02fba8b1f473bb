"""Flying along a B-spline in time through the way on the map."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import wrap_pi
from labr_autonomy.perception.fields import Field3
from labr_autonomy.refine import profile
from labr_autonomy.refine.air import YAW_ACCELERATION_RPS2, follow_yaw
from labr_autonomy.refine.air_planner import TURN_AHEAD_M, turn_first
from labr_autonomy.refine.planner import Refiner
from labr_autonomy.refine.reference import along
from labr_autonomy.refine.values import STEP_S, AirState
from labr_autonomy.types import Array, Mode, Source, Trajectory
from sim.bench.mapping import bspline
from sim.bench.mapping.optimise import Aims, optimised
from sim.bench.mapping.timing import Made, braked, gained, judged, unknown_caps

INTERVAL_S = 0.25  # of the spline
ARC_M = 0.05
CRUISE = 0.92  # of the speed limit is planned with; the optimiser may use the rest
ACCELERATION = 0.5  # of the limit
SLOWER = (1.0, 0.75, 0.5)  # re-allocation of time while a limit is broken
HARDER = (1.0, 8.0)  # weight on obstacles while the curve touches one
SLACK = 1.005
ARRIVED_M = 0.03
HEIGHT_GIVE_M = 0.05
FACE_S, FACE_M = 0.6, 0.15  # it looks at where it will be then, if that is so far away


class Flight:
    """The flying half of the local planner.

    Args:
        config: The robot.
        refiner: For its closed-form brake, which is every method's own.
    """

    def __init__(self, config: RobotConfig, refiner: Refiner) -> None:
        self._lim = config.air
        self._refiner = refiner
        self._radius_m = config.body.radius_m
        self.hard_m = refiner.air_hard_m
        self.aim_m = max(config.body.radius_m + config.clearance.soft_m, self.hard_m + 0.05)

    def plan(
        self, state: AirState, rate_rps: float, way_m: Array, field: Field3, now_s: float, ceiling_m: float
    ) -> Made:
        """A trajectory from `state` along a way (k, 3) odom that starts there, or None and why.

        Args:
            state: Where it begins.
            rate_rps: Yaw rate there.
            way_m: What to follow.
            field: The map.
            now_s: Stamp of `state`.
            ceiling_m: Highest place of the body, odom.
        """
        length = float(np.linalg.norm(np.diff(way_m, axis=0), axis=1).sum())
        still = float(np.linalg.norm(state.velocity)) < 0.05
        if length < ARRIVED_M and still:
            return self._checked(self._refiner.brake_air(state, now_s), field, "there")
        turn = turn_first(state, along(way_m, np.array([TURN_AHEAD_M]))[0] - way_m[0])
        if turn is not None:
            made = self._turned(state, rate_rps, turn, field, now_s)
            if made.trajectory is not None:
                return made
        made = Made(None, math.nan, "")
        for harder in HARDER:
            for slower in SLOWER:
                control = self._spline(state, way_m, length, field, slower, harder)
                broken = self._broken(control, state, ceiling_m)
                if broken:
                    made = Made(None, math.nan, broken)
                    continue
                made = self._checked(
                    self._trajectory(control, state, rate_rps, now_s), field, "follows the way on the map"
                )
                if made.trajectory is not None:
                    return made
                break  # slower would touch it as well
        return made

    def _spline(
        self, state: AirState, way_m: Array, length: float, field: Field3, slower: float, harder: float
    ) -> Array:
        """Optimised control points (n, 3), every `INTERVAL_S`, at rest at the end of the way."""
        lim = self._lim
        count = max(3, math.ceil(length / ARC_M) + 1)
        spacing = max(length, 1e-3) / (count - 1)
        arcs = spacing * np.arange(float(count))
        points = along(way_m, arcs)
        leg = np.gradient(points, axis=0) / spacing
        across = np.maximum(np.hypot(leg[:, 0], leg[:, 1]), 1e-6)
        steep = np.maximum(np.abs(leg[:, 2]), 1e-6)
        vertical = np.where(leg[:, 2] > 0.0, lim.climb_mps, lim.descend_mps)
        a = ACCELERATION * lim.acceleration_mps2 * slower**2
        caps = slower * CRUISE * np.minimum(lim.speed_mps / across, vertical / steep)
        caps = np.minimum(caps, unknown_caps(points, arcs, field, self._radius_m, a))
        forward = float(state.velocity @ (points[min(8, count - 1)] - points[0]))
        first = max(forward, 0.0) / max(float(np.linalg.norm(points[min(8, count - 1)] - points[0])), 1e-6)
        speed = gained(braked(caps, spacing, a), spacing, a, first)
        mean = np.maximum(0.5 * (speed[1:] + speed[:-1]), 0.5 * math.sqrt(2.0 * a * spacing))
        reached = np.concatenate([[0.0], np.cumsum(spacing / mean)])
        intervals = max(4, math.ceil(float(reached[-1]) / INTERVAL_S) + 1)
        at = np.interp(INTERVAL_S * (np.arange(intervals + 3) - 1.0), reached, arcs)
        control = along(way_m, at)
        control[:3] = bspline.boundary(state.position, state.velocity, state.acceleration, INTERVAL_S)
        control[-3:] = way_m[-1]
        aims = Aims(
            self.aim_m,
            0.98 * lim.speed_mps,
            0.98 * lim.climb_mps,
            0.98 * lim.descend_mps,
            0.9 * lim.acceleration_mps2,
            smooth=4.0,
        ).harder(harder)
        return optimised(control, INTERVAL_S, field, aims)

    def _broken(self, control: Array, state: AirState, ceiling_m: float) -> str:
        """The limit that a spline breaks, "" if none; a start beyond one may come down to it."""
        lim = self._lim
        total = INTERVAL_S * (len(control) - 3)
        p, v, a = bspline.evaluate(control, INTERVAL_S, np.linspace(0.0, total, 5 * len(control)))
        jerk = np.diff(control, 3, axis=0) / INTERVAL_S**3
        v0, a0 = state.velocity, state.acceleration
        fast = float(np.hypot(v[:, 0], v[:, 1]).max())
        if fast > SLACK * max(lim.speed_mps, float(np.hypot(*v0[:2]))) + 1e-6:
            return f"{fast:.2f} m/s on the spline"
        if float(v[:, 2].max()) > SLACK * max(lim.climb_mps, v0[2]) + 1e-6:
            return "climbs too fast"
        if float(v[:, 2].min()) < SLACK * min(-lim.descend_mps, v0[2]) - 1e-6:
            return "descends too fast"
        flat = float(np.hypot(a[:, 0], a[:, 1]).max())
        if flat > SLACK * max(lim.acceleration_mps2, float(np.hypot(*a0[:2]))) + 1e-6:
            return f"{flat:.1f} m/s^2 on the spline"
        if float(np.abs(a[:, 2]).max()) > SLACK * max(lim.acceleration_mps2, abs(a0[2])) + 1e-6:
            return "vertical acceleration"
        sharp = max(float(np.hypot(jerk[:, 0], jerk[:, 1]).max()), float(np.abs(jerk[:, 2]).max()))
        if sharp > SLACK * lim.jerk_mps3:
            return f"{sharp:.0f} m/s^3 on the spline"
        if float(p[:, 2].max()) > max(ceiling_m, state.position[2]) + HEIGHT_GIVE_M:
            return "above the height limit"
        return ""

    def _trajectory(self, control: Array, state: AirState, rate_rps: float, now_s: float) -> Trajectory:
        total = INTERVAL_S * (len(control) - 3)
        times = STEP_S * np.arange(math.ceil(total / STEP_S - 1e-9) + 1.0)
        p, v, a = bspline.evaluate(control, INTERVAL_S, times)
        v[-1] = a[-1] = 0.0
        p[0], v[0], a[0] = state.position, state.velocity, state.acceleration
        ahead = p[np.minimum(np.arange(len(p)) + round(FACE_S / STEP_S), len(p) - 1)] - p
        wanted = np.empty(len(p))
        heading = state.yaw
        for k, (dx, dy, _) in enumerate(ahead):
            if math.hypot(dx, dy) > FACE_M:
                heading = math.atan2(dy, dx)
            wanted[k] = heading
        yaw = follow_yaw(state.yaw, rate_rps, wanted, self._lim.yaw_rate_rps)
        return Trajectory(
            mode=Mode.AIR,
            start_s=now_s,
            step_s=STEP_S,
            position_m=p,
            velocity_mps=v,
            acceleration_mps2=a,
            yaw_rad=yaw[:, 0].copy(),
            yaw_rate_rps=yaw[:, 1].copy(),
            speed_mps=v[:, 0] * np.cos(yaw[:, 0]) + v[:, 1] * np.sin(yaw[:, 0]),
            source=Source.SEARCH,
        )

    def _turned(self, state: AirState, rate_rps: float, heading: float, field: Field3, now_s: float) -> Made:
        """Come to a hover and turn to a heading."""
        brake = self._refiner.brake_air(state, now_s)
        angle = wrap_pi(heading - state.yaw)
        most = max(self._lim.yaw_rate_rps, abs(rate_rps))
        lasts = profile.turn_duration(angle, rate_rps, most, YAW_ACCELERATION_RPS2)
        more = max(0, math.ceil(lasts / STEP_S) + 1 - len(brake.yaw_rad))
        times = STEP_S * np.arange(len(brake.yaw_rad) + float(more))
        yaw = profile.turn_rates(angle, rate_rps, most, YAW_ACCELERATION_RPS2, times)
        yaw[-1, 1] = 0.0

        def longer(values: Array) -> Array:
            return np.concatenate([values, np.repeat(values[-1:], more, axis=0)])

        v = longer(brake.velocity_mps)
        at = state.yaw + yaw[:, 0]
        plan = replace(
            brake,
            position_m=longer(brake.position_m),
            velocity_mps=v,
            acceleration_mps2=longer(brake.acceleration_mps2),
            yaw_rad=at,
            yaw_rate_rps=yaw[:, 1].copy(),
            speed_mps=v[:, 0] * np.cos(at) + v[:, 1] * np.sin(at),
            source=Source.TURN,
        )
        return self._checked(plan, field, f"turning by {math.degrees(angle):.0f} degrees towards the way")

    def _checked(self, plan: Trajectory, field: Field3, why: str) -> Made:
        verdict = judged(plan, field, self.hard_m, 3)
        if verdict.free:
            return Made(plan, verdict.nearest_m, why)
        return Made(None, verdict.nearest_m, f"{why}: within {verdict.nearest_m:.2f} m of an obstacle")
