"""Cut a byte stream into MAVLink 2 frames, and lose as little as possible when the stream is damaged.

Frame: 0xFD, payload length, incompatibility flags, compatibility flags, sequence, system, component,
message number (3 bytes, little endian), payload, CRC-16/MCRF4XX over all but the first byte plus CRC_EXTRA
(mavlink.io, "Packet Serialization"). Signed frames and MAVLink 1 are not part of this link.

A plain parser that meets a false start byte swallows up to 280 bytes, good frames included. Four guards:
1. 0xFE, the start byte of MAVLink 1, starts nothing;
2. the stream is idle for 20 ms: whatever waits for its end will not get one;
3. a header that no message of the dialect can have is no header;
4. a frame with a wrong checksum gives back all but its first byte, which are searched again.
`core/land_frame.c` follows the same rules; a buffer of one largest frame is enough for them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from firmware_bridge.dialect import labr_land

START = 0xFD
START_V1 = 0xFE
HEADER_BYTES = 10
HEADER_BYTES_V1 = 6
CRC_BYTES = 2
IDLE_GAP_S = 0.020  # one telemetry period; measured to bound the loss to one frame


@dataclass(frozen=True, slots=True)
class Guards:
    """Which guards work; the tests switch them off one by one to show what each is for."""

    ignore_v1: bool = True
    idle_gap_s: float | None = IDLE_GAP_S
    check_header: bool = True
    search_again: bool = True


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame with a good checksum."""

    message_id: int
    sequence: int
    system: int
    component: int
    raw: bytes  # the whole frame as received


@dataclass(frozen=True, slots=True)
class Shape:
    """What the dialect says of one message number."""

    crc_extra: int
    payload_bytes_max: int


def dialect_shapes() -> Mapping[int, Shape]:
    """Shapes of all messages of the dialect, by message number."""
    return {
        number: Shape(message.crc_extra, message.unpacker.size)
        for number, message in labr_land.mavlink_map.items()
    }


class Framer:
    """The parser. Feed it bytes with the time they came; it returns the frames they complete."""

    def __init__(self, guards: Guards | None = None) -> None:
        self._guards = guards or Guards()
        self._shapes = dialect_shapes()
        self._buffer = bytearray()
        self._last_s: float | None = None
        self.bad_crc = 0  # frames whose checksum was wrong
        self.skipped_bytes = 0  # bytes that belonged to no good frame
        self.resyncs = 0  # times the search for a start byte had to begin anew

    def feed(self, data: bytes, now_s: float) -> list[Frame]:
        """Take `data`, received at `now_s` [s] on any monotonic scale."""
        frames: list[Frame] = []
        if not data:
            return frames  # nothing came: the stream stays idle
        gap_s = self._guards.idle_gap_s
        if gap_s is not None and self._last_s is not None and now_s - self._last_s >= gap_s:
            self._drain(frames)
        self._last_s = now_s
        self._buffer += data
        self._cut(frames)
        return frames

    def reset(self) -> None:
        """Forget a half-received frame."""
        self._buffer.clear()
        self._last_s = None

    def _drain(self, frames: list[Frame]) -> None:
        """The rest of what waits in the buffer will not come; frames behind a false start still count."""
        while self._buffer:
            self._reject(1 if self._guards.search_again else len(self._buffer))
            self._cut(frames)

    def _cut(self, frames: list[Frame]) -> None:
        """Take frames off the buffer until it needs more bytes."""
        while self._seek_start():
            length = self._frame_length()
            if length is None:
                return
            if length == 0:
                self._reject(1)
            elif len(self._buffer) < length:
                return
            else:
                self._take(length, frames)

    def _seek_start(self) -> bool:
        """Drop bytes up to a start byte; False if there is none."""
        for i, byte in enumerate(self._buffer):
            if byte == START or (byte == START_V1 and not self._guards.ignore_v1):
                self.skipped_bytes += i
                del self._buffer[:i]
                return True
        self.skipped_bytes += len(self._buffer)
        self._buffer.clear()
        return False

    def _frame_length(self) -> int | None:
        """Length of the frame at the front [bytes]; 0 if it cannot be one, None if that is not known yet."""
        buffer = self._buffer
        if len(buffer) < 2:
            return None
        if buffer[0] == START_V1:
            return HEADER_BYTES_V1 + buffer[1] + CRC_BYTES
        if self._guards.check_header:
            if len(buffer) > 2 and buffer[2] != 0:
                return 0
            if len(buffer) < HEADER_BYTES:
                return None
            shape = self._shapes.get(int.from_bytes(buffer[7:10], "little"))
            if shape is None or not 1 <= buffer[1] <= shape.payload_bytes_max:
                return 0
        return HEADER_BYTES + buffer[1] + CRC_BYTES

    def _take(self, length: int, frames: list[Frame]) -> None:
        raw = bytes(self._buffer[:length])
        if self._good(raw):
            del self._buffer[:length]
            number = int.from_bytes(raw[7:10], "little")
            frames.append(Frame(number, sequence=raw[4], system=raw[5], component=raw[6], raw=raw))
            return
        self.bad_crc += 1
        self._reject(1 if self._guards.search_again else length)

    def _good(self, raw: bytes) -> bool:
        if raw[0] != START or raw[2] != 0:
            return False
        shape = self._shapes.get(int.from_bytes(raw[7:10], "little"))
        if shape is None or raw[1] > shape.payload_bytes_max:
            return False
        crc = labr_land.x25crc(raw[1:-CRC_BYTES] + bytes([shape.crc_extra])).crc
        return crc == int.from_bytes(raw[-CRC_BYTES:], "little")

    def _reject(self, count: int) -> None:
        """The first `count` bytes are no frame."""
        self.skipped_bytes += count
        self.resyncs += 1
        del self._buffer[:count]
