"""What a page asks of the executive. Plain values; the wire is JSON in shared memory."""

from __future__ import annotations

import enum
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeGuard

from labr_autonomy.errors import BadInput

PAGE_MAX = 40  # characters of a page's name
COORDINATE_MAX_M = 10_000.0


class Kind(enum.Enum):
    """What can be asked."""

    TAKE = "take"  # control of the robot, from whoever has it
    RELEASE = "release"
    KEEP = "keep"  # the page that has control was alive at the stamp
    START = "start"
    PAUSE = "pause"
    RESUME = "resume"
    SKIP = "skip"
    RETURN = "return"
    LAND = "land"
    GOTO = "goto"
    ABORT = "abort"


@dataclass(frozen=True, slots=True)
class Request:
    """One request of one page."""

    page: str  # which browser tab asks
    sequence: int  # rises with every request of that page
    kind: Kind
    stamp_s: float  # stamp of the state the operator was looking at, plus the time since; CLOCK_MONOTONIC
    goal_m: tuple[float, float, float | None] | None = None  # odom; z above the floor, None on the floor

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        goal = None if self.goal_m is None else list(self.goal_m)
        return {
            "page": self.page,
            "sequence": self.sequence,
            "kind": self.kind.value,
            "stamp_s": self.stamp_s,
            "goal_m": goal,
        }


def parse(message: Mapping[str, Any]) -> Request:
    """A request from its JSON object.

    Raises:
        BadInput: when a field is missing or is not what it must be.
    """
    page, sequence, stamp_s = message.get("page"), message.get("sequence"), message.get("stamp_s")
    if not isinstance(page, str) or not 0 < len(page) <= PAGE_MAX or not page.isprintable():
        raise BadInput("a request does not name its page")
    if not isinstance(sequence, int) or isinstance(sequence, bool) or not 0 < sequence < 2**53:
        raise BadInput("a request has no sequence number")
    if not finite(stamp_s):
        raise BadInput("a request has no stamp")
    try:
        kind = Kind(message.get("kind"))
    except ValueError:
        raise BadInput(f"nothing is known of a request '{str(message.get('kind'))[:20]}'") from None
    goal = _goal(message.get("goal_m")) if kind is Kind.GOTO else None
    return Request(page, sequence, kind, float(stamp_s), goal)


def _goal(value: object) -> tuple[float, float, float | None]:
    if not isinstance(value, (list, tuple)) or len(value) not in (2, 3):
        raise BadInput("a place to go to needs x and y, and z when it is flown to")
    x, y = value[0], value[1]
    z = value[2] if len(value) == 3 else None
    if not finite(x) or not finite(y) or not (z is None or finite(z)):
        raise BadInput("a place to go to is not made of numbers")
    if max(abs(float(v)) for v in (x, y, z or 0.0)) > COORDINATE_MAX_M:
        raise BadInput(f"a place to go to is more than {COORDINATE_MAX_M:g} m away")
    return float(x), float(y), None if z is None else float(z)


def finite(value: object) -> TypeGuard[int | float]:
    """Whether a value of JSON is a number that a float can hold; JSON's integers have no bounds."""
    return (
        isinstance(value, (int, float))
        and not isinstance(value, bool)
        and -sys.float_info.max <= value <= sys.float_info.max
    )
