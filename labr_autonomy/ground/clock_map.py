"""Turn the land controller's time stamps into ours, without asking: the fastest frame tells the offset."""

from __future__ import annotations

WINDOW_S = 5.0  # the two crystals part by 0.1 ms a second at 20 ppm, so an old minimum goes stale
WRAP_MS = 1 << 32


class ClockMap:
    """Offset between the controller's millisecond counter and our monotonic clock.

    A frame is received late, never early, so the smallest difference seen in the last one to two windows is
    the best one (the minimum filter of NTP's clock selection, RFC 5905 section 10). The estimate of the
    controller's present time is therefore never ahead of the truth by more than its rounding to 1 ms.
    """

    def __init__(self) -> None:
        self._unwrapped_ms: int | None = None
        self._minimum_s: float | None = None  # of the running window
        self._previous_s: float | None = None  # of the window before
        self._window_end_s = 0.0
        self.restarts = 0  # times the controller's clock went back

    @property
    def known(self) -> bool:
        """True once a frame was seen."""
        return self._minimum_s is not None

    @property
    def offset_s(self) -> float:
        """Our time minus the controller's [s]."""
        known = [m for m in (self._minimum_s, self._previous_s) if m is not None]
        return min(known) if known else 0.0

    def add(self, time_ms: int, received_s: float) -> float:
        """Take a frame stamped `time_ms` and received at `received_s`; returns its stamp on our clock [s]."""
        if self._unwrapped_ms is None:
            self._unwrapped_ms = time_ms
        else:
            ahead = (time_ms - self._unwrapped_ms + WRAP_MS // 2) % WRAP_MS - WRAP_MS // 2
            if ahead < 0:
                self.reset()
                self.restarts += 1
                ahead = 0
                self._unwrapped_ms = time_ms
            self._unwrapped_ms += ahead
        difference_s = received_s - self._unwrapped_ms * 1e-3
        if self._minimum_s is None:
            self._minimum_s = difference_s
            self._window_end_s = received_s + WINDOW_S
        elif received_s >= self._window_end_s:
            self._previous_s, self._minimum_s = self._minimum_s, difference_s
            self._window_end_s = received_s + WINDOW_S
        else:
            self._minimum_s = min(self._minimum_s, difference_s)
        return min(received_s, self._unwrapped_ms * 1e-3 + self.offset_s)

    def controller_ms(self, now_s: float) -> int:
        """The controller's counter at our `now_s` [ms, wraps at 32 bits]."""
        return int((now_s - self.offset_s) * 1000.0) % WRAP_MS

    def reset(self) -> None:
        """Forget everything, for a controller that was restarted or replaced."""
        self._unwrapped_ms = None
        self._minimum_s = None
        self._previous_s = None
