"""What an operator may ask at which stage of a mission, as a pure table, and what it means for the order.

A movement is never begun on stale links: start, resume, skip, return and go-to wait until all are fresh.
Pause, land and abort are obeyed whatever the links say.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from types import MappingProxyType

from labr_autonomy.console.requests import Kind
from labr_autonomy.mission.pilot_io import Order

LINK_LATE_S: Mapping[str, float] = MappingProxyType(
    # the guard's own limits for a running mission (guard/failsafe.py), named as operators see the links
    {"vio": 0.3, "depth": 0.5, "air": 2.5, "stm32": 0.3, "plan": 1.5}
)
OTHER_LATE_S = 2.5  # of a link that this table does not know, for showing only


class Stage(enum.Enum):
    """How far the mission is, as the operator sees it."""

    WAITING = "waiting"  # for start
    RUNNING = "running"
    PAUSED = "paused"
    ENDING = "ending"  # coming down, and then it is over


ORDERS: Mapping[Stage, Order] = MappingProxyType(
    {
        Stage.WAITING: Order.HOLD,
        Stage.RUNNING: Order.FLY,
        Stage.PAUSED: Order.HOLD,
        Stage.ENDING: Order.LAND,
    }
)

MOVING = frozenset({Kind.START, Kind.RESUME, Kind.SKIP, Kind.RETURN, Kind.GOTO})
_NOT_BEGUN = "the mission has not begun; press start"
_ENDING = "the mission is coming to its end"
_W, _R, _P, _E = Stage.WAITING, Stage.RUNNING, Stage.PAUSED, Stage.ENDING

TABLE: Mapping[tuple[Stage, Kind], Stage | str] = MappingProxyType(
    {
        (_W, Kind.START): _R,
        (_W, Kind.PAUSE): _NOT_BEGUN,
        (_W, Kind.RESUME): _NOT_BEGUN,
        (_W, Kind.SKIP): _NOT_BEGUN,
        (_W, Kind.RETURN): _NOT_BEGUN,
        (_W, Kind.LAND): _NOT_BEGUN,
        (_W, Kind.GOTO): _NOT_BEGUN,
        (_W, Kind.ABORT): _E,
        (_R, Kind.START): _R,
        (_R, Kind.PAUSE): _P,
        (_R, Kind.RESUME): _R,
        (_R, Kind.SKIP): _R,
        (_R, Kind.RETURN): _R,
        (_R, Kind.LAND): _R,
        (_R, Kind.GOTO): _R,
        (_R, Kind.ABORT): _E,
        (_P, Kind.START): "the mission is paused; press resume",
        (_P, Kind.PAUSE): _P,
        (_P, Kind.RESUME): _R,
        (_P, Kind.SKIP): _P,
        (_P, Kind.RETURN): _R,
        (_P, Kind.LAND): _R,
        (_P, Kind.GOTO): _R,
        (_P, Kind.ABORT): _E,
        (_E, Kind.START): _ENDING,
        (_E, Kind.PAUSE): _ENDING,
        (_E, Kind.RESUME): _ENDING,
        (_E, Kind.SKIP): _ENDING,
        (_E, Kind.RETURN): _ENDING,
        (_E, Kind.LAND): _ENDING,
        (_E, Kind.GOTO): _ENDING,
        (_E, Kind.ABORT): _E,
    }
)


def step(stage: Stage, kind: Kind, ages_s: Mapping[str, float]) -> tuple[Stage, str]:
    """The next stage, and why the request is refused ("" when it is not).

    Args:
        stage: Where the mission stands.
        kind: What is asked; one of those in `TABLE`.
        ages_s: Age of each link's last datum [s].
    """
    following = TABLE[stage, kind]
    if isinstance(following, str):
        return stage, following
    if kind in MOVING and (late := stale(ages_s)):
        return stage, f"locked: {late}"
    return following, ""


def stale(ages_s: Mapping[str, float]) -> str:
    """What is too old to drive on, as words with figures; "" when nothing is."""
    late = [
        f"{name} {age_s:.1f} s old (limit {LINK_LATE_S[name]:g} s)"
        for name, age_s in ages_s.items()
        if name in LINK_LATE_S and not age_s <= LINK_LATE_S[name]
    ]
    return ", ".join(late)
