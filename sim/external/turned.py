"""Messages between executive and autopilot, turned from our world into the autopilot's and back. Pure.

NED on the wire; what is not about places or headings passes as it is. The covariances of poses are left as
they are: a turn about the vertical changes nothing where east and north are known equally well.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from pymavlink.dialects.v20 import development as mavlink

from sim.autopilot.vectors import Quaternion, Vector, multiply, wrap
from sim.external.alignment import Alignment

GRAVITY_MPS2 = 9.80665
LOCAL_FRAMES = (mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_FRD)
INT16 = 32767


def to_autopilot(message: mavlink.MAVLink_message, alignment: Alignment) -> bool:
    """Turn what the executive says, in place; whether anything was to be turned."""
    turner = _TO_AUTOPILOT.get(message.get_type())
    if turner is not None:
        turner(message, _Ned(alignment, back=True))
    return turner is not None


def to_executive(message: mavlink.MAVLink_message, alignment: Alignment) -> bool:
    """Turn what the autopilot says, in place; whether anything was to be turned."""
    turner = _TO_EXECUTIVE.get(message.get_type())
    if turner is not None:
        turner(message, _Ned(alignment, back=False))
    return turner is not None


def add_rover(message: mavlink.MAVLink_message, force_mps2: Vector, rates_rps: Vector) -> None:
    """Add the rover's motion to the inertial measurement of an autopilot that stands still, in place.

    Args:
        message: HIGHRES_IMU or RAW_IMU; others are left alone.
        force_mps2: Specific force of the rover, FLU.
        rates_rps: Its angular velocity, FLU.
    """
    extra = (force_mps2[0], -force_mps2[1], -(force_mps2[2] - GRAVITY_MPS2))
    turn = (rates_rps[0], -rates_rps[1], -rates_rps[2])
    name = message.get_type()
    if name == "HIGHRES_IMU":
        force, rate = 1.0, 1.0
    elif name == "RAW_IMU":
        force, rate = 1e3 / GRAVITY_MPS2, 1e3
    else:
        return
    whole = name == "RAW_IMU"
    for field, more in zip(("xacc", "yacc", "zacc"), extra, strict=True):
        setattr(message, field, _number(getattr(message, field) + force * more, whole))
    for field, more in zip(("xgyro", "ygyro", "zgyro"), turn, strict=True):
        setattr(message, field, _number(getattr(message, field) + rate * more, whole))


def specific_force_mps2(message: mavlink.MAVLink_message) -> float | None:
    """Size of the measured specific force, of HIGHRES_IMU and RAW_IMU."""
    match message.get_type():
        case "HIGHRES_IMU":
            return math.sqrt(message.xacc**2 + message.yacc**2 + message.zacc**2)
        case "RAW_IMU":
            size = math.sqrt(message.xacc**2 + message.yacc**2 + message.zacc**2)
            return size * 1e-3 * GRAVITY_MPS2
    return None


def _number(value: float, whole: bool) -> float | int:
    return max(-INT16, min(INT16, round(value))) if whole else value


class _Ned:
    """An alignment on NED vectors; `back` from ours to theirs."""

    def __init__(self, alignment: Alignment, *, back: bool) -> None:
        self._place = alignment.theirs if back else alignment.ours
        self._vector = alignment.theirs_vector if back else alignment.ours_vector
        self._yaw_rad = alignment.yaw_rad if back else -alignment.yaw_rad  # NED turns the other way
        half = 0.5 * self._yaw_rad
        self._turn: Quaternion = (math.cos(half), 0.0, 0.0, math.sin(half))

    def place(self, north: float, east: float, down: float) -> Vector:
        return _swapped(self._place((east, north, -down)))

    def vector(self, north: float, east: float, down: float) -> Vector:
        return _swapped(self._vector((east, north, -down)))

    def yaw(self, yaw_rad: float) -> float:
        return wrap(yaw_rad + self._yaw_rad) if math.isfinite(yaw_rad) else yaw_rad

    def attitude(self, q: Quaternion) -> Quaternion:
        return multiply(self._turn, q)


def _swapped(enu: Vector) -> Vector:
    return enu[1], enu[0], -enu[2]


def _setpoint(m: mavlink.MAVLink_message, ned: _Ned) -> None:
    if m.coordinate_frame != mavlink.MAV_FRAME_LOCAL_NED:
        return
    m.x, m.y, m.z = ned.place(m.x, m.y, m.z)
    m.vx, m.vy, m.vz = ned.vector(m.vx, m.vy, m.vz)
    m.afx, m.afy, m.afz = ned.vector(m.afx, m.afy, m.afz)
    m.yaw = ned.yaw(m.yaw)


def _odometry(m: mavlink.MAVLink_message, ned: _Ned) -> None:
    if m.frame_id not in LOCAL_FRAMES:
        return
    m.x, m.y, m.z = ned.place(m.x, m.y, m.z)
    m.q = list(ned.attitude(tuple(float(v) for v in np.asarray(m.q))))  # type: ignore[arg-type]
    if m.child_frame_id in LOCAL_FRAMES:
        m.vx, m.vy, m.vz = ned.vector(m.vx, m.vy, m.vz)


def _vision(m: mavlink.MAVLink_message, ned: _Ned) -> None:
    m.x, m.y, m.z = ned.place(m.x, m.y, m.z)
    m.yaw = ned.yaw(m.yaw)


def _position(m: mavlink.MAVLink_message, ned: _Ned) -> None:
    m.x, m.y, m.z = ned.place(m.x, m.y, m.z)
    m.vx, m.vy, m.vz = ned.vector(m.vx, m.vy, m.vz)


def _attitude(m: mavlink.MAVLink_message, ned: _Ned) -> None:
    m.yaw = ned.yaw(m.yaw)


def _attitude_quaternion(m: mavlink.MAVLink_message, ned: _Ned) -> None:
    m.q1, m.q2, m.q3, m.q4 = ned.attitude((m.q1, m.q2, m.q3, m.q4))


_Turner = Callable[[mavlink.MAVLink_message, _Ned], None]
_TO_AUTOPILOT: dict[str, _Turner] = {
    "SET_POSITION_TARGET_LOCAL_NED": _setpoint,
    "ODOMETRY": _odometry,
    "VISION_POSITION_ESTIMATE": _vision,
}
_TO_EXECUTIVE: dict[str, _Turner] = {
    "LOCAL_POSITION_NED": _position,
    "ODOMETRY": _odometry,
    "ATTITUDE": _attitude,
    "ATTITUDE_QUATERNION": _attitude_quaternion,
    "POSITION_TARGET_LOCAL_NED": _setpoint,
}
