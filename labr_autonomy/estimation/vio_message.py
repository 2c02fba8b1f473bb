"""The VIO sample and its wire format: MAVLink 2 ODOMETRY (#331) in MAV_FRAME_LOCAL_FLU.

`time_usec` is CLOCK_MONOTONIC of this machine at mid-exposure; the quaternion turns body FLU into odom;
velocities are along odom axes, and `child_frame_id` says so by repeating LOCAL_FLU.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from labr_autonomy.types import Array

_MAGIC = 0xFD  # MAVLink 2 start of frame
_OVERHEAD = 12  # header 10, checksum 2
_SIGNATURE = 13
_SYSTEM = 1
_COMPONENT = int(mavlink.MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY)
_UPPER = np.triu_indices(6)
_UNIT_TOLERANCE = 1e-2  # float32 quaternions of careless senders are this close to unit length


class Refusal(enum.Enum):
    """Why a datagram or a sample is not used."""

    GARBAGE = "not a MAVLink 2 frame"
    OTHER = "another message than ODOMETRY"
    FRAME = "frame is not LOCAL_FLU"
    NOT_FINITE = "a figure is not finite"
    QUATERNION = "quaternion is not of unit length"
    COVARIANCE = "covariance is missing, not finite or not positive"
    LOST = "the source says that it is lost"
    STAMP = "stamp does not increase"
    FUTURE = "stamp lies in the future"


@dataclass(frozen=True, slots=True)
class VioSample:
    """One pose of the visual-inertial odometry."""

    stamp_s: float  # CLOCK_MONOTONIC, mid-exposure
    position_m: Array  # (3,) odom
    quaternion: Array  # (4,) wxyz, body to odom
    velocity_mps: Array  # (3,) odom
    covariance: Array  # (6, 6) position [m^2] odom, then rotation [rad^2] body
    reset_count: int = 0  # grows when the source starts anew somewhere else


def encode_vio(sample: VioSample, sequence: int = 0) -> bytes:
    """The sample as one MAVLink 2 datagram.

    Args:
        sample: What to send.
        sequence: MAVLink sequence number, taken modulo 256.
    """
    link = mavlink.MAVLink(None, srcSystem=_SYSTEM, srcComponent=_COMPONENT)
    link.seq = sequence % 256
    unknown = [math.nan] + [0.0] * 20
    message = mavlink.MAVLink_odometry_message(
        round(sample.stamp_s * 1e6),
        mavlink.MAV_FRAME_LOCAL_FLU,
        mavlink.MAV_FRAME_LOCAL_FLU,
        *(float(v) for v in sample.position_m),
        [float(v) for v in sample.quaternion],
        *(float(v) for v in sample.velocity_mps),
        math.nan,
        math.nan,
        math.nan,
        [float(v) for v in sample.covariance[_UPPER]],
        unknown,
        sample.reset_count % 256,
        mavlink.MAV_ESTIMATOR_TYPE_VIO,
        0,
    )
    return bytes(message.pack(link))


def decode_vio(datagram: bytes) -> Iterator[VioSample | Refusal]:
    """The samples in a datagram, and a reason for each message in it that is none."""
    rest = bytes(datagram)
    while rest:
        frame = _first_frame(rest)
        if frame is None:
            yield Refusal.GARBAGE
            return
        rest = rest[len(frame) :]
        try:
            message = mavlink.MAVLink(None).decode(bytearray(frame))
        except mavlink.MAVError:
            yield Refusal.GARBAGE
            continue
        yield _checked(message) if message.get_type() == "ODOMETRY" else Refusal.OTHER


def _first_frame(data: bytes) -> bytes | None:
    """The leading MAVLink 2 frame of `data`, or None when there is no whole one."""
    if len(data) < _OVERHEAD or data[0] != _MAGIC:
        return None
    length = _OVERHEAD + data[1] + (_SIGNATURE if data[2] & 1 else 0)
    return data[:length] if len(data) >= length else None


def _checked(message: mavlink.MAVLink_odometry_message) -> VioSample | Refusal:
    """The message as a sample, if every field is usable."""
    local_flu = mavlink.MAV_FRAME_LOCAL_FLU
    if message.frame_id != local_flu or message.child_frame_id != local_flu:
        return Refusal.FRAME
    if message.quality == -1:  # MAVLink common.xml: "-1 = odometry has failed"
        return Refusal.LOST
    position = np.array([message.x, message.y, message.z])
    quaternion = np.array(message.q, float)
    velocity = np.array([message.vx, message.vy, message.vz])
    if not np.isfinite(np.concatenate([position, quaternion, velocity])).all():
        return Refusal.NOT_FINITE
    length = float(np.sqrt(quaternion @ quaternion))
    if abs(length - 1.0) > _UNIT_TOLERANCE:
        return Refusal.QUATERNION
    covariance = np.zeros((6, 6))
    covariance[_UPPER] = message.pose_covariance
    covariance = covariance + np.triu(covariance, 1).T
    if not np.isfinite(covariance).all() or not _positive_definite(covariance):
        return Refusal.COVARIANCE
    return VioSample(
        message.time_usec * 1e-6, position, quaternion / length, velocity, covariance, message.reset_counter
    )


def _positive_definite(matrix: Array) -> bool:
    """Whether a symmetric matrix is positive definite."""
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True
