"""The truth for the sensor processes, in shared memory: the body's pose, and how far the movers are."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from labr_autonomy.perception.shared_ring import RingReader, RingWriter
from labr_autonomy.types import Pose

_POSE = struct.Struct("=8d")  # stamp_s, position xyz [m] odom, quaternion wxyz body to odom
_ALONG = struct.Struct("=d")  # how far along its track each mover is [m]
SLOTS = 8  # at 1 kHz a reader has 7 ms to copy 64 bytes


class PoseSlotWriter:
    """Publishes the truth under a name.

    Args:
        name: Name of the slot; unique per run.
        movers: How many movers there are.
    """

    def __init__(self, name: str, movers: int = 0) -> None:
        self._ring = RingWriter(name, b"", _POSE.size + movers * _ALONG.size, SLOTS)

    def write(self, stamp_s: float, pose: Pose, along_m: Sequence[float] = ()) -> int:
        """Publish the truth at `stamp_s` (monotonic clock) and return its sequence number."""
        whole = _POSE.pack(stamp_s, *pose.position_m, *pose.quaternion)
        return self._ring.write(whole + b"".join(_ALONG.pack(v) for v in along_m))

    def close(self) -> None:
        """Remove the slot."""
        self._ring.close()


class PoseSlotReader:
    """Looks at the newest truth.

    Args:
        name: Name given to the writer.
        timeout_s: How long to wait for the writer to appear [s]; LinkError afterwards.
    """

    def __init__(self, name: str, timeout_s: float = 5.0) -> None:
        self._ring = RingReader(name, timeout_s, "pose slot")

    def latest(self) -> tuple[float, Pose] | None:
        """Stamp [s] and the newest true pose; None before the first."""
        found = self.latest_whole()
        return None if found is None else found[:2]

    def latest_whole(self) -> tuple[float, Pose, list[float]] | None:
        """Stamp [s], true pose and how far along its track each mover is [m], of one instant."""
        found = self._ring.read_newest()
        if found is None:
            return None
        stamp_s, *values = _POSE.unpack_from(found[1])
        along_m = [v for (v,) in _ALONG.iter_unpack(found[1][_POSE.size :])]
        return stamp_s, Pose(np.array(values[:3]), np.array(values[3:])), along_m

    def close(self) -> None:
        """Let go of the slot; it stays for its writer and other readers."""
        self._ring.close()
