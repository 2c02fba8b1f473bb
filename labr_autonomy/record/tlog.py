"""The link's log in the tlog format: big-endian microseconds since the epoch, then one MAVLink frame.

Read by mavlogdump, MAVProxy, QGroundControl and Mission Planner. A thread of its own writes to the disk
twice a second, so a slow disk never holds up the caller; a full disk ends the log, never the flight.
"""

from __future__ import annotations

import struct
import threading
from collections.abc import Iterator
from pathlib import Path

MAGIC_V1 = 0xFE
MAGIC_V2 = 0xFD
SIGNED = 0x01  # MAVLINK_IFLAG_SIGNED
SETUP_SIGNING = b"\x00\x01\x00"  # message 256 as in a frame; its payload is the key
FLUSH_S = 0.5
PENDING_MAX = 8 * 1024 * 1024  # bytes that may wait for the disk: minutes of an onboard link


def frame_length(data: bytes, start: int) -> int | None:
    """Length of the MAVLink frame that starts at `start`; None if no whole frame starts there."""
    left = len(data) - start
    if left < 8:
        return None
    if data[start] == MAGIC_V1:
        length = 8 + data[start + 1]
    elif data[start] == MAGIC_V2:
        length = 12 + data[start + 1] + (13 if data[start + 2] & SIGNED else 0)
    else:
        return None
    return length if length <= left else None


def split_frames(datagram: bytes) -> Iterator[bytes]:
    """The MAVLink frames of a datagram; bytes between them are skipped."""
    start = 0
    while start < len(datagram):
        length = frame_length(datagram, start)
        if length is None:
            start += 1
        else:
            yield datagram[start : start + length]
            start += length


class Tlog:
    """A tlog file being written."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.frames = 0
        self.dropped = 0  # frames lost to a slow or full disk
        self.fault: str | None = None
        self._file = path.open("wb", buffering=0)
        self._pending = bytearray()
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"tlog-{path.name}", daemon=True)
        self._thread.start()

    def write(self, stamp_utc_s: float, data: bytes) -> None:
        """Log the frames of one datagram; returns at once, from any thread.

        Args:
            stamp_utc_s: When it was sent or received [s since the epoch].
            data: One or more MAVLink 1 or 2 frames.
        """
        stamp = struct.pack(">Q", int(stamp_utc_s * 1e6))
        with self._lock:
            for frame in split_frames(data):
                if frame[0] == MAGIC_V2 and frame[7:10] == SETUP_SIGNING:
                    continue  # never logged (MAVLink guide, "Message signing")
                if self.fault or len(self._pending) > PENDING_MAX:
                    self.dropped += 1
                    continue
                self._pending += stamp
                self._pending += frame
                self.frames += 1

    def close(self) -> None:
        """Write what waits and close the file; can be called again."""
        self._closing.set()
        self._thread.join()
        self._file.close()

    def _run(self) -> None:
        while not self._closing.wait(FLUSH_S):
            self._flush()
        self._flush()

    def _flush(self) -> None:
        with self._lock:
            pending, self._pending = self._pending, bytearray()
        view = memoryview(pending)
        try:
            while view and not self.fault:
                view = view[self._file.write(view) :]
        except OSError as error:
            self.fault = f"{self.path.name} stopped after {self.frames} frames: {error.strerror}"
