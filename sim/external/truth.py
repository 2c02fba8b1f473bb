"""The ground truth that an autopilot's own simulator publishes over MAVLink, in ENU and FLU. Pure.

PX4 (SIH, Gazebo) sends HIL_STATE_QUATERNION, ArduPilot SIM_STATE and the older SIMSTATE. Latitude and
longitude come in steps of 1.1 cm; velocity carries the position from one message to the next and the steps
only correct it, so that no jerk of the grid reaches a camera or a VIO.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from pymavlink.dialects.v20 import development as mavlink

from labr_autonomy.frames import quaternion_from_rpy, quaternion_ned_frd_to_enu_flu, yaw_of
from labr_autonomy.types import Array
from sim.autopilot.vectors import Vector

SIMSTATE = "UNKNOWN_164"  # of ArduPilot's own dialect
NAMES = ("HIL_STATE_QUATERNION", "SIM_STATE", SIMSTATE)
EARTH_M = 6378137.0  # WGS 84, equatorial radius
FLATTENING = 1.0 / 298.257223563
GRID_GAIN = 0.1  # share of the grid's difference that is taken over with each message
PACE_AFTER_S = 0.8  # the shortest time over which two clocks are compared
JUMP_M = 1.0  # further off than this the autopilot's simulator was put elsewhere


@dataclass(frozen=True, slots=True)
class Truth:
    """Motion in the autopilot's own simulator; zero is where it was first seen."""

    stamp_s: float  # arrival
    position_m: Vector  # ENU
    velocity_mps: Vector  # ENU
    attitude: Array  # (4,) wxyz, FLU to ENU
    rates_rps: Vector  # FLU

    @property
    def yaw_rad(self) -> float:
        """Heading, counter-clockwise from east."""
        return yaw_of(self.attitude)

    def at(self, now_s: float) -> Vector:
        """Where it is at `now_s`, going on as it went (3,) [m]."""
        dt = min(max(0.0, now_s - self.stamp_s), 0.2)
        p, v = self.position_m, self.velocity_mps
        return p[0] + v[0] * dt, p[1] + v[1] * dt, p[2] + v[2] * dt


@dataclass(frozen=True, slots=True)
class _Fix:
    latitude_deg: float
    longitude_deg: float
    altitude_m: float | None  # None: not told (SIMSTATE)
    velocity_mps: Vector | None  # ENU
    attitude: Array
    rates_rps: Vector


class TruthReader:
    """Turns messages into `Truth`; use one for each autopilot."""

    def __init__(self) -> None:
        self._origin: _Fix | None = None
        self.latest: Truth | None = None
        self.resets = 0
        self._clock: tuple[float, float] | None = None  # the sender's and ours, when both were first seen
        self.pace: float | None = None  # seconds of the sender's clock in one of ours, None while not known

    def take(self, message: mavlink.MAVLink_message, now_s: float) -> Truth | None:
        """Read one message; None when it is none of `NAMES`."""
        fix = _fix_of(message)
        if fix is None:
            return None
        self._watch_clock(message, now_s)
        if self._origin is None:
            self._origin = fix
        grid = self._metres(fix)
        self.latest = _blend(self.latest, grid, fix, now_s)
        if self.latest.position_m == grid:
            self.resets += 1
        return self.latest

    def _watch_clock(self, message: mavlink.MAVLink_message, now_s: float) -> None:
        """HIL_STATE_QUATERNION tells the sender's time; ArduPilot's messages do not."""
        stamp_us = getattr(message, "time_usec", None)
        if stamp_us is None:
            return
        if self._clock is None:
            self._clock = stamp_us * 1e-6, now_s
        elif now_s - self._clock[1] >= PACE_AFTER_S:
            self.pace = (stamp_us * 1e-6 - self._clock[0]) / (now_s - self._clock[1])

    def _metres(self, fix: _Fix) -> Vector:
        origin = self._origin
        assert origin is not None
        latitude = math.radians(origin.latitude_deg)
        e2 = FLATTENING * (2.0 - FLATTENING)
        root = math.sqrt(1.0 - e2 * math.sin(latitude) ** 2)
        east = math.radians(fix.longitude_deg - origin.longitude_deg) * EARTH_M / root * math.cos(latitude)
        north = math.radians(fix.latitude_deg - origin.latitude_deg) * EARTH_M * (1.0 - e2) / root**3
        up = 0.0
        if fix.altitude_m is not None and origin.altitude_m is not None:
            up = fix.altitude_m - origin.altitude_m
        return east, north, up


def _blend(before: Truth | None, grid: Vector, fix: _Fix, now_s: float) -> Truth:
    fresh = Truth(now_s, grid, fix.velocity_mps or (0.0, 0.0, 0.0), fix.attitude, fix.rates_rps)
    if before is None or fix.velocity_mps is None or now_s - before.stamp_s > 1.0:
        return fresh
    dt = now_s - before.stamp_s
    mean = [0.5 * (a + b) for a, b in zip(before.velocity_mps, fix.velocity_mps, strict=True)]
    carried = [p + v * dt for p, v in zip(before.position_m, mean, strict=True)]
    if math.dist(carried, grid) > JUMP_M:
        return fresh
    x, y = (c + GRID_GAIN * (g - c) for c, g in zip(carried[:2], grid[:2], strict=True))
    return replace(fresh, position_m=(x, y, grid[2]))  # the altitude comes in millimetres or as a float


def _fix_of(m: mavlink.MAVLink_message) -> _Fix | None:
    match m.get_type():
        case "HIL_STATE_QUATERNION":
            return _Fix(
                m.lat * 1e-7,
                m.lon * 1e-7,
                m.alt * 1e-3,
                (m.vy * 1e-2, m.vx * 1e-2, -m.vz * 1e-2),
                quaternion_ned_frd_to_enu_flu(np.array(m.attitude_quaternion, float)),
                (m.rollspeed, -m.pitchspeed, -m.yawspeed),
            )
        case "SIM_STATE":
            exact = m.lat_int != 0 or m.lon_int != 0  # an extension; the floats have steps of 0.4 m
            return _Fix(
                m.lat_int * 1e-7 if exact else _degrees(m.lat),
                m.lon_int * 1e-7 if exact else _degrees(m.lon),
                m.alt,
                (m.ve, m.vn, -m.vd),
                quaternion_ned_frd_to_enu_flu(np.array([m.q1, m.q2, m.q3, m.q4], float)),
                (m.xgyro, -m.ygyro, -m.zgyro),
            )
        case name if name == SIMSTATE:
            m = _simstate(bytes(m.get_msgbuf()))
            if m is None:
                return None
            ned = quaternion_from_rpy(m.roll, m.pitch, m.yaw)
            return _Fix(
                m.lat * 1e-7,
                m.lng * 1e-7,
                None,
                None,
                quaternion_ned_frd_to_enu_flu(ned),
                (m.xgyro, -m.ygyro, -m.zgyro),
            )
    return None


def _degrees(value: float) -> float:
    """SIM_STATE's latitude is said to be in degrees; ArduPilot has sent 1e7 times that."""
    return value * 1e-7 if abs(value) > 360.0 else value


def _simstate(frame: bytes) -> mavlink.MAVLink_message | None:
    """The message in a frame of SIMSTATE; its dialect is loaded when the first one comes."""
    from pymavlink.dialects.v20 import ardupilotmega

    parser = ardupilotmega.MAVLink(None)
    parser.robust_parsing = True
    found = parser.parse_buffer(frame) or ()
    return next((m for m in found if m.get_type() == "SIMSTATE"), None)
