"""What the autopilot says in words: STATUSTEXT, and PX4's events where a companion gets no texts. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field

from labr_autonomy.air.events import SUMMARY, Event, event_of
from labr_autonomy.air.telemetry import Message

WARNING = 4  # MAV_SEVERITY_WARNING, events::Log::Warning
KEEP_S = 3.0  # words this young belong to a refusal


@dataclass
class Report:
    """The latest words and the arming checks that fail."""

    _said: list[tuple[float, str]] = field(default_factory=list)
    _failing: list[Event] = field(default_factory=list)

    def take(self, name: str, message: Message) -> str:
        """Take a STATUSTEXT or EVENT; returns the sentence when an operator should read it, else ""."""
        if name == "EVENT":
            return self._take_event(event_of(message.fields), message.arrival_s)
        text = str(message.fields["text"]).strip()
        if int(message.fields["severity"]) > WARNING or not text:
            return ""
        return self._say(text, message.arrival_s)

    def _take_event(self, event: Event, now_s: float) -> str:
        if event.number == SUMMARY:
            self._failing.clear()
        if event.hinders_offboard:
            self._failing.append(event)
            return ""  # of use only with a refusal: on the ground something always fails
        if event.level > WARNING or event.name.startswith("check_"):
            return ""
        return self._say(event.text, now_s)

    def _say(self, text: str, now_s: float) -> str:
        self._said = [(t, s) for t, s in self._said if now_s - t < KEEP_S and s != text]
        self._said.append((now_s, text))
        return text

    def reason(self, since_s: float) -> str:
        """Why a request of `since_s` was refused, as far as the autopilot has said so."""
        words = [text for stamp_s, text in self._said if stamp_s >= since_s - KEEP_S]
        checks = [event.text for event in self._failing]
        return "; ".join(dict.fromkeys([*words[-2:], *checks]))
