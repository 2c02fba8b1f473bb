"""Straight up or down at a held place: the manoeuvre of take-off and landing. Closed form, pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from labr_autonomy.types import Array, Mode, Source, Trajectory

STEP_S = 0.05
ACCELERATION_MPS2 = 0.8
YAW_ACCELERATION_RPS2 = 1.5
CLEAR_M = 0.25  # a climb turns from this height on: wheels on the floor would drag


def vertical(
    start_m: Array,
    yaw_rad: float,
    to_z_m: float,
    speed_mps: float,
    start_s: float,
    turn: tuple[float, float] = (0.0, 1.0),
) -> Trajectory:
    """Trapezoidal climb or descent from rest to rest.

    Args:
        start_m: (3,) odom; x and y are held.
        yaw_rad: Heading at the start.
        to_z_m: Height to end at, odom.
        speed_mps: Vertical speed, positive both ways.
        start_s: When it begins.
        turn: By so much [rad] the heading changes from `CLEAR_M` on, and how fast at most [rad/s]; the end is
            held until that is done.
    """
    turn_rad, yaw_rate_rps = turn
    rise = to_z_m - float(start_m[2])
    climb = _Trapezoid.of(abs(rise), speed_mps, ACCELERATION_MPS2)
    yaw = _Trapezoid.of(abs(turn_rad), yaw_rate_rps, YAW_ACCELERATION_RPS2)
    twice = _Trapezoid.of(2.0 * CLEAR_M, speed_mps, ACCELERATION_MPS2)  # half way through it is clear
    clear_s = 0.5 * twice.total_s
    total_s = max(climb.total_s, clear_s + yaw.total_s if turn_rad else 0.0)
    t = np.minimum(np.arange(0.0, total_s + STEP_S, STEP_S), total_s)
    s, v, a = climb.at(t)
    turned, rate, _ = yaw.at(t - clear_s)
    sign, side = math.copysign(1.0, rise), math.copysign(1.0, turn_rad)
    zero = np.zeros(len(t))
    x, y = np.full(len(t), start_m[0]), np.full(len(t), start_m[1])
    return Trajectory(
        mode=Mode.AIR,
        start_s=start_s,
        step_s=STEP_S,
        position_m=np.stack([x, y, start_m[2] + sign * s], axis=1),
        velocity_mps=np.stack([zero, zero, sign * v], axis=1),
        acceleration_mps2=np.stack([zero, zero, sign * a], axis=1),
        yaw_rad=yaw_rad + side * turned,
        yaw_rate_rps=side * rate,
        speed_mps=zero,
        source=Source.DIRECT,
    )


@dataclass(frozen=True, slots=True)
class _Trapezoid:
    """From rest to rest over a way: up to speed, on, and down."""

    acceleration: float
    ramp_s: float
    cruise_s: float

    @classmethod
    def of(cls, way: float, speed: float, acceleration: float) -> _Trapezoid:
        ramp_s = min(speed / acceleration, math.sqrt(way / acceleration))
        top = acceleration * ramp_s
        return cls(acceleration, ramp_s, max(0.0, (way - top * ramp_s) / top) if top > 0.0 else 0.0)

    @property
    def total_s(self) -> float:
        return 2.0 * self.ramp_s + self.cruise_s

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Way, speed and acceleration at times (n,); at rest before and after."""
        t = np.clip(t, 0.0, self.total_s)
        up = np.minimum(t, self.ramp_s)
        down = np.maximum(t - self.ramp_s - self.cruise_s, 0.0)
        middle = np.clip(t - self.ramp_s, 0.0, self.cruise_s)
        top, a = self.acceleration * self.ramp_s, self.acceleration
        s = 0.5 * a * up**2 + top * middle + top * down - 0.5 * a * down**2
        rest = np.where(t < self.ramp_s + self.cruise_s, 0.0, -a)
        return s, a * (up - down), np.where(t < self.ramp_s, a, rest)
