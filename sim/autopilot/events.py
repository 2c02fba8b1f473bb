"""PX4's EVENT (410), which a companion gets in place of STATUSTEXT; numbers and levels as recorded."""

from __future__ import annotations

import enum
import struct

from pymavlink.dialects.v20 import development as mavlink
from pymavlink.generator.mavcrc import x25crc

EVENT_ID = 410
CRC_EXTRA = 160  # of EVENT in MAVLink's common.xml; pymavlink 2.4.50 has no definition of it
_PAYLOAD = struct.Struct("<IIHBBB")
_OFFBOARD = b"\x00\x40\x00\x00"  # mask of the modes that a check is about


class Event(enum.Enum):
    """Number, log levels (inner, outer), arguments."""

    ARM_DENIED = (0x102089D, 0x62, b"")
    DISARM_DENIED = (0x18AB9B5, 0x62, b"")
    ARMED = (0x190CAF3, 0x66, b"\x04")
    DISARMED = (0x1F46777, 0x66, b"\x06")
    TAKE_OFF = (0x1414569, 0x66, b"")
    LANDED = (0x19638AC, 0x66, b"")
    FAILSAFE = (0x1DEDBD0, 0x42, b"\x00\x00\x06\x00\x07")
    CHECKS = (0x1A893E0, 0x88, b"\x00\x00\x00\x10\x01\x80")
    NO_SETPOINTS = (0x1AEEF7E, 0x33, _OFFBOARD + b"\x14")


class EventMessage:
    """One event, packed as pymavlink's messages are."""

    def __init__(self, event: Event, boot_ms: int, sequence: int) -> None:
        number, levels, arguments = event.value
        self._payload = _PAYLOAD.pack(number, boot_ms, sequence, 0, 0, levels) + arguments

    def pack(self, codec: mavlink.MAVLink) -> bytes:
        """The frame (MAVLink 2, trailing zeros cut)."""
        payload = self._payload.rstrip(b"\0") or b"\0"
        sender = (codec.srcSystem, codec.srcComponent)
        header = bytes((len(payload), 0, 0, codec.seq, *sender)) + EVENT_ID.to_bytes(3, "little")
        crc = x25crc(header + payload)
        crc.accumulate(bytes([CRC_EXTRA]))
        return b"\xfd" + header + payload + struct.pack("<H", crc.crc)
