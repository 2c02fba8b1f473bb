"""Compiled corrections of the error-state filter: one pose or one reading of the wheels moved into the state.

After J. Sola, "Quaternion kinematics for the error-state Kalman filter" (2017), section 6, with the
innovation's Cholesky factor in place of its inverse.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from labr_autonomy.estimation.strapdown import turn_into

Floats = NDArray[np.float64]


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _factored(innovation: Any) -> bool:
    """Lower Cholesky factor in place; False when the matrix is not positive definite."""
    n = len(innovation)
    for j in range(n):
        for i in range(j, n):
            left = innovation[i, j]
            for k in range(j):
                left -= innovation[i, k] * innovation[j, k]
            if i == j:
                if not left > 0.0:
                    return False
                innovation[j, j] = math.sqrt(left)
            else:
                innovation[i, j] = left / innovation[j, j]
    return True


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _whitened(factor: Any, rows: Any) -> Any:
    """Rows (k, m) times the transposed inverse of the lower factor (m, m)."""
    out = np.empty(rows.shape)
    for r in range(len(rows)):
        for j in range(len(factor)):
            left = rows[r, j]
            for k in range(j):
                left -= out[r, k] * factor[j, k]
            out[r, j] = left / factor[j, j]
    return out


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def correction(
    covariance: Floats, cross: Floats, innovation: Floats, residual: Floats, gate: float
) -> tuple[Floats, Floats, float]:
    """Error and covariance after a measurement.

    Args:
        covariance: (15, 15) before.
        cross: (15, m) covariance of the error with what is measured.
        innovation: (m, m) covariance of the residual; changed.
        residual: (m,) measured less expected.
        gate: Largest believed squared Mahalanobis distance.

    Returns:
        The error (15,), the covariance (15, 15) and the squared distance; error and covariance count only
        when the distance is not above the gate. It is NaN when the innovation is no covariance.
    """
    n, m = cross.shape
    error, after = np.zeros(n), covariance.copy()
    if not _factored(innovation):
        return error, after, math.nan
    white = _whitened(innovation, residual.reshape(1, m))[0]
    distance = 0.0
    for k in range(m):
        distance += white[k] * white[k]
    if not distance <= gate:
        return error, after, distance
    gain = _whitened(innovation, cross)
    for i in range(n):
        for k in range(m):
            error[i] += gain[i, k] * white[k]
        for j in range(i + 1):
            taken = 0.0
            for k in range(m):
                taken += gain[i, k] * gain[j, k]
            both = 0.5 * (covariance[i, j] + covariance[j, i]) - taken
            after[i, j] = after[j, i] = both
    return error, after, distance


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _rotation_between(q: Any, target: Any, out: Any) -> None:
    """Rotation vector in body (3,) [rad] that turns attitude `q` into `target`."""
    w = q[0] * target[0] + q[1] * target[1] + q[2] * target[2] + q[3] * target[3]
    x = q[0] * target[1] - q[1] * target[0] - q[2] * target[3] + q[3] * target[2]
    y = q[0] * target[2] + q[1] * target[3] - q[2] * target[0] - q[3] * target[1]
    z = q[0] * target[3] - q[1] * target[2] + q[2] * target[1] - q[3] * target[0]
    n = math.sqrt(x * x + y * y + z * z)
    if n < 1e-12:
        out[0] = out[1] = out[2] = 0.0
        return
    scale = 2.0 * math.atan2(n, abs(w)) / n * (1.0 if w >= 0.0 else -1.0)
    out[0], out[1], out[2] = x * scale, y * scale, z * scale


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def vio(
    position_m: Floats,
    velocity_mps: Floats,
    quaternion: Floats,
    covariance: Floats,
    seen_m: Floats,
    seen_mps: Floats,
    seen_quaternion: Floats,
    seen_covariance: Floats,
    sigmas: tuple[float, float, float],
    gate: float,
) -> tuple[Floats, Floats, float]:
    """`correction` by a pose and a velocity.

    Args:
        position_m: (3,) odom.
        velocity_mps: (3,) odom.
        quaternion: (4,) wxyz, body to odom.
        covariance: (15, 15) of position, velocity, rotation, gyroscope and accelerometer bias.
        seen_m: (3,) measured position.
        seen_mps: (3,) measured velocity.
        seen_quaternion: (4,) measured attitude.
        seen_covariance: (6, 6) of measured position and rotation.
        sigmas: Least of the position [m], of the rotation [rad]; of the velocity [m/s].
        gate: Largest believed squared Mahalanobis distance, chi-square of 9.
    """
    residual = np.empty(9)
    _rotation_between(quaternion, seen_quaternion, residual[6:])
    innovation = covariance[:9, :9].copy()
    for i in range(3):
        residual[i] = seen_m[i] - position_m[i]
        residual[3 + i] = seen_mps[i] - velocity_mps[i]
        innovation[3 + i, 3 + i] += sigmas[2] ** 2
        for j in range(3):
            place, turn = seen_covariance[i, j], seen_covariance[3 + i, 3 + j]
            innovation[i, j] += max(place, sigmas[0] ** 2) if i == j else place
            innovation[6 + i, 6 + j] += max(turn, sigmas[1] ** 2) if i == j else turn
            innovation[i, 6 + j] += seen_covariance[i, 3 + j]
            innovation[6 + j, i] += seen_covariance[i, 3 + j]
    error, after, distance = correction(covariance, covariance[:, :9], innovation, residual, gate)
    return error, after, distance


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def wheels(
    velocity_mps: Floats,
    rotation: Floats,
    covariance: Floats,
    speed_mps: float,
    variances: tuple[float, float, float],
    gates: tuple[float, float],
) -> tuple[Floats, Floats, float, float]:
    """`correction` by the wheels: forward speed as measured, none sideways and none upwards (body frame).

    Args:
        velocity_mps: (3,) odom.
        rotation: (3, 3) body to odom.
        covariance: (15, 15), see `vio`.
        speed_mps: Forward speed by the encoders.
        variances: Of the speed, sideways and upwards [m^2/s^2].
        gates: Largest believed squared Mahalanobis distance of the speed (chi-square of 1) and of the two
            others (chi-square of 2).

    Returns:
        Error, covariance, and the two distances; error and covariance are those of the parts believed.
    """
    body = np.empty(3)
    h = np.zeros((3, 6))  # with respect to velocity and rotation
    for i in range(3):
        body[i] = 0.0
        for k in range(3):
            body[i] += rotation[k, i] * velocity_mps[k]
            h[i, k] = rotation[k, i]
    x, y, z = body[0], body[1], body[2]
    h[0, 4], h[0, 5] = -z, y
    h[1, 3], h[1, 5] = z, -x
    h[2, 3], h[2, 4] = -y, x
    cross = np.zeros((15, 3))
    for i in range(15):
        for j in range(3):
            for k in range(6):
                cross[i, j] += covariance[i, 3 + k] * h[j, k]
    innovation = np.zeros((3, 3))
    for i in range(3):
        innovation[i, i] = variances[i]
        for j in range(3):
            for k in range(6):
                innovation[i, j] += h[i, k] * cross[3 + k, j]
    residual = -body
    residual[0] += speed_mps
    left, up = residual[1], residual[2]
    a, b, c = innovation[1, 1], innovation[1, 2], innovation[2, 2]
    slip = residual[0] * residual[0] / innovation[0, 0]
    side = (c * left * left - 2.0 * b * left * up + a * up * up) / (a * c - b * b)
    first = 0 if slip <= gates[0] else 1
    last = 3 if side <= gates[1] else 1
    error, after, _ = correction(
        covariance,
        cross[:, first:last].copy(),
        innovation[first:last, first:last].copy(),
        residual[first:last].copy(),
        math.inf,
    )
    return error, after, slip, side


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def turned_by(quaternion: Floats, rotation_rad: Floats) -> tuple[Floats, Floats]:
    """Product q * exp(rotation), normalised, as quaternion (4,) and as matrix (3, 3)."""
    q, matrix = np.empty(4), np.empty((3, 3))
    turn_into(quaternion, rotation_rad[0], rotation_rad[1], rotation_rad[2], q, matrix)
    return q, matrix


def warm_up() -> None:
    """Compile or load the kernels, so that the first pose of a flight is not late."""
    zero, level, much = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.eye(15)
    vio(zero, zero, level, much, zero, zero, level, np.eye(6), (0.1, 0.1, 0.1), 1.0)
    wheels(zero, np.eye(3), much, 0.0, (1.0, 1.0, 1.0), (1.0, 1.0))
    turned_by(level, zero)
