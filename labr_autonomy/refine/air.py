"""Flying: a triple integrator with x = (p, v, a) and u = jerk; the yaw follows the path and is not optimised.

Norms are limited through boxes that fit inside: horizontal speed by an octagon inscribed in the circle
(0.92 of the limit along its faces), horizontal acceleration and jerk by squares.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from labr_autonomy.config import AirLimits
from labr_autonomy.frames import wrap_pi
from labr_autonomy.refine import profile
from labr_autonomy.refine.problem import TIGHT, TOLERANCE, Bounds, Spec, problem_of
from labr_autonomy.refine.values import STEP_S, STEPS, AirState, grid_s
from labr_autonomy.types import Array, Mode, Source, Trajectory

SUB = 4  # dense samples an interval
YAW_ACCELERATION_RPS2 = 2.5  # a quad of this size reaches it without saturating its motors
OCTAGON = math.cos(math.pi / 8.0)  # distance of the faces of an octagon inscribed in the unit circle
_W_POSITION, _W_ACCELERATION, _W_JERK = 5.0, 0.02, 0.002
_DIAGONALS = np.array([[1.0, 1.0], [1.0, -1.0]]) / math.sqrt(2.0)


def _step(x: Any, u: Any) -> Any:
    h = STEP_S
    p, v, a = x[0:3], x[3:6], x[6:9]
    return ca.vertcat(
        p + h * v + h**2 / 2 * a + h**3 / 6 * u[:3], v + h * a + h**2 / 2 * u[:3], a + h * u[:3]
    )


def _cost(x: Any, u: Any, reference: Any) -> Any:
    error = x[:3] - reference
    cost = _W_POSITION * ca.dot(error, error) + _W_ACCELERATION * ca.dot(x[6:9], x[6:9])
    return cost if u is None else cost + _W_JERK * ca.dot(u[:3], u[:3])


SPEC = Spec("air", 3, 9, 3, _step, _cost, lambda x: x[3:9], lambda x: ca.DM(_DIAGONALS) @ x[3:5])


@dataclass(frozen=True, slots=True)
class Envelope:
    """What one flight leg may do, within the robot's limits."""

    speed_mps: float  # horizontal, norm
    climb_mps: float
    descend_mps: float
    acceleration_mps2: float  # horizontal norm, and vertical
    jerk_mps3: float  # horizontal norm, and vertical
    yaw_rate_rps: float
    height_min_m: float  # of the body origin in odom
    height_max_m: float

    @classmethod
    def of(cls, limits: AirLimits, floor_m: float, below_m: float) -> Envelope:
        """All that the limits allow above a floor."""
        return cls(
            limits.speed_mps,
            limits.climb_mps,
            limits.descend_mps,
            limits.acceleration_mps2,
            limits.jerk_mps3,
            limits.yaw_rate_rps,
            floor_m + below_m,
            floor_m + limits.height_max_m,
        )


def vector(state: AirState) -> Array:
    """The state as (9,)."""
    return np.concatenate([state.position, state.velocity, state.acceleration]).astype(float)


class AirModel:
    """Limits, simulation and seeds of the flying problem."""

    def __init__(self) -> None:
        self.problem = problem_of(SPEC)
        h, n = STEP_S, STEPS
        after = h * (n - 1 - np.arange(n))  # time left after each interval
        effect = np.stack([h**2 / 2 + h * after, np.full(n, h)])  # of each jerk on (v, a) at the end
        self._to_rest = np.linalg.pinv(effect)

    def bounds(self, x0: Array, env: Envelope) -> Bounds:
        """Bounds of variables and rows; a start beyond a limit is let down to it."""
        low, high = np.full(self.problem.size, -np.inf), np.full(self.problem.size, np.inf)
        row_low, row_high = self.problem.row_low.copy(), self.problem.row_high.copy()
        k = np.arange(1, STEPS + 1)
        root = math.sqrt(0.5)
        v0, a0 = x0[3:6], x0[6:9]
        square = np.array([root, root, 1.0])
        acceleration, jerk = TIGHT * env.acceleration_mps2 * square, TIGHT * env.jerk_mps3 * square
        for i in range(3):
            falls = np.abs(a0[i]) - 0.9 * jerk[i] * STEP_S * k
            high[self.problem.x_index[1:, 6 + i]] = np.maximum(acceleration[i], falls)
            low[self.problem.x_index[1:, 6 + i]] = -np.maximum(acceleration[i], falls)
            low[self.problem.u_index[:, i]], high[self.problem.u_index[:, i]] = -jerk[i], jerk[i]
        low[self.problem.u_index[:, -1]] = 0.0

        face = TIGHT * OCTAGON * env.speed_mps
        for i, (down, up) in enumerate(
            ((face, face), (face, face), (TIGHT * env.descend_mps, TIGHT * env.climb_mps))
        ):
            lo, hi = _speed_bounds(v0[i], a0[i], (down, up), acceleration[i], jerk[i])
            low[self.problem.x_index[1:, 3 + i]], high[self.problem.x_index[1:, 3 + i]] = lo, hi
        for j, rows in enumerate(self.problem.extra_rows.T):
            along_v, along_a = float(_DIAGONALS[j] @ v0[:2]), float(_DIAGONALS[j] @ a0[:2])
            row_low[rows], row_high[rows] = _speed_bounds(
                along_v, along_a, (face, face), acceleration[0], jerk[0]
            )
        spare = abs(v0[2]) * 0.6 + 0.1  # cannot turn round faster
        first = self.problem.x_index[1:13, 2]
        rest = self.problem.x_index[13:, 2]
        low[first] = min(env.height_min_m, x0[2] - spare)
        low[rest] = min(env.height_min_m, x0[2])
        high[first] = (
            max(env.height_max_m, x0[2] + spare) if x0[2] + spare > env.height_max_m else env.height_max_m
        )
        high[rest] = max(env.height_max_m, x0[2])
        return Bounds(low, high, row_low, row_high)

    def simulate(self, x0: Array, u: Array) -> Array:
        """States (n + 1, 9) under piecewise constant jerk (n, 3), exact."""
        h = STEP_S
        x = np.empty((len(u) + 1, 9))
        x[0] = x0
        x[1:, 6:] = x0[6:] + h * np.cumsum(u, axis=0)
        a = x[:-1, 6:]
        x[1:, 3:6] = x0[3:6] + np.cumsum(h * a + h**2 / 2 * u, axis=0)
        x[1:, :3] = x0[:3] + np.cumsum(h * x[:-1, 3:6] + h**2 / 2 * a + h**3 / 6 * u, axis=0)
        return x

    def settle(self, x0: Array, u: Array, limits: Bounds) -> tuple[Array, Array] | None:
        """Re-simulate, ending at rest exactly; None if that breaks a limit."""
        end = self.simulate(x0, u)[-1, 3:].reshape(2, 3)
        u = u - self._to_rest @ end
        x = self.simulate(x0, u)
        x[-1, 3:] = 0.0
        along = x[1:, 3:5] @ _DIAGONALS.T
        rows = self.problem.extra_rows
        diagonal = (along <= limits.row_high[rows] + TOLERANCE) & (along >= limits.row_low[rows] - TOLERANCE)
        return (x, u) if diagonal.all() and self.problem.inside(x, u, limits) else None

    def dense(self, x: Array, u: Array) -> Array:
        """Positions at four samples an interval and at the end, (4 n + 1, 3)."""
        p, v, a = x[:-1, :3], x[:-1, 3:6], x[:-1, 6:9]
        steps = STEP_S * np.arange(SUB) / SUB
        points: Array = np.stack([p + v * t + a * t**2 / 2 + u * t**3 / 6 for t in steps], axis=1).reshape(
            -1, 3
        )
        return np.concatenate([points, x[-1:, :3]])

    def cold(self, x0: Array, reference: Array) -> tuple[Array, Array]:
        """Seed from a timed reference (STEPS + 1, 3)."""
        velocity = np.gradient(reference, STEP_S, axis=0)
        x = np.concatenate([reference, velocity, np.gradient(velocity, STEP_S, axis=0)], axis=1)
        x[-1, 3:] = 0.0
        x[0] = x0
        return x, np.zeros((STEPS, 3))

    def shifted(self, previous: Trajectory, now_s: float, x0: Array) -> tuple[Array, Array]:
        """Seed from the previous plan at `now_s`, whatever part of a step has passed."""
        grid = np.linspace(previous.start_s, previous.end_s, len(previous.yaw_rad))
        t = now_s + grid_s(STEPS + 1)
        kept = np.concatenate(
            [previous.position_m, previous.velocity_mps, previous.acceleration_mps2], axis=1
        )
        x = np.stack([np.interp(t, grid, column) for column in kept.T], axis=1)
        u: Array = np.diff(x[:, 6:9], axis=0) / STEP_S
        x[0] = x0
        return x, u

    def brake(self, x0: Array, env: Envelope) -> Array:
        """To rest on each axis as fast as jerk and acceleration allow, (n, 9); as long as that takes."""
        phases = []
        for i in range(3):
            part = 1.0 if i == 2 else math.sqrt(0.5)
            phases.append(
                profile.ramp(x0[3 + i], x0[6 + i], 0.0, part * env.acceleration_mps2, part * env.jerk_mps3)
            )
        steps = max(2, math.ceil(max(profile.duration(p) for p in phases) / STEP_S - 1e-9))
        t = grid_s(steps + 1)
        axes = [profile.evaluate((x0[i], x0[3 + i], x0[6 + i]), phases[i], t) for i in range(3)]
        x: Array = np.stack(axes, axis=1).transpose(0, 2, 1).reshape(len(t), 9)
        x[-1, 3:] = 0.0
        return x


def _speed_bounds(
    v0: float, a0: float, limits: tuple[float, float], acceleration: float, jerk: float
) -> Array:
    """Lower and upper bound of one velocity at the nodes 1..STEPS, (2, STEPS); `limits` are (down, up)."""
    t = grid_s(STEPS + 1)[1:]
    out = []
    for sign, limit in ((-1.0, limits[0]), (1.0, limits[1])):
        v, push = sign * v0, max(0.0, sign * a0)
        peak = v + push**2 / (1.8 * jerk) + push * STEP_S / 2.0
        turned = push / (0.9 * jerk) + acceleration / jerk  # when it decelerates in full
        falls = peak + 0.02 - 0.5 * acceleration * np.maximum(0.0, t - turned)
        out.append(sign * (np.maximum(limit, falls) if peak > limit else np.full(STEPS, limit)))
    return np.array(out)


def trajectory(x: Array, yaw: Array, now_s: float, source: Source) -> Trajectory:
    """States (n, 9) and yaw with its rate (n, 2) as a trajectory in odom."""
    n = len(x)
    speed = x[:, 3] * np.cos(yaw[:, 0]) + x[:, 4] * np.sin(yaw[:, 0])
    return Trajectory(
        mode=Mode.AIR,
        start_s=now_s,
        step_s=STEP_S,
        position_m=x[:, :3].copy(),
        velocity_mps=x[:, 3:6].copy(),
        acceleration_mps2=x[:, 6:9].copy(),
        yaw_rad=yaw[:n, 0].copy(),
        yaw_rate_rps=yaw[:n, 1].copy(),
        speed_mps=speed,
        source=source,
    )


def follow_yaw(yaw_rad: float, rate_rps: float, wanted_rad: Array, rate_max_rps: float) -> Array:
    """Yaw and rate (n, 2) that chase the wanted headings (n,) and end at rest."""
    n = len(wanted_rad)
    out = np.empty((n, 2))
    out[0] = yaw_rad, rate_rps
    change = YAW_ACCELERATION_RPS2 * STEP_S
    for k in range(1, n):
        yaw, rate = out[k - 1]
        error = wrap_pi(float(wanted_rad[k]) - yaw)
        most = min(rate_max_rps, math.sqrt(1.6 * YAW_ACCELERATION_RPS2 * abs(error)), abs(error) / STEP_S)
        aim = math.copysign(most, error)
        aim = min(max(aim, rate - change), rate + change)
        rest = 0.98 * change * (n - 1 - k)
        aim = min(max(aim, -rest), rest)
        out[k] = yaw + (rate + aim) / 2.0 * STEP_S, aim
    return out
