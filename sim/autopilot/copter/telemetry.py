"""What the stand-in of ArduCopter sends, and how often."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pymavlink.dialects.v20 import development as mavlink

from sim.autopilot.estimator import Estimate
from sim.autopilot.sih import sim_state
from sim.quad.state import QuadState

RATES_HZ = {mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0, mavlink.MAVLINK_MSG_ID_TIMESYNC: 0.3}  # the rest if asked
# What the recorded ArduCopter says or sends beyond that, each with the reason why it is missing here.
LEFT_OUT = {
    "HOME_POSITION": "a place on the globe; nothing in the stack flies by it",
    "EKF3 IMU": "its second inertial unit and the steps of its alignment; one line stands for each step",
    "AHRS: EKF3 active": "told at its start, before anybody listens",
    "Field Elevation Set: 489m": "the origin's height, which the origin itself has told",
    "SIM Hit ground at": "the word of its simulator, not of the autopilot",
}
GRAVITY_MPS2 = 9.80665
CAPABILITIES, VERSION = 64495, 67567616  # of the recorded ArduCopter 4.7


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Everything that telemetry shows, at one instant."""

    boot_s: float
    truth: QuadState
    estimate: Estimate
    imu: tuple[float, ...]  # (6,) FRD
    base_mode: int
    custom_mode: int
    system_status: int
    landed_state: int
    volts: float
    current_a: float
    remaining: float
    used_j: float

    @property
    def ms(self) -> int:
        """Time since boot [ms]."""
        return int(self.boot_s * 1e3)


def _heartbeat(s: Snapshot) -> mavlink.MAVLink_message:
    kind, family = mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    return mavlink.MAVLink_heartbeat_message(kind, family, s.base_mode, s.custom_mode, s.system_status, 3)


def _raw_imu(s: Snapshot) -> mavlink.MAVLink_message:
    force = [max(-32768, min(32767, round(v / GRAVITY_MPS2 * 1e3))) for v in s.imu[:3]]
    rates = [max(-32768, min(32767, round(v * 1e3))) for v in s.imu[3:]]
    return mavlink.MAVLink_raw_imu_message(int(s.boot_s * 1e6), *force, *rates, 0, 0, 0)


def _local_position(s: Snapshot) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_local_position_ned_message(s.ms, *s.estimate.position_m, *s.estimate.velocity_mps)


def _attitude_quaternion(s: Snapshot) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_attitude_quaternion_message(s.ms, *s.estimate.attitude, *s.estimate.rates_rps)


def _extended_sys_state(s: Snapshot) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_extended_sys_state_message(3, s.landed_state)


def _battery_status(s: Snapshot) -> mavlink.MAVLink_message:
    cells = [round(200.0 * s.volts)] * 5 + [65535] * 5
    return mavlink.MAVLink_battery_status_message(
        0, 0, 0, 32767, cells, round(100.0 * s.current_a), round(s.used_j / 68.4), round(s.used_j / 100.0),
        round(100.0 * s.remaining),
    )  # fmt: skip


def _timesync(s: Snapshot) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_timesync_message(0, int(s.boot_s * 1e9))


def _sim_state(s: Snapshot) -> mavlink.MAVLink_message:
    return sim_state(s.truth)


def _version(_: Snapshot) -> mavlink.MAVLink_message:
    none = [0] * 8
    return mavlink.MAVLink_autopilot_version_message(
        CAPABILITIES, VERSION, 0, 0, 0, none, none, none, 0, 0, 0
    )


BUILDERS: dict[int, Callable[[Snapshot], mavlink.MAVLink_message]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    mavlink.MAVLINK_MSG_ID_RAW_IMU: _raw_imu,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: _local_position,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: _attitude_quaternion,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: _extended_sys_state,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: _battery_status,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: _timesync,
    mavlink.MAVLINK_MSG_ID_SIM_STATE: _sim_state,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: _version,
}
