"""PX4's EVENT messages as sentences; pure.

PX4 sends STATUSTEXT only on links that carry a ground station's heartbeat; a companion gets events. An
event's number is the 24-bit FNV-1a hash of its name in PX4's source, with the component (1, the autopilot)
above it; so the names in this table are all that is needed, without PX4's metadata file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from labr_autonomy.air.telemetry import Received

AUTOPILOT: Final = 1 << 24
ERROR: Final = 3  # events::Log
OFFBOARD_BIT: Final = 1 << 14  # vehicle_status_s::NAVIGATION_STATE_OFFBOARD
SUMMARY: Final = 0x01A893E0  # arming_check_summary: the checks that follow it replace the earlier ones

# name in PX4's source: what it means
_MEANINGS: Final = {
    "commander_arm_denied_resolve_failures": "arming denied, its health checks fail",
    "commander_disarm_denied_not_landed": "disarming denied, not landed",
    "commander_armed_by": "armed",
    "commander_disarmed_by": "disarmed",
    "commander_takeoff_detected": "take-off detected",
    "commander_landing_detected": "landing detected",
    "commander_failsafe_enter_generic": "failsafe",
    "commander_failsafe_enter_generic_hold": "failsafe, holding first",
    "commander_failsafe_enter": "failsafe",
    "check_modes_angular_velocity": "angular velocity is not valid",
    "check_modes_attitude": "attitude is not valid",
    "check_modes_local_pos": "no valid local position estimate",
    "check_modes_global_pos": "no global position",
    "check_modes_home_position": "no home position",
    "check_modes_mission": "no valid mission",
    "check_modes_manual_control": "no manual control input",
    "check_modes_offboard_no_signal": "no set-points arrive",
    "check_modes_offboard_signal_lost": "set-points have stopped",
    "check_modes_offboard_signal": "no set-points arrive",
    "check_rc_dl_no_dllink": "no connection to a ground station",
    "check_estimator_not_stable": "attitude estimate is not stable yet",
    "check_mag_missing": "no compass",
    "check_gyro_missing": "no gyroscope",
    "check_accel_missing": "no accelerometer",
    "check_battery_low": "battery is low",
}


def event_id(name: str) -> int:
    """Number of one of the autopilot's events by its name in PX4's source."""
    value = 0x811C9DC5
    for byte in name.encode():
        value = (value ^ byte) * 0x01000193 & 0xFFFFFFFF
    return AUTOPILOT | value & 0xFFFFFF


_NAMES: Final = {event_id(name): name for name in _MEANINGS}


@dataclass(frozen=True, slots=True)
class Event:
    """One event."""

    number: int
    name: str  # as in PX4's source, "" when this table does not have it
    level: int  # events::Log, outward: 0 emergency ... 3 error, 4 warning, 6 info, 8 protocol
    arguments: Sequence[int]

    @property
    def text(self) -> str:
        """What it means, or its number."""
        return _MEANINGS.get(self.name, f"event {self.number:08X}")

    @property
    def hinders_offboard(self) -> bool:
        """Whether it is a failed check of offboard; a check's first argument is the mask of its modes."""
        if not self.name.startswith("check_") or self.level > ERROR or len(self.arguments) < 4:
            return False
        return bool(int.from_bytes(bytes(self.arguments[:4]), "little") & OFFBOARD_BIT)


def event_of(fields: Received) -> Event:
    """EVENT (410)."""
    number = int(fields["id"])
    return Event(
        number,
        _NAMES.get(number, ""),
        int(fields["log_levels"]) & 0x0F,
        tuple(int(v) for v in fields["arguments"]),
    )
