"""The true pose of the body, from the simulator core to the sensor processes, in shared memory."""

from __future__ import annotations

import struct

import numpy as np

from labr_autonomy.perception.shared_ring import RingReader, RingWriter
from labr_autonomy.types import Pose

_POSE = struct.Struct("=8d")  # stamp_s, position xyz [m] odom, quaternion wxyz body to odom
SLOTS = 8  # at 1 kHz a reader has 7 ms to copy 64 bytes


class PoseSlotWriter:
    """Publishes the true pose under a name.

    Args:
        name: Name of the slot; unique per run.
    """

    def __init__(self, name: str) -> None:
        self._ring = RingWriter(name, b"", _POSE.size, SLOTS)

    def write(self, stamp_s: float, pose: Pose) -> int:
        """Publish the pose at `stamp_s` (monotonic clock) and return its sequence number."""
        return self._ring.write(_POSE.pack(stamp_s, *pose.position_m, *pose.quaternion))

    def close(self) -> None:
        """Remove the slot."""
        self._ring.close()


class PoseSlotReader:
    """Looks at the newest true pose.

    Args:
        name: Name given to the writer.
        timeout_s: How long to wait for the writer to appear [s]; LinkError afterwards.
    """

    def __init__(self, name: str, timeout_s: float = 5.0) -> None:
        self._ring = RingReader(name, timeout_s, "pose slot")

    def latest(self) -> tuple[float, Pose] | None:
        """Stamp [s] and the newest true pose; None before the first."""
        found = self._ring.read_newest()
        if found is None:
            return None
        stamp_s, *values = _POSE.unpack(found[1])
        return stamp_s, Pose(np.array(values[:3]), np.array(values[3:]))

    def close(self) -> None:
        """Let go of the slot; it stays for its writer and other readers."""
        self._ring.close()
