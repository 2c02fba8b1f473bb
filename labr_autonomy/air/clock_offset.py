"""Maps another device's stamps onto our clock by minimum latency; pure.

Each message gives `arrival - remote stamp` = clock offset + latency. Latency is never negative, so the
smallest difference seen lately is the best guess of the offset. Two windows, each `window_s` long, forget
old minima, so that the crystals' drift (within 100 ppm: 1 ms in 10 s) is followed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

WINDOW_S = 5.0
BACKWARDS_S = 0.5  # a stamp this much older than the newest one is a reboot, not a late datagram
LATE_S = 1.0  # differences larger than the minimum by this much ...
LATE_FOR_S = 1.0  # ... for this long mean that the other clock was set back or stopped


@dataclass(slots=True)
class ClockOffset:
    """Offset of one remote clock."""

    resets: int = 0
    _offset_s: float = math.inf
    _current_s: float = math.inf
    _window_end_s: float = -math.inf
    _newest_s: float = -math.inf
    _late_since_s: float = math.inf

    @property
    def offset_s(self) -> float | None:
        """Ours minus theirs [s], None before the first message."""
        return self._offset_s if math.isfinite(self._offset_s) else None

    def local_s(self, remote_s: float, arrival_s: float) -> float | None:
        """Stamp of a message on our clock [s], not later than its arrival, never falling.

        Args:
            remote_s: The message's stamp on the sender's clock [s].
            arrival_s: When it arrived, our clock [s].

        Returns:
            None when the message repeats or overtakes: it is not newer than one before.
        """
        difference = arrival_s - remote_s
        if remote_s < self._newest_s - BACKWARDS_S or self._is_set_back(difference, arrival_s):
            self._restart()
        if remote_s <= self._newest_s:
            return None
        self._newest_s = remote_s
        if arrival_s >= self._window_end_s:
            if math.isfinite(self._current_s):
                self._offset_s = self._current_s
            self._current_s = difference
            self._window_end_s = arrival_s + WINDOW_S
        self._current_s = min(self._current_s, difference)
        self._offset_s = min(self._offset_s, self._current_s)
        return remote_s + self._offset_s

    def _is_set_back(self, difference_s: float, arrival_s: float) -> bool:
        if difference_s <= self._offset_s + LATE_S:
            self._late_since_s = math.inf
            return False
        self._late_since_s = min(self._late_since_s, arrival_s)
        return arrival_s - self._late_since_s >= LATE_FOR_S

    def _restart(self) -> None:
        self.resets += 1
        self._offset_s = self._current_s = self._late_since_s = math.inf
        self._window_end_s = self._newest_s = -math.inf
