"""The seam between a depth camera process and whoever looks: the newest frames in shared memory.

A frame travels as uint16 millimetres (the camera's own Z16 format), 0 = invalid, with the stamp of its
mid-exposure on the machine's monotonic clock.
"""

from __future__ import annotations

import struct

import numpy as np

from labr_autonomy.errors import BadInput
from labr_autonomy.perception.shared_ring import RingReader, RingWriter
from labr_autonomy.types import DepthFrame, Image, Intrinsics

SLOTS = 4  # a reader has three frame periods (100 ms at 30 Hz) to copy one frame
_META = struct.Struct("=2I4d")  # width, height, fx, fy, cx, cy
_STAMP = struct.Struct("=d")
_MAX_M = 65.535


class FrameWriter:
    """Publishes depth frames under a name.

    Args:
        name: Name of the slot; unique per run.
        intrinsics: Camera model of every frame.
    """

    def __init__(self, name: str, intrinsics: Intrinsics) -> None:
        i = intrinsics
        self._shape = (i.height, i.width)
        meta = _META.pack(i.width, i.height, i.fx, i.fy, i.cx, i.cy)
        self._ring = RingWriter(name, meta, _STAMP.size + 2 * i.width * i.height, SLOTS)

    def write(self, stamp_s: float, depth_m: Image) -> int:
        """Publish one frame and return its sequence number.

        Args:
            stamp_s: Mid-exposure, monotonic clock [s].
            depth_m: (h, w) float32 along the optical axis [m]; 0, negative, beyond 65.5 m and not-a-number
                are all taken as invalid.
        """
        if depth_m.shape != self._shape:
            raise BadInput(f"a depth frame of shape {depth_m.shape} was given to a slot of {self._shape}")
        valid = (depth_m > 0.0) & (depth_m <= _MAX_M)  # False for not-a-number
        millimetres = np.rint(np.where(valid, depth_m, 0.0) * 1000.0).astype(np.uint16)
        return self._ring.write(_STAMP.pack(stamp_s), millimetres.data.cast("B"))

    def close(self) -> None:
        """Remove the slot."""
        self._ring.close()


class FrameReader:
    """Looks at the newest depth frames.

    Args:
        name: Name given to the writer.
        timeout_s: How long to wait for the writer to appear [s]; LinkError afterwards.
    """

    def __init__(self, name: str, timeout_s: float = 5.0) -> None:
        self._ring = RingReader(name, timeout_s, "depth frames")

    @property
    def intrinsics(self) -> Intrinsics:
        """Camera model of the frames."""
        return Intrinsics(*_META.unpack(self._ring.meta))

    def _frame(self, sequence: int, payload: bytes) -> DepthFrame:
        intrinsics = self.intrinsics
        (stamp_s,) = _STAMP.unpack_from(payload)
        millimetres = np.frombuffer(payload, np.uint16, intrinsics.width * intrinsics.height, _STAMP.size)
        shape = (intrinsics.height, intrinsics.width)
        depth_m: Image = np.divide(millimetres.reshape(shape), np.float32(1000.0), dtype=np.float32)
        return DepthFrame(sequence, stamp_s, depth_m, intrinsics)

    def latest(self) -> DepthFrame | None:
        """The newest complete frame; None before the first. The same frame again while none is newer."""
        found = self._ring.read_newest()
        return None if found is None else self._frame(*found)

    def newest_header(self) -> tuple[int, float] | None:
        """Sequence number and stamp [s] of the newest frame, without copying its image."""
        found = self._ring.read_newest(_STAMP.size)
        return None if found is None else (found[0], _STAMP.unpack(found[1])[0])

    def get(self, sequence: int) -> DepthFrame | None:
        """One of the last frames by number; None when it was overwritten."""
        self._ring.newest()  # moves over to a restarted writer
        payload = self._ring.read(sequence)
        return None if payload is None else self._frame(sequence, payload)

    def close(self) -> None:
        """Let go of the slot; it stays for its writer and other readers."""
        self._ring.close()
