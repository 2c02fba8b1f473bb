"""Uniform cubic B-splines: position and derivatives, and the control points that meet given ends."""

from __future__ import annotations

import numpy as np

from labr_autonomy.types import Array

# De Boor: p(u) = [1 u u^2 u^3] @ BASIS @ [q0 q1 q2 q3] on one interval, u in 0..1.
BASIS = (
    np.array([[1.0, 4.0, 1.0, 0.0], [-3.0, 0.0, 3.0, 0.0], [3.0, -6.0, 3.0, 0.0], [-1.0, 3.0, -3.0, 1.0]])
    / 6.0
)


def evaluate(control_m: Array, step_s: float, times_s: Array) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration, (k, d) each, at times (k,) from the spline's beginning.

    Args:
        control_m: (n, d) control points; the spline has n - 3 intervals.
        step_s: Length of an interval; any parameter will do, not only time.
        times_s: Clamped to the spline.
    """
    intervals = len(control_m) - 3
    t = np.clip(np.asarray(times_s, float) / step_s, 0.0, intervals)
    at = np.minimum(t.astype(np.intp), intervals - 1)
    u = t - at
    one, zero = np.ones_like(u), np.zeros_like(u)
    near = control_m[at[:, None] + np.arange(4)]

    def mix(powers: Array) -> Array:
        out: Array = np.einsum("ki,kid->kd", powers.T @ BASIS, near)
        return out

    position = mix(np.stack([one, u, u**2, u**3]))
    velocity = mix(np.stack([zero, one, 2.0 * u, 3.0 * u**2])) / step_s
    acceleration = mix(np.stack([zero, zero, 2.0 * one, 6.0 * u])) / step_s**2
    return position, velocity, acceleration


def boundary(position_m: Array, velocity: Array, acceleration: Array, step_s: float) -> Array:
    """The three control points (3, d) of a spline that has these values where the second is centred."""
    middle = position_m - acceleration * step_s**2 / 6.0
    bend = acceleration * step_s**2 / 2.0
    return np.stack([middle - velocity * step_s + bend, middle, middle + velocity * step_s + bend])
