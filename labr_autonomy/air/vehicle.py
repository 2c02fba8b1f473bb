"""Is what answers the vehicle that this stack may fly? Pure."""

from __future__ import annotations

from labr_autonomy.air import px4
from labr_autonomy.air.telemetry import Heartbeat
from labr_autonomy.errors import LinkError


def check_vehicle(system: int, beat: Heartbeat, url: str, name: str) -> None:
    """Refuse anything but PX4 on a multicopter with system id 1.

    Raises:
        LinkError: It is something else; the sentence names what.
    """
    if system != px4.VEHICLE_SYSTEM:
        raise LinkError(
            f"the autopilot on {url} has system id {system}, {name}'s has {px4.VEHICLE_SYSTEM}",
            "Check which vehicle is connected, or set MAV_SYS_ID to 1.",
        )
    if beat.autopilot != px4.AUTOPILOT_PX4:
        found = px4.AUTOPILOTS.get(beat.autopilot, f"an autopilot of MAV_AUTOPILOT {beat.autopilot}")
        raise LinkError(
            f"{found} answers on {url}, and only PX4 is supported",
            "Flash PX4; ArduPilot support comes later.",
        )
    if beat.vehicle not in px4.MULTICOPTERS:
        found = px4.VEHICLES.get(beat.vehicle, f"vehicle of MAV_TYPE {beat.vehicle}")
        raise LinkError(
            f"the vehicle on {url} is a {found}, not a multicopter",
            "Check which vehicle is connected, or its airframe (SYS_AUTOSTART).",
        )
