"""Straight up or down at a held place: the manoeuvre of take-off and landing. Closed form, pure."""

from __future__ import annotations

import math

import numpy as np

from labr_autonomy.types import Array, Mode, Source, Trajectory

STEP_S = 0.05
ACCELERATION_MPS2 = 0.8


def vertical(start_m: Array, yaw_rad: float, to_z_m: float, speed_mps: float, start_s: float) -> Trajectory:
    """Trapezoidal climb or descent from rest to rest.

    Args:
        start_m: (3,) odom; x and y are held.
        yaw_rad: Heading, held.
        to_z_m: Height to end at, odom.
        speed_mps: Vertical speed, positive both ways.
        start_s: When it begins.
    """
    rise = to_z_m - float(start_m[2])
    way, sign = abs(rise), math.copysign(1.0, rise)
    ramp_s = min(speed_mps / ACCELERATION_MPS2, math.sqrt(way / ACCELERATION_MPS2))
    top = ACCELERATION_MPS2 * ramp_s
    cruise_s = max(0.0, (way - top * ramp_s) / top) if top > 0.0 else 0.0
    total_s = 2.0 * ramp_s + cruise_s
    t = np.arange(0.0, total_s + STEP_S, STEP_S)
    t = np.minimum(t, total_s)
    up = np.minimum(t, ramp_s)
    down = np.maximum(t - ramp_s - cruise_s, 0.0)
    middle = np.clip(t - ramp_s, 0.0, cruise_s)
    s = 0.5 * ACCELERATION_MPS2 * up**2 + top * middle + top * down - 0.5 * ACCELERATION_MPS2 * down**2
    v = ACCELERATION_MPS2 * (up - down)
    a = np.where(t < ramp_s, ACCELERATION_MPS2, np.where(t < ramp_s + cruise_s, 0.0, -ACCELERATION_MPS2))
    zero = np.zeros(len(t))
    x, y = np.full(len(t), start_m[0]), np.full(len(t), start_m[1])
    return Trajectory(
        mode=Mode.AIR,
        start_s=start_s,
        step_s=STEP_S,
        position_m=np.stack([x, y, start_m[2] + sign * s], axis=1),
        velocity_mps=np.stack([zero, zero, sign * v], axis=1),
        acceleration_mps2=np.stack([zero, zero, sign * a], axis=1),
        yaw_rad=np.full(len(t), yaw_rad),
        yaw_rate_rps=zero,
        speed_mps=zero,
        source=Source.DIRECT,
    )
