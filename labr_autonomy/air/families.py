"""The autopilots that this stack can fly, and what each may do; pure.

`FAMILIES` is the capability table. Its figures were measured on PX4 1.18 and ArduCopter 4.7; what is not
supported is refused by `labr_autonomy.air.vehicle` before anything is armed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from labr_autonomy.air import ardupilot, px4

Version = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Family:
    """One kind of autopilot."""

    name: str
    autopilot: int  # MAV_AUTOPILOT
    follow_mode: str  # word of the mode in which it obeys set-points
    follow_request: tuple[float, ...]  # parameters of DO_SET_MODE for it
    mode_name: Callable[[int], str]
    streams: Mapping[str, tuple[int, float]]  # message id and rate [Hz] of what the executive reads
    imu: str  # which of them is the inertial measurement
    oldest: Version  # earlier releases lack what this stack relies on
    oldest_because: str
    lifts_by_command: bool  # on the floor it ignores set-points; NAV_TAKEOFF lifts it off
    wants_origin: bool  # needs a global origin before it fuses poses; PX4's estimate jumps by kilometres then
    resumes: bool  # after lost set-points it comes back to `follow_mode` by itself when they return
    on_silence: str  # what it does when set-points stop, to complete "it ..."


PX4 = Family(
    name="PX4",
    autopilot=px4.AUTOPILOT_PX4,
    follow_mode="offboard",
    follow_request=(float(px4.CUSTOM_MODE_FLAG), float(px4.MAIN_OFFBOARD)),
    mode_name=px4.mode_name,
    streams=px4.STREAMS,
    imu="HIGHRES_IMU",
    oldest=(1, 14),
    oldest_because="EKF2_EV_CTRL came with 1.14",
    lifts_by_command=False,
    wants_origin=False,
    resumes=True,
    on_silence="lands after COM_OF_LOSS_T",
)
ARDUPILOT = Family(
    name="ArduPilot",
    autopilot=ardupilot.AUTOPILOT_ARDUPILOT,
    follow_mode="guided",
    follow_request=(float(px4.CUSTOM_MODE_FLAG), float(ardupilot.GUIDED)),
    mode_name=ardupilot.mode_name,
    streams=ardupilot.STREAMS,
    imu="RAW_IMU",
    oldest=(4, 1),
    oldest_because="position, velocity and acceleration together came with 4.1",
    lifts_by_command=True,
    wants_origin=True,
    resumes=False,
    on_silence="stops after GUID_TIMEOUT and hovers; it does not land by itself",
)
FAMILIES: Mapping[int, Family] = {family.autopilot: family for family in (PX4, ARDUPILOT)}
FOLLOW_MODES = frozenset(family.follow_mode for family in FAMILIES.values())
