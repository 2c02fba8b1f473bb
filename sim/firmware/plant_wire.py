"""Frames between the emulated firmware's second serial port and the simulated robot.

Start byte, little-endian payload, CRC-16/MCRF4XX over the payload; `port/stm32f405/board_plant.c` is the
other end. Pins go to the firmware, duty comes back.
"""

from __future__ import annotations

import struct

from firmware_bridge.dialect import labr_land
from firmware_bridge.host.library import wrapped
from firmware_bridge.pins import Duty, Inputs

PINS_START, DRIVE_START = 0x95, 0x96
_PINS = struct.Struct("<IiiiiiiB")
_DRIVE = struct.Struct("<IhhB")
_DRIVE_BYTES = 1 + _DRIVE.size + 2
DUTY_UNIT = 1e-4


def _crc(payload: bytes) -> bytes:
    crc: int = labr_land.x25crc(payload).crc
    return crc.to_bytes(2, "little")


def pins_frame(inputs: Inputs, time_ms: int) -> bytes:
    """What the firmware reads instead of its pins; `time_ms` is the plant's clock."""
    flags = (
        inputs.wheel_load | inputs.rotors_possible << 1 | inputs.driver_fault << 2 | inputs.estop_pressed << 3
    )
    payload = _PINS.pack(
        time_ms & 0xFFFFFFFF,
        round(1000.0 * inputs.battery_v),
        round(1000.0 * inputs.current_a),
        round(1000.0 * inputs.left_a),
        round(1000.0 * inputs.right_a),
        wrapped(inputs.left_ticks),
        wrapped(inputs.right_ticks),
        flags,
    )
    return bytes([PINS_START]) + payload + _crc(payload)


class DriveReader:
    """Finds drive frames in a stream."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> Duty | None:
        """Take bytes; the newest duty in them, None if there was none."""
        self._buffer += data
        newest = None
        while True:
            start = self._buffer.find(DRIVE_START)
            if start < 0:
                self._buffer.clear()
                return newest
            del self._buffer[:start]
            if len(self._buffer) < _DRIVE_BYTES:
                return newest
            payload = bytes(self._buffer[1 : _DRIVE_BYTES - 2])
            if _crc(payload) != self._buffer[_DRIVE_BYTES - 2 : _DRIVE_BYTES]:
                del self._buffer[:1]
                continue
            del self._buffer[:_DRIVE_BYTES]
            _, left, right, braked = _DRIVE.unpack(payload)
            newest = Duty(left * DUTY_UNIT, right * DUTY_UNIT, bool(braked))
