"""What the autopilot reports, from MAVLink fields to our values and frames; pure.

Fields are the dictionaries of MavlinkDirect's JSON, in which a number that is not finite is None.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from labr_autonomy.air import px4
from labr_autonomy.air.families import FAMILIES, PX4
from labr_autonomy.frames import enu_ned, flu_frd, quaternion_ned_frd_to_enu_flu
from labr_autonomy.types import Array, ImuSample

Received = Mapping[str, Any]

STALE_S = 1.0  # a position, velocity or attitude older than this is not reported
LINK_SILENT_S = (
    1.5  # nothing at all for this long: the link is lost (PX4's heartbeats are at most 1.2 s apart)
)
HEARTBEAT_LOST_S = 3.0  # MAVLink and MAVSDK: a system is gone after three missed heartbeats
UNUSED_CELL = 65535  # BATTERY_STATUS.voltages: no such cell
GRAVITY_MPS2 = 9.80665


@dataclass(frozen=True, slots=True)
class Message:
    """The latest message of one kind."""

    arrival_s: float
    fields: Received


@dataclass(frozen=True, slots=True)
class AirState:
    """What is known of the autopilot. Nothing is assumed of one that has fallen silent."""

    stamp_s: float  # when its last message of any kind arrived
    connected: bool
    armed: bool  # the last word of it: stays True when the link is lost in flight
    mode: str  # "offboard", "hold", "land", ...; "unknown" while not connected
    landed: str  # "on_ground", "in_air", "takeoff", "landing"; "unknown" while not connected
    position_m: Array | None  # (3,) odom
    velocity_mps: Array | None  # (3,) odom
    attitude: Array | None  # (4,) wxyz, body to odom
    battery_v: float | None
    battery_remaining: float | None  # 0..1
    current_a: float | None
    heartbeat_age_s: float
    failsafe: bool  # it calls its own state critical or worse
    battery_used_j: float | None = None
    fault: str | None = None  # a sentence, when it is lost or in failsafe
    intended: str = ""  # the mode it was asked for, "" where the autopilot does not tell
    lifts_by_command: bool = False  # on the floor it ignores set-points and wants a take-off command
    resumes: bool = True  # it comes back by itself after lost set-points


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """HEARTBEAT of the autopilot."""

    autopilot: int  # MAV_AUTOPILOT
    armed: bool
    mode: str
    critical: bool


def heartbeat(fields: Received) -> Heartbeat:
    """HEARTBEAT (0)."""
    family = FAMILIES.get(int(fields["autopilot"]), PX4)
    return Heartbeat(
        autopilot=int(fields["autopilot"]),
        armed=bool(int(fields["base_mode"]) & px4.ARMED_FLAG),
        mode=family.mode_name(int(fields["custom_mode"])),
        critical=int(fields["system_status"]) in px4.CRITICAL,
    )


def vector(fields: Received, *names: str) -> Array | None:
    """The named numbers as an array; None if one is missing or not finite."""
    values = [fields.get(name) for name in names]
    if any(v is None for v in values):
        return None
    return np.array(values, dtype=np.float64)


def position_odom(fields: Received) -> Array | None:
    """LOCAL_POSITION_NED (32) -> (3,) odom [m]."""
    ned = vector(fields, "x", "y", "z")
    return None if ned is None else enu_ned(ned)


def velocity_odom(fields: Received) -> Array | None:
    """LOCAL_POSITION_NED (32) -> (3,) odom [m/s]."""
    ned = vector(fields, "vx", "vy", "vz")
    return None if ned is None else enu_ned(ned)


def attitude_odom(fields: Received) -> Array | None:
    """ATTITUDE_QUATERNION (31) -> (4,) wxyz, body FLU to odom ENU."""
    q = vector(fields, "q1", "q2", "q3", "q4")
    return None if q is None else quaternion_ned_frd_to_enu_flu(q)


def imu_sample(fields: Received, stamp_s: float, name: str = "HIGHRES_IMU") -> ImuSample | None:
    """HIGHRES_IMU (105), or RAW_IMU (27) in ArduPilot's mG and mrad/s -> body FLU, stamped `stamp_s`."""
    force = vector(fields, "xacc", "yacc", "zacc")
    rates = vector(fields, "xgyro", "ygyro", "zgyro")
    if force is None or rates is None:
        return None
    if name == "RAW_IMU":
        force, rates = force * (1e-3 * GRAVITY_MPS2), rates * 1e-3
    turned = flu_frd(np.array([force, rates]))
    return ImuSample(stamp_s, turned[0], turned[1])


def battery(fields: Received) -> tuple[float | None, float | None, float | None, float | None]:
    """BATTERY_STATUS (147) -> voltage [V], remaining 0..1, current [A], energy used [J]; None = not known."""
    cells = [v for v in fields["voltages"] if v != UNUSED_CELL] + [v for v in fields["voltages_ext"] if v]
    percent, centi_a, hecto_j = (
        fields["battery_remaining"],
        fields["current_battery"],
        fields["energy_consumed"],
    )
    return (
        sum(cells) * 1e-3 if cells else None,
        percent * 1e-2 if percent >= 0 else None,
        centi_a * 1e-2 if centi_a >= 0 else None,
        hecto_j * 100.0 if hecto_j >= 0 else None,
    )


def mode_and_intention(latest: Mapping[str, Message]) -> tuple[str, str]:
    """The mode that runs, by the newer of HEARTBEAT and CURRENT_MODE, and the one asked for ("" = untold)."""
    beat, current = latest["HEARTBEAT"], latest.get("CURRENT_MODE")
    if current is None:
        return heartbeat(beat.fields).mode, ""
    family = FAMILIES.get(int(beat.fields["autopilot"]), PX4)
    newest = beat if beat.arrival_s > current.arrival_s else current
    mode = family.mode_name(int(newest.fields["custom_mode"]))
    asked = int(current.fields["intended_custom_mode"])  # 0 = the autopilot does not tell
    return mode, family.mode_name(asked) if asked else ""


def air_state(latest: Mapping[str, Message], heard_s: float, now_s: float) -> AirState:
    """The state at `now_s` from the latest message of each kind.

    Args:
        latest: By MAVLink name; must hold HEARTBEAT.
        heard_s: When the autopilot was last heard at all.
        now_s: Our clock.
    """
    beat = latest["HEARTBEAT"]
    word = heartbeat(beat.fields)
    age_s = now_s - beat.arrival_s
    connected = age_s < HEARTBEAT_LOST_S and now_s - heard_s < LINK_SILENT_S

    def fresh(name: str) -> Received:
        message = latest.get(name)
        return message.fields if message and now_s - message.arrival_s < STALE_S else {}

    local, turned = fresh("LOCAL_POSITION_NED"), fresh("ATTITUDE_QUATERNION")
    mode, intended = mode_and_intention(latest)
    family = FAMILIES.get(word.autopilot, PX4)
    pack = latest.get("BATTERY_STATUS")
    volts, remaining, amps, joules = battery(pack.fields) if pack else (None, None, None, None)
    system = latest.get("EXTENDED_SYS_STATE")
    landed = px4.landed_name(int(system.fields["landed_state"])) if system and connected else "unknown"
    fault = None
    if not connected:
        silent_s = now_s - heard_s
        fault = f"the autopilot is silent for {silent_s:.1f} s and sent no heartbeat for {age_s:.1f} s"
    elif word.critical:
        fault = f"the autopilot reports a failsafe in mode {mode}"
    return AirState(
        stamp_s=heard_s,
        connected=connected,
        armed=word.armed,
        mode=mode if connected else "unknown",
        landed=landed,
        position_m=position_odom(local),
        velocity_mps=velocity_odom(local),
        attitude=attitude_odom(turned),
        battery_v=volts,
        battery_remaining=remaining,
        current_a=amps,
        heartbeat_age_s=age_s,
        failsafe=word.critical,
        battery_used_j=joules,
        fault=fault,
        intended=intended if connected else "",
        lifts_by_command=family.lifts_by_command,
        resumes=family.resumes,
    )
