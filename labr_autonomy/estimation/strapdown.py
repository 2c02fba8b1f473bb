"""Compiled dead reckoning of the error-state filter: nominal state and covariance over one IMU interval.

After J. Sola, "Quaternion kinematics for the error-state Kalman filter" (2017), sections 5 and 7.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def turn_into(q: Any, rx: float, ry: float, rz: float, out_q: Any, out: Any) -> None:
    """Product q * exp(rotation), normalised, as quaternion and as matrix."""
    angle = math.sqrt(rx * rx + ry * ry + rz * rz)
    s = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    bw, bx, by, bz = math.cos(0.5 * angle), rx * s, ry * s, rz * s
    w = q[0] * bw - q[1] * bx - q[2] * by - q[3] * bz
    x = q[0] * bx + q[1] * bw + q[2] * bz - q[3] * by
    y = q[0] * by - q[1] * bz + q[2] * bw + q[3] * bx
    z = q[0] * bz + q[1] * by - q[2] * bx + q[3] * bw
    n = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w * n, x * n, y * n, z * n
    out_q[0], out_q[1], out_q[2], out_q[3] = w, x, y, z
    out[0, 0], out[0, 1], out[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    out[1, 0], out[1, 1], out[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    out[2, 0], out[2, 1], out[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def advance(
    position_m: Floats,
    velocity_mps: Floats,
    quaternion: Floats,
    covariance: Floats,
    force_mps2: Floats,
    rate_rps: Floats,
    dt_s: float,
    gravity_mps2: float,
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Nominal state and covariance after `dt_s`, without process noise.

    Args:
        position_m: (3,) odom.
        velocity_mps: (3,) odom.
        quaternion: (4,) wxyz, body to odom.
        covariance: (15, 15) of position, velocity, rotation, gyroscope and accelerometer bias.
        force_mps2: (3,) specific force without bias, body.
        rate_rps: (3,) angular velocity without bias, body.
        dt_s: Interval.
        gravity_mps2: Strength of gravity.

    Returns:
        Position, velocity, quaternion, rotation matrix (3, 3), covariance.
    """
    dt = dt_s
    spare, half, turned, rotation = np.empty(4), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    q = np.empty(4)
    rx, ry, rz = rate_rps[0] * dt, rate_rps[1] * dt, rate_rps[2] * dt
    turn_into(quaternion, 0.5 * rx, 0.5 * ry, 0.5 * rz, spare, half)  # attitude in the middle of the step
    turn_into(quaternion, rx, ry, rz, q, rotation)
    spare[0], spare[1], spare[2], spare[3] = 1.0, 0.0, 0.0, 0.0
    turn_into(spare.copy(), -rx, -ry, -rz, spare, turned)
    position, velocity = np.empty(3), np.empty(3)
    f = np.eye(15)
    a, b, c = force_mps2[0], force_mps2[1], force_mps2[2]
    for i in range(3):
        pull = half[i, 0] * a + half[i, 1] * b + half[i, 2] * c - (gravity_mps2 if i == 2 else 0.0)
        position[i] = position_m[i] + velocity_mps[i] * dt + pull * (0.5 * dt * dt)
        velocity[i] = velocity_mps[i] + pull * dt
        f[i, 3 + i] = dt
        f[6 + i, 9 + i] = -dt
        # half @ skew(force) * -dt
        f[3 + i, 6] = -dt * (half[i, 1] * c - half[i, 2] * b)
        f[3 + i, 7] = -dt * (half[i, 2] * a - half[i, 0] * c)
        f[3 + i, 8] = -dt * (half[i, 0] * b - half[i, 1] * a)
        for j in range(3):
            f[3 + i, 12 + j] = -dt * half[i, j]
            f[i, 6 + j] = f[3 + i, 6 + j] * (0.5 * dt)
            f[i, 12 + j] = f[3 + i, 12 + j] * (0.5 * dt)
            f[6 + i, 6 + j] = turned[i, j]
    left = np.zeros((15, 15))
    for i in range(15):  # f is mostly zeros
        for k in range(15):
            if f[i, k] != 0.0:
                for j in range(15):
                    left[i, j] += f[i, k] * covariance[k, j]
    out = np.zeros((15, 15))
    for j in range(15):
        for k in range(15):
            if f[j, k] != 0.0:
                for i in range(15):
                    out[i, j] += left[i, k] * f[j, k]
    return position, velocity, q, rotation, out


def warm_up() -> None:
    """Compile or load the kernel, so that the first reading of a flight is not late."""
    zero = np.zeros(3)
    advance(zero, zero, np.array([1.0, 0.0, 0.0, 0.0]), np.eye(15), zero, zero, 0.02, 9.8)
