"""What the stand-in sends, and how often: the message set and the rates of PX4's onboard link.

A builder makes one message of a `Snapshot`; `Schedule` knows which messages are due. `LEFT_OUT` lists what
the recorded PX4 sends beyond that, each with the reason why it is missing here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from pymavlink.dialects.v20 import development as mavlink

from sim.autopilot.controller import MASS_KG, Demand, Target
from sim.autopilot.estimator import Estimate
from sim.autopilot.vectors import roll_pitch_of

# Mean rates measured on the recorded link [Hz]; asking for an interval replaces them.
RATES_HZ: dict[int, float] = {
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 98.4,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: 49.2,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 49.2,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 48.1,
    mavlink.MAVLINK_MSG_ID_ODOMETRY: 29.6,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: 9.9,
    mavlink.MAVLINK_MSG_ID_ALTITUDE: 9.84,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: 9.84,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 9.84,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 9.84,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 9.84,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 4.92,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 4.92,
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 0.99,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 0.99,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 0.99,
    mavlink.MAVLINK_MSG_ID_PING: 0.99,
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: 0.99,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 0.99,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 0.49,
    mavlink.MAVLINK_MSG_ID_CURRENT_MODE: 0.49,
    mavlink.MAVLINK_MSG_ID_VIBRATION: 0.49,
}

_NO_CODEC = "pymavlink 2.4.50 has no definition of it, and nothing in the stack reads it"
LEFT_OUT: dict[str, str] = {
    "DISTANCE_SENSOR": "comes from SIH's simulated rangefinder; this robot carries none",
    "OPEN_DRONE_ID_LOCATION": "remote identification, meaningless without a global position",
    "LINK_NODE_STATUS": _NO_CODEC,
    "ESC_INFO": _NO_CODEC,
    "ESC_STATUS": _NO_CODEC,
    "TIME_ESTIMATE_TO_TARGET": _NO_CODEC,
    "COMPONENT_METADATA": _NO_CODEC,
    "CURRENT_EVENT_SEQUENCE": _NO_CODEC,
    "ESTIMATOR_SENSOR_FUSION_STATUS": _NO_CODEC,
    "POSITION_TARGET_GLOBAL_INT": "seen once, with zeros; needs a global position",
}

PRESENT = 0x0200C00B  # SYS_STATUS sensors, as recorded
ENABLED = 0x0201C00B
HEALTHY = 0x0320883F
HEALTHY_POSITION = 0x00004000
HEALTHY_PREARM = 0x10000000
NO_POSITION_TARGET = 63
NAN_COVARIANCE = [math.nan] * 21
PRESSURE_HPA = 955.79
HEIGHT_MSL_M = 489.8


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Everything that telemetry shows, at one instant."""

    boot_s: float  # time since boot
    unix_s: float
    estimate: Estimate
    imu: tuple[float, ...]  # (6,) FRD
    flying: bool  # the set-point layers are at work
    target: Target
    demand: Demand
    motors: tuple[float, ...]  # (4,) duty, zeros when disarmed
    armed: bool
    base_mode: int
    custom_mode: int
    intended_mode: int
    system_status: int
    landed_state: int
    can_arm: bool
    volts: float
    current_a: float
    remaining: float
    used_j: float
    ping: int

    @property
    def ms(self) -> int:
        """Time since boot [ms]."""
        return int(self.boot_s * 1e3)

    @property
    def us(self) -> int:
        """Time since boot [us]."""
        return int(self.boot_s * 1e6)


Builder = Callable[[Snapshot], mavlink.MAVLink_message]


class Schedule:
    """Which messages are due."""

    def __init__(self) -> None:
        self._period_s = {message: 1.0 / rate for message, rate in RATES_HZ.items()}
        self._due_s: dict[int, float] = {}

    def set_interval(self, message: int, interval_us: float) -> bool:
        """Honour SET_MESSAGE_INTERVAL: microseconds, 0 = default, -1 = off; False when it is unknown."""
        if message not in BUILDERS:
            return False
        self._due_s.pop(message, None)
        if interval_us < 0.0:
            self._period_s.pop(message, None)
        elif interval_us == 0.0:
            self._period_s[message] = 1.0 / RATES_HZ[message]
        else:
            self._period_s[message] = interval_us * 1e-6
        return True

    def interval_us(self, message: int) -> int:
        """The present interval [us]; -1 when it is off, 0 when it is unknown."""
        if message not in BUILDERS:
            return 0
        period_s = self._period_s.get(message)
        return -1 if period_s is None else round(period_s * 1e6)

    def due(self, boot_s: float) -> list[int]:
        """Messages to send now; each is then due one period later, and missed ones are skipped."""
        out = []
        for message, period_s in self._period_s.items():
            due_s = self._due_s.setdefault(message, boot_s + min(period_s, 1.0))
            if boot_s >= due_s:
                out.append(message)
                self._due_s[message] = due_s + period_s if boot_s < due_s + period_s else boot_s + period_s
        return out


def _attitude(s: Snapshot) -> mavlink.MAVLink_message:
    roll, pitch = roll_pitch_of(s.estimate.attitude)
    return mavlink.MAVLink_attitude_message(s.ms, roll, pitch, s.estimate.yaw_rad, *s.estimate.rates_rps)


def _attitude_quaternion(s: Snapshot) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_attitude_quaternion_message(s.ms, *s.estimate.attitude, *s.estimate.rates_rps)


def _highres_imu(s: Snapshot) -> mavlink.MAVLink_message:
    height = HEIGHT_MSL_M - _number(s.estimate.position_m[2])
    return mavlink.MAVLink_highres_imu_message(
        s.us, *s.imu, 0.0, 0.0, 0.0, _pressure_hpa(s), 0.0, height, 15.0, 63
    )


def _local_position(s: Snapshot) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_local_position_ned_message(s.ms, *s.estimate.position_m, *s.estimate.velocity_mps)


def _odometry(s: Snapshot) -> mavlink.MAVLink_message:
    sigma2 = 3e-4 if s.estimate.position_valid else 100.0
    covariance = _diagonal(sigma2, 1e-5)
    return mavlink.MAVLink_odometry_message(
        s.us,
        mavlink.MAV_FRAME_LOCAL_NED,
        mavlink.MAV_FRAME_LOCAL_NED,
        *s.estimate.position_m,
        s.estimate.attitude,
        *s.estimate.velocity_mps,
        *s.estimate.rates_rps,
        covariance,
        _diagonal(7e-4, 0.0),
        0,
        mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT,
    )


def _timesync(s: Snapshot) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_timesync_message(0, s.us * 1000)


def _altitude(s: Snapshot) -> mavlink.MAVLink_message:
    up = -s.estimate.position_m[2]
    monotonic = HEIGHT_MSL_M + _number(up)
    return mavlink.MAVLink_altitude_message(s.us, monotonic, monotonic, up, up, math.nan, math.nan)


def _attitude_target(s: Snapshot) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_attitude_target_message(
        s.ms,
        0,
        s.demand.attitude,
        *s.demand.rates_rps,
        max(0.001, s.demand.thrust_n / (2.0 * MASS_KG * 9.80665)),
    )


def _position_target(s: Snapshot) -> mavlink.MAVLink_message:
    frame = mavlink.MAV_FRAME_LOCAL_NED
    if not s.flying:
        nan = math.nan
        return mavlink.MAVLink_position_target_local_ned_message(
            s.ms,
            frame,
            NO_POSITION_TARGET,
            nan,
            nan,
            nan,
            nan,
            nan,
            nan,
            0.0,
            0.0,
            100.0,
            s.estimate.yaw_rad,
            0.0,
        )
    mask = 0 if all(map(math.isfinite, s.target.position_m)) else 7
    return mavlink.MAVLink_position_target_local_ned_message(
        s.ms,
        frame,
        mask,
        *s.target.position_m,
        *s.demand.velocity_mps,
        *s.demand.acceleration_mps2,
        _number(s.target.yaw_rad),
        _number(s.target.yaw_rate_rps),
    )


def _servo_output(s: Snapshot) -> mavlink.MAVLink_message:
    raw = [round(1000 + 1000 * m) if s.armed else 900 for m in s.motors]
    return mavlink.MAVLink_servo_output_raw_message(s.us & 0xFFFFFFFF, 0, *raw, *([900] * 12))


def _vfr_hud(s: Snapshot) -> mavlink.MAVLink_message:
    v = s.estimate.velocity_mps
    heading = int(math.degrees(s.estimate.yaw_rad)) % 360
    throttle = int(100.0 * sum(s.motors) / 4.0) if s.armed else 0
    height = HEIGHT_MSL_M - _number(s.estimate.position_m[2])
    return mavlink.MAVLink_vfr_hud_message(math.nan, math.hypot(v[0], v[1]), heading, throttle, height, -v[2])


def _sys_status(s: Snapshot) -> mavlink.MAVLink_message:
    health = HEALTHY | (HEALTHY_POSITION if s.estimate.position_valid else 0)
    health |= HEALTHY_PREARM if s.can_arm or s.armed else 0
    percent = round(100.0 * s.remaining)
    current = round(100.0 * s.current_a)
    return mavlink.MAVLink_sys_status_message(
        PRESENT, ENABLED, health, 120, round(1e3 * s.volts), current, percent, 0, 0, 0, 0, 0, 0, 0, 0, 1
    )


def _extended_sys_state(s: Snapshot) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_extended_sys_state_message(0, s.landed_state)


def _heartbeat(s: Snapshot) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR,
        mavlink.MAV_AUTOPILOT_PX4,
        s.base_mode,
        s.custom_mode,
        s.system_status,
        mavlink_version=3,
    )


def _estimator_status(s: Snapshot) -> mavlink.MAVLink_message:
    e = s.estimate
    flags = 1 | 4 | 32 | (2 if e.velocity_valid else 0) | (0 if s.flying else 128)
    flags |= (8 | 64 | 256) if e.position_valid else 0
    accuracy = 0.025 if e.position_valid else 14.0
    return mavlink.MAVLink_estimator_status_message(
        s.us, flags, 0.1, 0.02, 0.01, math.nan, math.nan, math.nan, accuracy, 0.02
    )


def _mission_current(s: Snapshot) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_mission_current_message(0, 65535, mavlink.MISSION_STATE_NO_MISSION, 2)


def _ping(s: Snapshot) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_ping_message(s.us, s.ping, 0, 0)


def _scaled_pressure(s: Snapshot) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_scaled_pressure_message(s.ms, _pressure_hpa(s), 0.0, 1180)


def _system_time(s: Snapshot) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_system_time_message(int(s.unix_s * 1e6), s.ms)


def _battery_status(s: Snapshot) -> mavlink.MAVLink_message:
    cells = [round(200.0 * s.volts)] * 5 + [65535] * 5
    return mavlink.MAVLink_battery_status_message(
        0,
        mavlink.MAV_BATTERY_FUNCTION_ALL,
        mavlink.MAV_BATTERY_TYPE_LIPO,
        32767,
        cells,
        round(100.0 * s.current_a),
        round(s.used_j / 19.0 / 3.6),
        round(s.used_j / 100.0),
        round(100.0 * s.remaining),
        0,
        mavlink.MAV_BATTERY_CHARGE_STATE_OK,
    )


def _current_mode(s: Snapshot) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_current_mode_message(0, s.custom_mode, s.intended_mode)


def _vibration(s: Snapshot) -> mavlink.MAVLink_message:
    shake = 1.4 if s.armed else 0.15
    return mavlink.MAVLink_vibration_message(s.us, 0.0, 0.1 * shake, shake, 0, 0, 0)


def autopilot_version(s: Snapshot) -> mavlink.MAVLink_message:
    """AUTOPILOT_VERSION, only on request; version and capabilities as recorded."""
    return mavlink.MAVLink_autopilot_version_message(
        59647, 17956992, 17956992, 101854463, 1, [0] * 8, [0] * 8, [0] * 8, 0, 0, 5283920058631409231
    )


BUILDERS: dict[int, Builder] = {
    mavlink.MAVLINK_MSG_ID_ATTITUDE: _attitude,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: _highres_imu,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: _attitude_quaternion,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: _local_position,
    mavlink.MAVLINK_MSG_ID_ODOMETRY: _odometry,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: _timesync,
    mavlink.MAVLINK_MSG_ID_ALTITUDE: _altitude,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: _attitude_target,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: _position_target,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: _servo_output,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: _vfr_hud,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: _sys_status,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: _extended_sys_state,
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: _estimator_status,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: _mission_current,
    mavlink.MAVLINK_MSG_ID_PING: _ping,
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: _scaled_pressure,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: _system_time,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: _battery_status,
    mavlink.MAVLINK_MSG_ID_CURRENT_MODE: _current_mode,
    mavlink.MAVLINK_MSG_ID_VIBRATION: _vibration,
}


def _pressure_hpa(s: Snapshot) -> float:
    return PRESSURE_HPA + 0.114 * _number(s.estimate.position_m[2])


def _diagonal(first: float, second: float) -> list[float]:
    """Upper triangle of a (6, 6) covariance with two variances on its diagonal."""
    out = [0.0] * 21
    for i, at in enumerate((0, 6, 11, 15, 18, 20)):
        out[at] = first if i < 3 else second
    return out


def _number(value: float) -> float:
    return value if math.isfinite(value) else 0.0
