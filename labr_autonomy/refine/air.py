"""Flying: a triple integrator with x = (p, v, a) and u = jerk; the yaw follows the path and is not optimised.

Norms are limited through boxes that fit inside: horizontal speed by an octagon inscribed in the circle
(0.92 of the limit along its faces), horizontal acceleration and jerk by squares.

A velocity between two nodes is a parabola, and its nodes say nothing of its peak. The rows therefore limit
the point where the tangents of both ends meet, v + h a / 2: the control points of the velocity as a uniform
quadratic B-spline, which lies in their hull (de Boor, A Practical Guide to Splines). In the first interval,
whose control point is given, the jerk is limited so that the peak is not above the limit; where braking, too,
has later ones above it, the plan brakes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from labr_autonomy.config import AirLimits
from labr_autonomy.frames import wrap_pi
from labr_autonomy.refine.braking import brake_axis
from labr_autonomy.refine.limits import GIVE_M, Limit, worst
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


def _tangents(x: Any) -> Any:
    """Control points of the velocity after a node: along the axes, then along the diagonals."""
    meet = x[3:6] + STEP_S / 2 * x[6:9]
    return ca.vertcat(meet, ca.DM(_DIAGONALS) @ meet[:2])


SPEC = Spec("air", 3, 9, 3, _step, _cost, lambda x: x[3:9], _tangents)
SAME = 1e-6  # [m/s, m/s^2] a state that is nearer to a plan's moves as it says
ROOM = 5e-4  # [SI] left to the solver about the braking that a start beyond a limit leaves it


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

    def bounds(self, env: Envelope, brake: tuple[Array, Array]) -> Bounds:
        """Bounds of variables and rows; from a start beyond a limit, `brake` (x, u) is within them too."""
        low, high = np.full(self.problem.size, -np.inf), np.full(self.problem.size, np.inf)
        row_low, row_high = self.problem.row_low.copy(), self.problem.row_high.copy()
        stops, pushes = _over_horizon(*brake)
        x, u = self.problem.x_index[1:], self.problem.u_index

        def limit(down: float, up: float, braking: Array) -> tuple[Array, Array]:
            return np.minimum(-down, braking - ROOM), np.maximum(up, braking + ROOM)

        face = TIGHT * OCTAGON * env.speed_mps
        speeds = ((face, face), (face, face), (TIGHT * env.descend_mps, TIGHT * env.climb_mps))
        square = TIGHT * np.array([math.sqrt(0.5), math.sqrt(0.5), 1.0])
        meets = _meets(stops)
        for i, (down, up) in enumerate(speeds):
            jerk, acceleration = square[i] * env.jerk_mps3, square[i] * env.acceleration_mps2
            low[x[:, 6 + i]], high[x[:, 6 + i]] = limit(acceleration, acceleration, stops[1:, 6 + i])
            above, below = _until(meets[1:, i] > up), _until(-meets[1:, i] > down)
            high[x[:above, 6 + i]] = stops[1 : above + 1, 6 + i] + ROOM
            low[x[:below, 6 + i]] = stops[1 : below + 1, 6 + i] - ROOM
            low[x[:, 3 + i]], high[x[:, 3 + i]] = limit(down, up, stops[1:, 3 + i])
            rows = self.problem.extra_rows[:, i]
            row_low[rows], row_high[rows] = limit(down, up, meets[1:, i])
            low[u[:, i]], high[u[:, i]] = -jerk, jerk
            v, a = stops[0, 3 + i], stops[0, 6 + i]
            high[u[0, i]] = min(jerk, max(_steepest(v, a, high[x[0, 3 + i]]), pushes[0, i] + ROOM))
            low[u[0, i]] = max(-jerk, min(-_steepest(-v, -a, -low[x[0, 3 + i]]), pushes[0, i] - ROOM))
        for j, rows in enumerate(self.problem.extra_rows[:, 3:].T):
            row_low[rows], row_high[rows] = limit(face, face, meets[1:, 3 + j])
        low[u[:, -1]] = 0.0
        low[x[:, 2]] = np.minimum(env.height_min_m, stops[1:, 2] - ROOM)
        high[x[:, 2]] = np.maximum(env.height_max_m, stops[1:, 2] + ROOM)
        return Bounds(low, high, row_low, row_high)

    def over(self, x: Array, u: Array, env: Envelope, brake: tuple[Array, Array]) -> str:
        """The limit that a plan (n + 1, 9), (n, 3) breaks between its nodes or at them, "" if none.

        Tilt has no limit of its own: the norm of the acceleration bounds it.
        """
        (p, v, a), (p_b, v_b, a_b) = _motion(x), _motion(brake[0])
        j, j_b = u, brake[1]

        def flat(vectors: Array) -> Array:
            return np.hypot(vectors[:, 0], vectors[:, 1])

        acceleration, jerk = env.acceleration_mps2, env.jerk_mps3
        return worst(
            (
                Limit("flies at {:.3f} m/s", flat(v), env.speed_mps, flat(v_b)),
                Limit("climbs at {:.3f} m/s", v[:, 2], env.climb_mps, v_b[:, 2]),
                Limit("descends at {:.3f} m/s", -v[:, 2], env.descend_mps, -v_b[:, 2]),
                Limit("accelerates by {:.2f} m/s^2", flat(a), acceleration, flat(a_b)),
                Limit("rises by {:.2f} m/s^2", np.abs(a[:, 2]), acceleration, np.abs(a_b[:, 2])),
                Limit("jerks by {:.2f} m/s^3", flat(j), jerk, flat(j_b)),
                Limit("jerks upwards by {:.2f} m/s^3", np.abs(j[:, 2]), jerk, np.abs(j_b[:, 2])),
                Limit("climbs to {:.2f} m", p[:, 2], env.height_max_m, p_b[:, 2], GIVE_M),
                Limit("sinks to {:.2f} m", -p[:, 2], -env.height_min_m, -p_b[:, 2], GIVE_M),
            )
        )

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
        along = _meets(x)[1:]
        rows = self.problem.extra_rows
        kept = (along <= limits.row_high[rows] + TOLERANCE) & (along >= limits.row_low[rows] - TOLERANCE)
        return (x, u) if kept.all() and self.problem.inside(x, u, limits) else None

    def dense(self, x: Array, u: Array) -> Array:
        """Positions at four samples an interval and at the end, (4 n + 1, 3)."""
        return _motion(x)[0]

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

    def rest_of(self, previous: Trajectory, now_s: float, x0: Array) -> tuple[Array, Array] | None:
        """The rest of the previous plan from `now_s` on, moved to where the robot is, as long as that is.

        Returns:
            States (n + 1, 9) and jerks (n, 3); None where the robot moves otherwise than the plan says.
        """
        steps = max(2, math.ceil((previous.end_s - now_s) / STEP_S - 1e-9))
        motion = [previous.sample(now_s + STEP_S * k) for k in range(steps + 1)]
        x = np.array([np.concatenate([m.position_m, m.velocity_mps, m.acceleration_mps2]) for m in motion])
        if float(np.abs(x[0, 3:] - x0[3:]).max()) > SAME:
            return None
        x[:, :3] += x0[:3] - x[0, :3]
        x[0] = x0
        return x, np.diff(x[:, 6:], axis=0) / STEP_S

    def brake(self, x0: Array, env: Envelope) -> tuple[Array, Array]:
        """To rest on each axis in the fewest intervals that jerk and acceleration allow.

        Returns:
            States (n + 1, 9) and jerks (n, 3). No plan from `x0` keeps its peak speeds lower.
        """
        part = TIGHT * np.array([math.sqrt(0.5), math.sqrt(0.5), 1.0])
        axes = [
            brake_axis(x0[3 + i], x0[6 + i], part[i] * env.acceleration_mps2, part[i] * env.jerk_mps3)
            for i in range(3)
        ]
        a = np.zeros((max(len(axis) for axis in axes), 3))
        for i, axis in enumerate(axes):
            a[: len(axis), i] = axis
        u: Array = np.diff(a, axis=0) / STEP_S
        x = self.simulate(x0, u)
        x[-1, 3:] = 0.0
        return x, u


def _over_horizon(x: Array, u: Array) -> tuple[Array, Array]:
    """Braking as (STEPS + 1, 9) and (STEPS, 3): cut, or followed by rest."""
    rest = max(0, STEPS - len(u))
    x = np.concatenate([x, np.repeat(x[-1:], rest, axis=0)])
    u = np.concatenate([u, np.zeros((rest, 3))])
    return x[: STEPS + 1], u[:STEPS]


def _until(over: NDArray[np.bool_]) -> int:
    """How many nodes from 1 on end the intervals up to the last one marked (STEPS,), the first being 1."""
    return STEPS + 1 - int(over[::-1].argmax()) if over.any() else 0


def _meets(x: Array) -> Array:
    """`_tangents` of states (n, 9), (n, 5)."""
    meet = x[:, 3:6] + STEP_S / 2 * x[:, 6:9]
    return np.concatenate([meet, meet[:, :2] @ _DIAGONALS.T], axis=1)


def _motion(x: Array) -> tuple[Array, Array, Array]:
    """Positions, velocities and accelerations at `SUB` samples an interval and at the end, (SUB n + 1, 3).

    As `Trajectory.sample` has them between the nodes (n + 1, 9), so that what is checked is what is flown.
    """
    f = np.arange(SUB)[:, None] / SUB
    p, v, a = (x[:-1, None, i : i + 3] for i in (0, 3, 6))
    way = x[1:, None, :3] - p
    leaves, arrives = STEP_S * v - way, STEP_S * x[1:, None, 3:6] - way
    place = p + f * way + f * (1.0 - f) * ((1.0 - f) * leaves - f * arrives)
    velocity = (way + (1.0 - f) * (1.0 - 3.0 * f) * leaves - f * (2.0 - 3.0 * f) * arrives) / STEP_S
    acceleration = a + f * (x[1:, None, 6:] - a)
    out = [
        np.concatenate([values.reshape(-1, 3), x[-1:, i : i + 3]])
        for values, i in zip((place, velocity, acceleration), (0, 3, 6), strict=True)
    ]
    return out[0], out[1], out[2]


def _steepest(v: float, a: float, limit: float) -> float:
    """The most jerk in a first interval that keeps a velocity's peak there at the limit; inf without one."""
    if a <= 0.0 or v + 0.5 * STEP_S * a <= limit:
        return math.inf
    return -(a**2) / (2.0 * (limit - v)) if limit > v else -math.inf


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
