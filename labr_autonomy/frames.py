"""Rotations and frames: odom ENU, body FLU, level (yaw-only body), camera FLU, and NED/FRD for `air/`.

Quaternions are (w, x, y, z) Hamilton. ENU <-> NED swaps x and y and negates z; FLU <-> FRD negates
y and z (REP-103, MAVLink MAV_FRAME).
"""

from __future__ import annotations

import math

import numpy as np

from labr_autonomy.types import Array, Pose


def wrap_pi(angle_rad: float) -> float:
    """Angle folded into (-pi, pi] [rad]."""
    folded = math.remainder(angle_rad, 2.0 * math.pi)
    return math.pi if folded == -math.pi else folded


def enu_ned(vector: Array) -> Array:
    """ENU to NED or NED to ENU, (..., 3); its own inverse."""
    return np.stack([vector[..., 1], vector[..., 0], -vector[..., 2]], axis=-1)


def flu_frd(vector: Array) -> Array:
    """FLU to FRD or FRD to FLU, (..., 3); its own inverse."""
    return np.stack([vector[..., 0], -vector[..., 1], -vector[..., 2]], axis=-1)


def yaw_enu_ned(yaw_rad: float) -> float:
    """Heading from east counter-clockwise to heading from north clockwise, or back [rad]."""
    return wrap_pi(math.pi / 2.0 - yaw_rad)


def quaternion_multiply(a: Array, b: Array) -> Array:
    """Hamilton product a*b, (4,) wxyz."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return np.array(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ]
    )


_HALF = math.sqrt(0.5)
_ENU_NED = np.array([0.0, _HALF, _HALF, 0.0])  # rotation by pi about x+y
_FLU_FRD = np.array([0.0, 1.0, 0.0, 0.0])  # rotation by pi about x


def quaternion_enu_flu_to_ned_frd(q: Array) -> Array:
    """Attitude body-FLU-in-ENU to body-FRD-in-NED (w >= 0)."""
    out = quaternion_multiply(quaternion_multiply(_ENU_NED, q), _FLU_FRD)
    return -out if out[0] < 0.0 else out


def quaternion_ned_frd_to_enu_flu(q: Array) -> Array:
    """Attitude body-FRD-in-NED to body-FLU-in-ENU (w >= 0)."""
    return quaternion_enu_flu_to_ned_frd(q)


def rotation_matrix(q: Array) -> Array:
    """(3, 3) matrix that turns body vectors into odom, from a wxyz quaternion."""
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def rotation_vector_quaternion(rotation_rad: Array) -> Array:
    """Quaternion of a rotation vector (3,) [rad]."""
    angle = float(np.linalg.norm(rotation_rad))
    if angle < 1e-12:
        q = np.array([1.0, *(0.5 * rotation_rad)])
        unit: Array = q / np.linalg.norm(q)
        return unit
    return np.array([math.cos(angle / 2), *(math.sin(angle / 2) * rotation_rad / angle)])


def quaternion_rotation_vector(q: Array) -> Array:
    """Rotation vector (3,) [rad] of a quaternion, shortest way."""
    if q[0] < 0.0:
        q = -q
    n = float(np.linalg.norm(q[1:]))
    if n < 1e-12:
        small: Array = 2.0 * q[1:]
        return small
    rotation: Array = 2.0 * math.atan2(n, float(q[0])) * q[1:] / n
    return rotation


def quaternion_conjugate(q: Array) -> Array:
    """Inverse of a unit quaternion."""
    inverse: Array = q * np.array([1.0, -1.0, -1.0, -1.0])
    return inverse


def yaw_of(q: Array) -> float:
    """Heading about odom z [rad]."""
    w, x, y, z = (float(v) for v in q)
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def roll_pitch_of(q: Array) -> tuple[float, float]:
    """Roll and pitch of FLU axes [rad]; pitch is positive nose-down (rotation about y left)."""
    w, x, y, z = (float(v) for v in q)
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
    return roll, pitch


def quaternion_from_rpy(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Array:
    """Quaternion from z-y-x Euler angles [rad]."""
    cr, sr = math.cos(roll_rad / 2), math.sin(roll_rad / 2)
    cp, sp = math.cos(pitch_rad / 2), math.sin(pitch_rad / 2)
    cy, sy = math.cos(yaw_rad / 2), math.sin(yaw_rad / 2)
    return np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def level_to_odom(points_m: Array, pose: Pose) -> Array:
    """Points (..., 3) in the level frame (origin at the body, yaw only) to odom."""
    yaw = yaw_of(pose.quaternion)
    c, s = math.cos(yaw), math.sin(yaw)
    x, y = points_m[..., 0], points_m[..., 1]
    turned = np.stack([c * x - s * y, s * x + c * y, points_m[..., 2]], axis=-1)
    out: Array = turned + pose.position_m
    return out


def odom_to_level(points_m: Array, pose: Pose) -> Array:
    """Points (..., 3) in odom to the level frame of `pose`."""
    yaw = yaw_of(pose.quaternion)
    c, s = math.cos(yaw), math.sin(yaw)
    d = points_m - pose.position_m
    return np.stack([c * d[..., 0] + s * d[..., 1], -s * d[..., 0] + c * d[..., 1], d[..., 2]], axis=-1)


def body_to_odom(points_m: Array, pose: Pose) -> Array:
    """Points (n, 3) in body to odom."""
    out: Array = points_m @ rotation_matrix(pose.quaternion).T + pose.position_m
    return out
