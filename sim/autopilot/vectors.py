"""Small vectors and rotations as tuples of floats: the control loop runs 250 times a second in Python."""

from __future__ import annotations

import math

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # w, x, y, z
Matrix = tuple[Vector, Vector, Vector]

_HALF = math.sqrt(0.5)
ZERO: Vector = (0.0, 0.0, 0.0)
UNKNOWN: Vector = (math.nan, math.nan, math.nan)


def clip(value: float, low: float, high: float) -> float:
    """`value` held within [low, high]."""
    return low if value < low else high if value > high else value


def wrap(angle_rad: float) -> float:
    """Angle folded into [-pi, pi]."""
    return math.remainder(angle_rad, 2.0 * math.pi)


def turn(vector: Vector, yaw_rad: float) -> Vector:
    """Rotate about the third axis."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2]


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton product."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def ned_attitude(w: float, x: float, y: float, z: float) -> Quaternion:
    """FLU-in-ENU attitude as FRD-in-NED, w >= 0; `frames.quaternion_enu_flu_to_ned_frd` without arrays."""
    q = (_HALF * (w + z), _HALF * (x + y), _HALF * (x - y), _HALF * (w - z))
    return q if q[0] >= 0.0 else (-q[0], -q[1], -q[2], -q[3])


def matrix(q: Quaternion) -> Matrix:
    """Rotation matrix, rows first."""
    w, x, y, z = q
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


def rotate(m: Matrix, v: Vector) -> Vector:
    """Matrix times vector."""
    return (
        m[0][0] * v[0] + m[0][1] * v[1] + m[0][2] * v[2],
        m[1][0] * v[0] + m[1][1] * v[1] + m[1][2] * v[2],
        m[2][0] * v[0] + m[2][1] * v[1] + m[2][2] * v[2],
    )


def yaw_of(q: Quaternion) -> float:
    """Heading [rad]."""
    w, x, y, z = q
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def roll_pitch_of(q: Quaternion) -> tuple[float, float]:
    """Roll and pitch [rad] of z-y-x angles."""
    w, x, y, z = q
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    return roll, math.asin(clip(2.0 * (w * y - z * x), -1.0, 1.0))


def from_angles(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Quaternion of z-y-x angles [rad]."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
