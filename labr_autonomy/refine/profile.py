"""Closed-form jerk-limited motion along one axis: ramps from any velocity and acceleration.

A profile is a list of phases of constant jerk. Source: the double and triple integrator's textbook
time-optimal ramps; no horizon limits them, so they also serve where the QP has no answer.
"""

from __future__ import annotations

import math

import numpy as np

from labr_autonomy.types import Array

Phases = list[tuple[float, float]]  # (jerk [m/s^3], duration [s])


def ramp(v0_mps: float, a0_mps2: float, v1_mps: float, limit_mps2: float, jerk_mps3: float) -> Phases:
    """Phases that bring (v0, a0) to (v1, 0) as fast as the limits allow."""
    drift = v0_mps - v1_mps + a0_mps2 * abs(a0_mps2) / (2.0 * jerk_mps3)  # left over when a is taken to 0
    sign = 1.0 if drift >= 0.0 else -1.0
    v, a = sign * (v0_mps - v1_mps), sign * a0_mps2  # now v must fall by decelerating
    need = v + a * a / (2.0 * jerk_mps3)
    limit = max(limit_mps2, abs(a0_mps2))
    peak = min(limit, math.sqrt(max(jerk_mps3 * need, 0.0)))
    hold = (need - peak * peak / jerk_mps3) / peak if peak > 1e-9 else 0.0
    return [
        (-sign * jerk_mps3, max(0.0, (a + peak) / jerk_mps3)),
        (0.0, max(0.0, hold)),
        (sign * jerk_mps3, peak / jerk_mps3),
    ]


def duration(phases: Phases) -> float:
    """Length of a profile [s]."""
    return sum(t for _, t in phases)


def evaluate(start: tuple[float, float, float], phases: Phases, times_s: Array) -> Array:
    """Position, velocity and acceleration (n, 3) at `times_s`; after the last phase it rests."""
    out = np.empty((len(times_s), 3))
    p, v, a = start
    begin = 0.0
    last = len(phases) - 1
    for i, (jerk, span) in enumerate(phases):
        here = times_s >= begin - 1e-12
        if i < last:
            here &= times_s < begin + span
        t = np.clip(times_s[here] - begin, 0.0, span)
        out[here, 0] = p + v * t + a * t**2 / 2 + jerk * t**3 / 6
        out[here, 1] = v + a * t + jerk * t**2 / 2
        out[here, 2] = a + jerk * t
        p, v, a = (
            p + v * span + a * span**2 / 2 + jerk * span**3 / 6,
            v + a * span + jerk * span**2 / 2,
            a + jerk * span,
        )
        begin += span
    beyond = times_s >= begin - 1e-12
    out[beyond] = [p + v * 0.0, 0.0, 0.0] if abs(v) < 1e-6 else [p, v, 0.0]
    return out


def travelled(v0_mps: float, a0_mps2: float, phases: Phases) -> float:
    """Distance covered by a profile [m]."""
    p, v, a = 0.0, v0_mps, a0_mps2
    for jerk, t in phases:
        p += v * t + a * t**2 / 2 + jerk * t**3 / 6
        v += a * t + jerk * t**2 / 2
        a += jerk * t
    return p


def move(
    v0_mps: float,
    a0_mps2: float,
    distance_m: float,
    speed_mps: tuple[float, float],
    limit_mps2: float,
    jerk_mps3: float,
) -> Phases:
    """Phases from (v0, a0) to rest `distance_m` away; `speed_mps` (down, up) are positive cruise limits.

    The distance grows with the cruise velocity, so that the right one is found by bisection; a start that
    cannot stop in time overshoots and comes back.
    """

    def via(cruise: float, hold: float = 0.0) -> Phases:
        return [
            *ramp(v0_mps, a0_mps2, cruise, limit_mps2, jerk_mps3),
            (0.0, hold),
            *ramp(cruise, 0.0, 0.0, limit_mps2, jerk_mps3),
        ]

    low, high = -speed_mps[0], speed_mps[1]
    for cruise in (low, high):
        rest = distance_m - travelled(v0_mps, a0_mps2, via(cruise))
        if rest * cruise >= 0.0:
            return via(cruise, rest / cruise)
    for _ in range(60):
        middle = (low + high) / 2.0
        if travelled(v0_mps, a0_mps2, via(middle)) < distance_m:
            low = middle
        else:
            high = middle
    return via((low + high) / 2.0)


def turn_rates(
    angle_rad: float, rate0_rps: float, rate_max_rps: float, acceleration_rps2: float, times_s: Array
) -> Array:
    """Angle turned and yaw rate (n, 2) of the fastest turn by `angle_rad` from `rate0_rps` to rest."""
    # a double integrator is a triple one with a jerk so high that the ramps have no round corners
    steep = 1e6 * acceleration_rps2
    limit = max(rate_max_rps, 1e-3)
    phases = move(rate0_rps, 0.0, angle_rad, (limit, limit), acceleration_rps2, steep)
    out: Array = evaluate((0.0, rate0_rps, 0.0), phases, times_s)[:, :2]
    return out


def turn_duration(angle_rad: float, rate0_rps: float, rate_max_rps: float, acceleration_rps2: float) -> float:
    """How long that turn takes [s]."""
    steep = 1e6 * acceleration_rps2
    return duration(move(rate0_rps, 0.0, angle_rad, (rate_max_rps, rate_max_rps), acceleration_rps2, steep))
