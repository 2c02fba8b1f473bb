"""What a comparison found, for people and for machines."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from labr_autonomy.record.codec import pack


@dataclass(frozen=True, slots=True)
class Difference:
    """One field that came out differently."""

    part: str  # "planner" or "pilot"
    where: str  # which cycle or tick
    path: str  # of the field
    recorded: Any
    now: Any

    @property
    def sentence(self) -> str:
        """As a sentence."""
        return f"{self.part}, {self.where}: {self.path} was {_short(self.recorded)}, is {_short(self.now)}"


@dataclass(frozen=True, slots=True)
class Verdict:
    """The whole comparison."""

    plans: int
    ticks: int
    differences: list[Difference] = field(default_factory=list)
    complete: bool = True  # every difference was looked for

    @property
    def first(self) -> Difference | None:
        """The earliest difference of the planner, or else of the pilot."""
        return self.differences[0] if self.differences else None

    @property
    def sentence(self) -> str:
        """The finding."""
        compared = f"{self.plans} plans and {self.ticks} ticks compared field by field"
        if self.first is None:
            return f"{compared}: no difference"
        more = "" if self.complete else " or more"
        return f"{compared}: {len(self.differences)}{more} differences\nfirst: {self.first.sentence}"

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "plans": self.plans,
            "ticks": self.ticks,
            "complete": self.complete,
            "differences": [
                {
                    "part": d.part,
                    "where": d.where,
                    "field": d.path,
                    "recorded": _json_ready(d.recorded),
                    "now": _json_ready(d.now),
                }
                for d in self.differences
            ],
        }


def _json_ready(value: Any) -> Any:
    """An element of an array may be what JSON has no figure for."""
    return pack(value) if isinstance(value, float) else value


def _short(value: Any) -> str:
    text = "nothing" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
