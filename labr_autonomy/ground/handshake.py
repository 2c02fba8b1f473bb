"""Who is at the other end, and whether the two sides understand each other."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_bridge.dialect import labr_land as wire
from firmware_bridge.link import text_of
from labr_autonomy.errors import LinkError


@dataclass(frozen=True, slots=True)
class Identity:
    """What the land controller says of itself."""

    nonce: int
    session: int
    serial: str
    firmware: str  # major.minor.patch
    protocol: int
    dialect_hash: int
    boot_count: int

    @classmethod
    def of(cls, message: wire.MAVLink_land_identity_message) -> Identity:
        """From the wire."""
        version = message.firmware
        return cls(
            nonce=message.nonce,
            session=message.session,
            serial=text_of(message.serial),
            firmware=f"{version >> 16 & 0xFF}.{version >> 8 & 0xFF}.{version & 0xFF}",
            protocol=message.protocol,
            dialect_hash=message.dialect_hash,
            boot_count=message.boot_count,
        )


def refusal(identity: Identity, expected_serial: str | None) -> LinkError | None:
    """Why this controller must not be driven, None if it may.

    Args:
        identity: What it says.
        expected_serial: Serial number of the controller this run began with, if any.
    """
    who = f"The land controller {identity.serial} (firmware {identity.firmware})"
    if identity.protocol < wire.PROTOCOL:
        return LinkError(
            f"{who} speaks protocol {identity.protocol}, this computer speaks {wire.PROTOCOL}",
            "Update the land controller: flash the firmware that belongs to this release.",
        )
    if identity.protocol > wire.PROTOCOL:
        return LinkError(
            f"{who} speaks protocol {identity.protocol}, this computer speaks {wire.PROTOCOL}",
            "Update this computer: install the labr-autonomy release that belongs to the firmware.",
        )
    if identity.dialect_hash != wire.DIALECT_HASH:
        return LinkError(
            f"{who} was built from dialect {identity.dialect_hash:08X}, "
            f"this computer from {wire.DIALECT_HASH:08X}",
            "Update the land controller: flash the firmware built from this release's labr_land.xml.",
        )
    if not identity.session:
        return LinkError(f"{who} refused to open a session", "Reset the land controller and try again.")
    if expected_serial is not None and identity.serial != expected_serial:
        return LinkError(
            f"{who} is not the controller {expected_serial} that this run began with",
            "Plug the first one back in, or start again.",
        )
    return None
