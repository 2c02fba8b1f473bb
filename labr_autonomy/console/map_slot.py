"""Obstacle cells and the way travelled, for drawing: one slot in shared memory, the newest wins."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.perception.shared_ring import RingReader, RingWriter

CELLS_MAX = 24_000
TRAIL_MAX = 4_000
_HEAD = struct.Struct("=2I")  # cells, points of the trail

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class MapView:
    """What there is to draw."""

    number: int
    cells_m: Floats  # (n, 2) odom
    trail_m: Floats  # (k, 4) odom x, y, z, and 1 where it was flown


class MapWriter:
    """Publishes the map.

    Args:
        name: Name of the slot.
    """

    def __init__(self, name: str) -> None:
        self._ring = RingWriter(name, b"", _HEAD.size + 4 * (2 * CELLS_MAX + 4 * TRAIL_MAX), slots=2)

    def write(self, cells_m: Floats, trail_m: Floats) -> None:
        """Publish; more than fits is thinned out evenly."""
        cells = np.ascontiguousarray(_thinned(cells_m, CELLS_MAX), np.float32)
        trail = np.ascontiguousarray(_thinned(trail_m, TRAIL_MAX), np.float32)
        head = _HEAD.pack(len(cells), len(trail))
        self._ring.write(head, cells.tobytes(), trail.tobytes())

    def close(self) -> None:
        """Remove the slot."""
        self._ring.close()


class MapReader:
    """Looks at the map.

    Args:
        name: Name given to the writer.
    """

    def __init__(self, name: str) -> None:
        self._ring = RingReader(name, 0.0, "map", own=True)

    def newer(self, than: int) -> MapView | None:
        """The newest map, unless it is the one numbered `than`."""
        number = self._ring.newest()
        if number is None or number == than:
            return None
        found = self._ring.read_newest()
        if found is None:
            return None
        payload = found[1]
        cells, trail = _HEAD.unpack_from(payload)
        at = _HEAD.size
        cells_m = np.frombuffer(payload, np.float32, 2 * cells, at).reshape(-1, 2)
        trail_m = np.frombuffer(payload, np.float32, 4 * trail, at + 8 * cells).reshape(-1, 4)
        return MapView(found[0], cells_m, trail_m)

    def close(self) -> None:
        """Let go of the slot."""
        self._ring.close()


def _thinned(rows: Floats, most: int) -> Floats:
    if len(rows) <= most:
        return rows
    kept: Floats = rows[np.linspace(0, len(rows) - 1, most).astype(int)]
    return kept
