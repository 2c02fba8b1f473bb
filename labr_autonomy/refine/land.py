"""Driving: a unicycle with x = (x, y, yaw, v, w) and u = (dv/dt, dw/dt)."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np

from labr_autonomy.config import LandLimits
from labr_autonomy.frames import wrap_pi
from labr_autonomy.refine import profile
from labr_autonomy.refine.limits import Limit, worst
from labr_autonomy.refine.problem import TIGHT, Bounds, Spec, problem_of
from labr_autonomy.refine.values import STEP_S, STEPS, LandState, grid_s
from labr_autonomy.types import Array, Mode, Source, Trajectory

SUB = 4  # dense samples an interval
ROOM = 5e-4  # [SI] left to the solver about the braking that a start beyond a limit leaves it
FINE = 20  # integration steps an interval where a rate has corners
_W_POSITION, _W_YAW_RATE, _W_ACCELERATION, _W_YAW_ACCELERATION = 5.0, 0.05, 0.05, 0.02


def _step(x: Any, u: Any) -> Any:
    """Runge-Kutta 4 over one interval."""

    def rate(x: Any) -> Any:
        return ca.vertcat(x[3] * ca.cos(x[2]), x[3] * ca.sin(x[2]), x[4], u[0], u[1])

    h = STEP_S
    k1 = rate(x)
    k2 = rate(x + h / 2 * k1)
    k3 = rate(x + h / 2 * k2)
    k4 = rate(x + h * k3)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def _cost(x: Any, u: Any, reference: Any) -> Any:
    error = x[:2] - reference
    cost = _W_POSITION * ca.dot(error, error) + _W_YAW_RATE * x[4] ** 2
    return cost if u is None else cost + _W_ACCELERATION * u[0] ** 2 + _W_YAW_ACCELERATION * u[1] ** 2


SPEC = Spec("land", 2, 5, 2, _step, _cost, lambda x: x[3:])


def vector(state: LandState) -> Array:
    """The state as (5,)."""
    return np.array([*state.position_xy, state.yaw, state.speed, state.yaw_rate])


class LandModel:
    """Limits, simulation and seeds of the driving problem."""

    def __init__(self, limits: LandLimits) -> None:
        self.limits = limits
        self.problem = problem_of(SPEC)

    def bounds(self, brake: tuple[Array, Array]) -> Bounds:
        """Bounds of variables and rows; from a start beyond a limit, `brake` (x, u) is within them too."""
        lim = self.limits
        low, high = np.full(self.problem.size, -np.inf), np.full(self.problem.size, np.inf)
        stops = brake[0][1 : STEPS + 1, 3:]
        stops = np.concatenate([stops, np.zeros((STEPS - len(stops), 2))])
        for i, down, up in (
            (3, lim.reverse_mps, lim.speed_mps),
            (4, lim.yaw_rate_rps, lim.yaw_rate_rps),
        ):
            high[self.problem.x_index[1:, i]] = np.maximum(TIGHT * up, stops[:, i - 3] + ROOM)
            low[self.problem.x_index[1:, i]] = np.minimum(-TIGHT * down, stops[:, i - 3] - ROOM)
        for i, rate in ((0, lim.acceleration_mps2), (1, lim.yaw_acceleration_rps2)):
            low[self.problem.u_index[:, i]] = -TIGHT * rate
            high[self.problem.u_index[:, i]] = TIGHT * rate
        low[self.problem.u_index[:, -1]] = 0.0
        return Bounds(low, high, self.problem.row_low, self.problem.row_high)

    def over(self, x: Array, u: Array, brake: tuple[Array, Array]) -> str:
        """The limit that a plan (n + 1, 5), (n, 2) breaks, "" if none; speeds are straight between nodes."""
        lim, (stops, pushes) = self.limits, brake
        v, w, v_b, w_b = x[:, 3], x[:, 4], stops[:, 3], stops[:, 4]
        turn, turns = lim.yaw_rate_rps, lim.yaw_acceleration_rps2
        return worst(
            (
                Limit("drives at {:.3f} m/s", v, lim.speed_mps, v_b),
                Limit("backs at {:.3f} m/s", -v, lim.reverse_mps, -v_b),
                Limit("turns at {:.2f} rad/s", np.abs(w), turn, np.abs(w_b)),
                Limit(
                    "accelerates by {:.2f} m/s^2",
                    np.abs(u[:, 0]),
                    lim.acceleration_mps2,
                    np.abs(pushes[:, 0]),
                ),
                Limit("turns by {:.2f} rad/s^2", np.abs(u[:, 1]), turns, np.abs(pushes[:, 1])),
            )
        )

    def simulate(self, x0: Array, u: Array) -> Array:
        """States (n + 1, 5) under piecewise constant u (n, 2); v, w are exact."""
        x = np.empty((len(u) + 1, 5))
        x[0] = x0
        x[1:, 3:] = x0[3:] + np.cumsum(u, axis=0) * STEP_S
        x[1:, 2] = x0[2] + np.cumsum(x[:-1, 4] * STEP_S + u[:, 1] * STEP_S**2 / 2)
        x[1:, :2] = x0[:2] + np.cumsum(_advance(x[:-1], u, STEP_S), axis=0)
        return x

    def settle(self, x0: Array, u: Array, limits: Bounds) -> tuple[Array, Array] | None:
        """Re-simulate, ending at rest exactly; None if that breaks a limit."""
        u = u - (x0[3:] + u.sum(axis=0) * STEP_S) / (len(u) * STEP_S)
        x = self.simulate(x0, u)
        x[-1, 3:] = 0.0
        return (x, u) if self.problem.inside(x, u, limits) else None

    def dense(self, x: Array, u: Array) -> Array:
        """Positions at four samples an interval and at the end, (4 n + 1, 2)."""
        out = [x[:-1, :2] + _advance(x[:-1], u, STEP_S * j / SUB) if j else x[:-1, :2] for j in range(SUB)]
        points: Array = np.stack(out, axis=1).reshape(-1, 2)
        return np.concatenate([points, x[-1:, :2]])

    def cold(self, x0: Array, reference: Array) -> tuple[Array, Array]:
        """Seed from a timed reference (STEPS + 1, 2): follow it, with the heading slewed along it."""
        x = np.zeros((STEPS + 1, 5))
        x[:, :2] = reference
        step = np.diff(reference, axis=0)
        speed = np.hypot(step[:, 0], step[:, 1]) / STEP_S
        heading = x0[2]
        for k in range(STEPS):
            if speed[k] > 0.02:
                ahead = math.atan2(step[k, 1], step[k, 0])
                turn = wrap_pi(ahead - heading)
                most = self.limits.yaw_rate_rps * STEP_S
                heading += min(max(turn, -most), most)
            x[k, 2] = heading
        x[-1, 2] = heading
        x[:-1, 3] = np.minimum(speed, self.limits.speed_mps)
        x[:-2, 4] = np.diff(x[:-1, 2]) / STEP_S
        x[0] = x0
        return x, np.zeros((STEPS, 2))

    def shifted(self, previous: Trajectory, now_s: float, x0: Array) -> tuple[Array, Array]:
        """Seed from the previous plan at `now_s`, whatever part of a step has passed."""
        t, grid = _times(previous, now_s)
        x = np.zeros((STEPS + 1, 5))
        x[:, 0] = np.interp(t, grid, previous.position_m[:, 0])
        x[:, 1] = np.interp(t, grid, previous.position_m[:, 1])
        yaw = np.interp(t, grid, previous.yaw_rad)
        x[:, 2] = yaw + x0[2] + wrap_pi(yaw[0] - x0[2]) - yaw[0]
        x[:, 3] = np.interp(t, grid, previous.speed_mps)
        x[:, 4] = np.interp(t, grid, previous.yaw_rate_rps)
        u: Array = np.diff(x[:, 3:], axis=0) / STEP_S
        x[0] = x0
        return x, u

    def trajectory(self, x: Array, u: Array, state: LandState, now_s: float, source: Source) -> Trajectory:
        """The plan as a trajectory in odom."""
        n = len(x)
        c, s, v, w = np.cos(x[:, 2]), np.sin(x[:, 2]), x[:, 3], x[:, 4]
        dv = np.append(u[:, 0], 0.0)
        zero = np.zeros(n)
        return Trajectory(
            mode=Mode.LAND,
            start_s=now_s,
            step_s=STEP_S,
            position_m=np.stack([x[:, 0], x[:, 1], np.full(n, state.height_m)], axis=1),
            velocity_mps=np.stack([v * c, v * s, zero], axis=1),
            acceleration_mps2=np.stack([dv * c - v * w * s, dv * s + v * w * c, zero], axis=1),
            yaw_rad=x[:, 2].copy(),
            yaw_rate_rps=w.copy(),
            speed_mps=v.copy(),
            source=source,
        )

    def brake(self, x0: Array) -> tuple[Array, Array]:
        """Speed and yaw rate to zero as fast as the limits allow; as many intervals as that takes."""
        rates = TIGHT * np.array([self.limits.acceleration_mps2, self.limits.yaw_acceleration_rps2])
        steps = max(2, math.ceil(float((np.abs(x0[3:]) / rates).max()) / STEP_S - 1e-9))
        left = np.abs(x0[3:])[None] - rates * STEP_S * np.arange(steps + 1)[:, None]
        u: Array = np.diff(np.sign(x0[3:]) * np.maximum(left, 0.0), axis=0) / STEP_S
        x = self.simulate(x0, u)
        x[-1, 3:] = 0.0
        return x, u

    def turn(self, x0: Array, yaw_rad: float) -> tuple[Array, Array]:
        """Turn to `yaw_rad` the short way while the speed goes to zero; as many intervals as that takes."""
        lim = self.limits
        rate = lim.yaw_rate_rps
        angle = wrap_pi(yaw_rad - x0[2])
        lasts = profile.turn_duration(angle, x0[4], rate, lim.yaw_acceleration_rps2)
        brake_u = self.brake(x0)[1]
        steps = max(len(brake_u), math.ceil(lasts / STEP_S))
        t = grid_s(steps + 1)
        turned = profile.turn_rates(angle, x0[4], rate, lim.yaw_acceleration_rps2, t)
        u: Array = np.zeros((steps, 2))
        u[: len(brake_u), 0] = brake_u[:, 0]
        u[:, 1] = np.diff(turned[:, 1]) / STEP_S
        x = self.simulate(x0, u)
        # the rate's corners lie inside intervals: headings from the closed form, places from a finer sum
        x[:, 2] = x0[2] + turned[:, 0]
        fine = np.linspace(0.0, t[-1], steps * FINE + 1)
        yaw = x0[2] + profile.turn_rates(angle, x0[4], rate, lim.yaw_acceleration_rps2, fine)[:, 0]
        speed = np.interp(fine, t, x[:, 3])
        rates = np.stack([speed * np.cos(yaw), speed * np.sin(yaw)], axis=1)
        way = np.cumsum((rates[1:] + rates[:-1]) / 2.0 * (STEP_S / FINE), axis=0)
        x[1:, :2] = x0[:2] + way[FINE - 1 :: FINE]
        x[-1, 3:] = 0.0
        return x, u


def _advance(x: Array, u: Array, h: float) -> Array:
    """Way covered in `h` from each row, (n, 2): Simpson's rule over the exact speed and heading."""

    def rate(t: float) -> Array:
        yaw = x[:, 2] + x[:, 4] * t + u[:, 1] * t**2 / 2
        v = x[:, 3] + u[:, 0] * t
        return np.stack([v * np.cos(yaw), v * np.sin(yaw)], axis=1)

    out: Array = h / 6 * (rate(0.0) + 4 * rate(h / 2) + rate(h))
    return out


def _times(previous: Trajectory, now_s: float) -> tuple[Array, Array]:
    """Stamps of the new nodes and of the old ones [s]."""
    grid = np.linspace(previous.start_s, previous.end_s, len(previous.yaw_rad))
    return now_s + grid_s(STEPS + 1), grid
