"""Is what answers a vehicle that this stack may fly? Pure."""

from __future__ import annotations

from dataclasses import dataclass

from labr_autonomy.air import px4
from labr_autonomy.air.families import FAMILIES, Family, Version
from labr_autonomy.air.telemetry import Received
from labr_autonomy.errors import ExitCode, LinkError


class WrongVehicle(LinkError):
    """Something else than the robot's autopilot answers; a matter of wiring or of robot.yaml."""

    exit_code = ExitCode.BAD_INPUT


@dataclass(frozen=True, slots=True)
class Release:
    """What AUTOPILOT_VERSION says."""

    version: Version
    text: str  # "1.18.0"
    local_setpoints: bool  # takes SET_POSITION_TARGET_LOCAL_NED


def check_vehicle(system: int, beat: Received, url: str, name: str, wanted_system: int = 1) -> Family:
    """The family of the autopilot that answers; anything but a multicopter of ours is refused.

    Args:
        system: System id that was found.
        beat: Fields of its HEARTBEAT.
        url: Where it answers, for the sentence.
        name: The robot's name.
        wanted_system: The robot's system id.

    Raises:
        WrongVehicle: It is something else; the sentence names what.
    """
    if system != wanted_system:
        raise WrongVehicle(
            f"the autopilot on {url} has system id {system}, {name}'s has {wanted_system}",
            "Check which vehicle is connected, or set its system id to "
            f"{wanted_system} (PX4: MAV_SYS_ID, ArduPilot: MAV_SYSID).",
        )
    family = FAMILIES.get(int(beat["autopilot"]))
    if family is None:
        number = int(beat["autopilot"])
        found = px4.AUTOPILOTS.get(number, f"an autopilot of MAV_AUTOPILOT {number}")
        supported = " and ".join(f.name for f in FAMILIES.values())
        raise WrongVehicle(
            f"{found} answers on {url}, and only {supported} are supported",
            "Flash one of these, or check the address.",
        )
    vehicle = int(beat["type"])
    if vehicle not in px4.MULTICOPTERS:
        found = px4.VEHICLES.get(vehicle, f"vehicle of MAV_TYPE {vehicle}")
        raise WrongVehicle(
            f"the vehicle on {url} is a {found}, not a multicopter",
            "Check which vehicle is connected, or its airframe (PX4: SYS_AUTOSTART, ArduPilot: FRAME_CLASS).",
        )
    return family


def release_of(fields: Received) -> Release:
    """AUTOPILOT_VERSION (148)."""
    number = int(fields["flight_sw_version"])
    major, minor, patch = number >> 24 & 0xFF, number >> 16 & 0xFF, number >> 8 & 0xFF
    capable = bool(int(fields["capabilities"]) & px4.CAPABILITY_LOCAL_SETPOINTS)
    return Release((major, minor), f"{major}.{minor}.{patch}", capable)


def check_release(family: Family, release: Release, url: str) -> None:
    """Refuse a firmware that lacks what this stack relies on.

    Raises:
        WrongVehicle: With the version that is needed and why.
    """
    if release.version != (0, 0) and release.version < family.oldest:
        major, minor = family.oldest
        raise WrongVehicle(
            f"{family.name} {release.text} on {url} is too old: {family.oldest_because}",
            f"Flash {family.name} {major}.{minor} or newer.",
        )
    if not release.local_setpoints:
        raise WrongVehicle(
            f"{family.name} {release.text} on {url} says that it takes no local set-points",
            "Flash a full build of the multicopter firmware.",
        )
