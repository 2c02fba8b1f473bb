"""What is tried when the robot on its wheels gets no farther: a pure machine, bounded in tries and time.

    FOLLOW -> LOOK (all round) -> SQUEEZE (through the least tight gap) -> BACK (along the way it came)
           -> LOOK ... -> HOP (over what is in the way) -> GIVE_UP

A gap that the refiner refused is closed for a while, so that the next way is another one. Frame: odom.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field, replace

import numpy as np

from labr_autonomy.frames import wrap_pi
from labr_autonomy.types import Array

MOVED_M = 0.4  # less than this is standing
NO_WAY_S = 1.0  # standing so long without a way on the map
STANDS_S = 4.0  # or so long with one
TURNED_RAD, STILL_S, TURNS_S = (
    0.35,
    2.0,
    10.0,
)  # who still turns towards a way is given longer, but not for ever
LOOKS = 4  # headings of a look all round
LOOKED_RAD = 0.25
LOOK_S = 5.0  # for each heading at most
LOOK_AGAIN_M = 0.6  # nearer than this to the last look, another one shows nothing new
BACK_M, BACK_S = 1.0, 8.0
SQUEEZED_M = 0.8  # so far into a gap the ordinary ways count again
HOP_S = 10.0  # for the take-off to begin
TRIES_MAX = 6
SPENT_MAX_S = 120.0
AWAY_M = 3.0  # so far from where trouble began it is over
CLOSED_S = 45.0
BEFORE_M = 1.5  # who stands this near before a narrow gap stands because of it


class Action(enum.Enum):
    """What the planner does now."""

    FOLLOW = "follow"
    LOOK = "look round"
    SQUEEZE = "squeeze through"
    BACK = "back off"
    HOP = "hop over"
    GIVE_UP = "give up"


@dataclass(frozen=True, slots=True)
class Closed:
    """A gap that was tried in vain."""

    place_m: Array  # (2,)
    until_s: float


@dataclass(frozen=True, slots=True)
class Facts:
    """One look at the robot."""

    place_m: Array  # (2,)
    yaw_rad: float
    way: bool  # the map has an ordinary way to the goal
    tight_way: bool  # or one through gaps that are too tight
    gap_m: Array | None  # (2,) the first such gap on it
    ahead_m: Array | None  # (2,) the first gap on the ordinary way that may prove too narrow
    trail: bool  # there is a way back
    may_hop: bool  # energy and room allow it


@dataclass(frozen=True, slots=True)
class State:
    """Memory of the attempts at one goal."""

    action: Action = Action.FOLLOW
    since_s: float = -math.inf  # of the action
    from_m: Array = field(default_factory=lambda: np.full(2, np.inf))  # where the action began
    anchor_m: Array = field(default_factory=lambda: np.full(2, np.inf))  # the last place that it left
    anchor_s: float = -math.inf
    turned_rad: float | None = None  # the last heading that it left
    turned_s: float = -math.inf
    trouble_m: Array | None = None  # where the trouble began
    trouble_s: float = math.inf
    looked_m: Array | None = None
    first_yaw_rad: float = 0.0
    looks: int = 0
    tries: int = 0
    closed: tuple[Closed, ...] = ()

    @property
    def heading_rad(self) -> float:
        """Where to look now."""
        return wrap_pi(self.first_yaw_rad + (self.looks + 1) * 2.0 * math.pi / LOOKS)


def _gap(a: Array, b: Array | None) -> float:
    return math.inf if b is None else float(np.hypot(*(a - b)))


def step(state: State, facts: Facts, now_s: float) -> State:
    """One cycle; `action` of what comes back is to be done."""
    here = facts.place_m
    if not _gap(here, state.anchor_m) <= MOVED_M:
        state = replace(state, anchor_m=here, anchor_s=now_s)
    if state.turned_rad is None or abs(wrap_pi(facts.yaw_rad - state.turned_rad)) > TURNED_RAD:
        state = replace(state, turned_rad=facts.yaw_rad, turned_s=now_s)
    state = replace(state, closed=tuple(c for c in state.closed if c.until_s > now_s))
    if state.trouble_m is not None and _gap(here, state.trouble_m) > AWAY_M and facts.way:
        state = replace(state, trouble_m=None, trouble_s=math.inf, tries=0, looked_m=None)
    stands_s = now_s - max(state.anchor_s, state.since_s)
    match state.action:
        case Action.FOLLOW:
            turns = facts.way and now_s - state.turned_s < STILL_S and stands_s < TURNS_S
            if turns or stands_s < (STANDS_S if facts.way else NO_WAY_S):
                return state
            return _trouble(state, facts, now_s)
        case Action.LOOK:
            return _looking(state, facts, now_s)
        case Action.SQUEEZE:
            return _squeezing(state, facts, stands_s, now_s)
        case Action.BACK:
            done = _gap(here, state.from_m) >= BACK_M or now_s - state.since_s > BACK_S
            return _next(state, facts, now_s) if done else state
        case Action.HOP:
            return (
                _next(replace(state, tries=state.tries + 1), facts, now_s, hop=False)
                if (now_s - state.since_s > HOP_S)
                else state
            )
        case Action.GIVE_UP:
            return state


def resumed(state: State) -> State:
    """After a flight, a pause or a push by hand it goes on; what was tried counts, a flight as one try."""
    hopped = state.action is Action.HOP
    return replace(
        state,
        action=Action.FOLLOW,
        since_s=-math.inf,
        anchor_m=np.full(2, np.inf),
        turned_rad=None,
        tries=state.tries + hopped,
    )


def _begin(state: State, action: Action, facts: Facts, now_s: float) -> State:
    return replace(state, action=action, since_s=now_s, from_m=facts.place_m)


def _trouble(state: State, facts: Facts, now_s: float) -> State:
    if _gap(facts.place_m, facts.ahead_m) < BEFORE_M:
        assert facts.ahead_m is not None
        state = replace(state, closed=(*state.closed, Closed(facts.ahead_m, now_s + CLOSED_S)))
    if state.trouble_m is None:
        state = replace(state, trouble_m=facts.place_m, trouble_s=now_s)
    else:
        state = replace(state, tries=state.tries + 1)
    return _next(state, facts, now_s)


def _looking(state: State, facts: Facts, now_s: float) -> State:
    there = abs(wrap_pi(state.heading_rad - facts.yaw_rad)) < LOOKED_RAD
    if not there and now_s - state.since_s <= LOOK_S:
        return state
    if state.looks + 1 < LOOKS:
        return replace(state, looks=state.looks + 1, since_s=now_s)
    return _next(replace(state, looked_m=facts.place_m), facts, now_s)


def _squeezing(state: State, facts: Facts, stands_s: float, now_s: float) -> State:
    if facts.way and _gap(facts.place_m, state.from_m) > SQUEEZED_M:
        return _begin(state, Action.FOLLOW, facts, now_s)
    if facts.tight_way and stands_s < STANDS_S:
        return state
    shut = () if facts.gap_m is None else (Closed(facts.gap_m, now_s + CLOSED_S),)
    state = replace(state, closed=state.closed + shut, tries=state.tries + 1)
    if facts.trail and state.tries % 2 == 1:
        return _begin(state, Action.BACK, facts, now_s)
    return _next(state, facts, now_s)


def _next(state: State, facts: Facts, now_s: float, *, hop: bool = True) -> State:
    """The next thing to try."""
    if state.tries >= TRIES_MAX or now_s - state.trouble_s > SPENT_MAX_S:
        return _begin(state, Action.GIVE_UP, facts, now_s)
    if _gap(facts.place_m, state.looked_m) > LOOK_AGAIN_M:
        state = _begin(state, Action.LOOK, facts, now_s)
        return replace(state, first_yaw_rad=facts.yaw_rad, looks=0)
    if facts.way:
        return _begin(state, Action.FOLLOW, facts, now_s)
    if hop and facts.may_hop and state.tries >= TRIES_MAX // 3:
        return _begin(state, Action.HOP, facts, now_s)
    if facts.tight_way:
        return _begin(state, Action.SQUEEZE, facts, now_s)
    if hop and facts.may_hop:
        return _begin(state, Action.HOP, facts, now_s)
    if facts.trail:
        return _begin(replace(state, tries=state.tries + 1), Action.BACK, facts, now_s)
    return _begin(state, Action.GIVE_UP, facts, now_s)
