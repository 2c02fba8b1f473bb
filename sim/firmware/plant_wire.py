"""Frames between the emulated firmware's second serial port and the simulated robot.

Start byte, little-endian payload, CRC-16/MCRF4XX over the payload; `port/stm32f405/board_plant.c` is the
other end. Pins go to the firmware, duty comes back.
"""

from __future__ import annotations

import struct

from firmware_bridge.dialect import labr_land
from firmware_bridge.pins import Duty, Inputs, wrapped

PINS_START, DRIVE_START = 0x95, 0x96
_PINS = struct.Struct("<IiiHhhhB")
_DRIVE = struct.Struct("<hhB")
_DRIVE_BYTES = 1 + _DRIVE.size + 2
DUTY_UNIT = 1e-4


def _crc(payload: bytes) -> bytes:
    crc: int = labr_land.x25crc(payload).crc
    return crc.to_bytes(2, "little")


def _hundredths(amps: float) -> int:
    return max(-0x8000, min(0x7FFF, round(100.0 * amps)))


def pins_frame(inputs: Inputs, time_ms: int) -> bytes:
    """What the firmware reads instead of its pins; `time_ms` is the plant's clock."""
    flags = (
        inputs.wheel_load | inputs.rotors_possible << 1 | inputs.driver_fault << 2 | inputs.estop_pressed << 3
    )
    payload = _PINS.pack(
        time_ms & 0xFFFFFFFF,
        wrapped(inputs.left_ticks),
        wrapped(inputs.right_ticks),
        max(0, min(0xFFFF, round(100.0 * inputs.battery_v))),
        _hundredths(inputs.current_a),
        _hundredths(inputs.left_a),
        _hundredths(inputs.right_a),
        flags,
    )
    return bytes([PINS_START]) + payload + _crc(payload)


class PinsWriter:
    """Decides when the firmware is told its pins: every second step, and at once when a switch changes."""

    def __init__(self) -> None:
        self._switches: tuple[bool, ...] = ()
        self._due = False

    def frame(self, inputs: Inputs, time_ms: int) -> bytes:
        """The frame to send in this step, possibly none; `time_ms` is the plant's clock."""
        switches = (inputs.wheel_load, inputs.rotors_possible, inputs.driver_fault, inputs.estop_pressed)
        self._due = not self._due or switches != self._switches
        self._switches = switches
        return pins_frame(inputs, time_ms) if self._due else b""


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
            left, right, braked = _DRIVE.unpack(payload)
            newest = Duty(left * DUTY_UNIT, right * DUTY_UNIT, bool(braked))
