"""TIMESYNC, both ways: the autopilot learns our clock, we learn how long the way to it takes. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field

from labr_autonomy.air.setpoints import Fields
from labr_autonomy.air.telemetry import Message

PING_LOST_S = 2.0  # an answer later than this is none


@dataclass
class TimeSync:
    """Questions of the autopilot, and ours under way."""

    _asked_s: dict[int, float] = field(default_factory=dict)  # by the stamp [ns] in the question

    def ask(self, now_s: float) -> Fields:
        """A question of ours."""
        self._asked_s = {k: t for k, t in self._asked_s.items() if now_s - t < PING_LOST_S}
        stamp_ns = int(now_s * 1e9)
        self._asked_s[stamp_ns] = now_s
        return {"tc1": 0, "ts1": stamp_ns}

    def answer(self, message: Message, now_s: float) -> Fields | None:
        """The answer to a question of the autopilot's; None to what is no question.

        By it the autopilot reads the stamps of our poses, so it is our monotonic clock. MAVSDK could answer
        too, but with the wall clock, which may jump in flight.
        """
        if message.fields["tc1"] != 0:
            return None
        middle_s = 0.5 * (message.arrival_s + now_s)  # the hand-over must not look like an offset
        return {"tc1": int(middle_s * 1e9), "ts1": message.fields["ts1"]}

    def round_trip_s(self, message: Message) -> float | None:
        """How long our question took until this answer [s]; None when it answers nobody or MAVSDK."""
        if message.fields["tc1"] == 0:
            return None
        left_s = self._asked_s.pop(int(message.fields["ts1"]), None)
        return None if left_s is None else message.arrival_s - left_s
