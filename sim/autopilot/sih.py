"""What the simulators inside PX4 and ArduPilot publish of the truth: at a place of their own on the globe."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import development as mavlink

from sim.autopilot.vectors import ned_attitude
from sim.quad.state import QuadState

LATITUDE_DEG, LONGITUDE_DEG, ALTITUDE_M = 47.397742, 8.545594, 489.4  # PX4's and our recordings' home
METRES_PER_DEG = 111_132.95 - 559.85 * math.cos(math.radians(2 * LATITUDE_DEG))  # of latitude, WGS 84
METRES_PER_DEG_EAST = 111_412.84 * math.cos(math.radians(LATITUDE_DEG)) - 93.5 * math.cos(
    math.radians(3 * LATITUDE_DEG)
)
GRAVITY_MPS2 = 9.80665


def _globe(truth: QuadState) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in truth.position_m)
    return LATITUDE_DEG + y / METRES_PER_DEG, LONGITUDE_DEG + x / METRES_PER_DEG_EAST, ALTITUDE_M + z


def _attitude(truth: QuadState) -> tuple[float, float, float, float]:
    return ned_attitude(*(float(v) for v in truth.quaternion))


def hil_state(truth: QuadState, boot_s: float) -> mavlink.MAVLink_message:
    """HIL_STATE_QUATERNION as PX4's SIH sends it."""
    latitude, longitude, altitude = _globe(truth)
    vx, vy, vz = (float(v) for v in truth.velocity_mps)
    p, q, r = (float(v) for v in truth.angular_velocity_rps)
    fx, fy, fz = (float(v) for v in truth.specific_force_mps2)
    return mavlink.MAVLink_hil_state_quaternion_message(
        int(boot_s * 1e6),
        list(_attitude(truth)),
        p,
        -q,
        -r,
        round(latitude * 1e7),
        round(longitude * 1e7),
        round(altitude * 1e3),
        round(vy * 1e2),
        round(vx * 1e2),
        round(-vz * 1e2),
        0,
        0,
        *(_milli_g(v) for v in (fx, -fy, -fz)),
    )


def sim_state(truth: QuadState) -> mavlink.MAVLink_message:
    """SIM_STATE as ArduPilot's SITL sends it; the exact place is in the extension."""
    latitude, longitude, altitude = _globe(truth)
    w, x, y, z = _attitude(truth)
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    vx, vy, vz = (float(v) for v in truth.velocity_mps)
    p, q, r = (float(v) for v in truth.angular_velocity_rps)
    fx, fy, fz = (float(v) for v in truth.specific_force_mps2)
    degrees = round(latitude * 1e7), round(longitude * 1e7)
    return mavlink.MAVLink_sim_state_message(
        w, x, y, z, roll, pitch, yaw, fx, -fy, -fz, p, -q, -r,
        float(degrees[0]), float(degrees[1]), altitude, 0.0, 0.0, vy, vx, -vz, *degrees,
    )  # fmt: skip


def _milli_g(value_mps2: float) -> int:
    return max(-32768, min(32767, round(value_mps2 / GRAVITY_MPS2 * 1e3)))
