"""Which requests reach the robot: one page has control, each request counts once, none may be old. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from labr_autonomy.console.requests import Kind, Request

AGE_MAX_S = 0.5  # what the operator saw longer ago than this may no longer be true
ABORT_AGE_MAX_S = 3.0  # an abort that comes late is better than none; after a page slept it is not meant
AHEAD_MAX_S = 0.2  # a stamp further in the future than this is no stamp of ours
LEASE_S = 5.0  # a page that has control and is silent for this long loses it
ANSWERS_MAX = 12
PAGES_MAX = 32

_LEASE = frozenset({Kind.TAKE, Kind.RELEASE, Kind.KEEP})
_ANYBODY = frozenset({Kind.TAKE, Kind.ABORT})  # who sees the robot may stop it


@dataclass(frozen=True, slots=True)
class Answer:
    """What became of a request."""

    page: str
    sequence: int
    kind: Kind
    verdict: str  # "accepted", "refused", or "asked" while the planner looks for a way
    reason: str  # why it was refused


@dataclass(frozen=True, slots=True)
class State:
    """Who has control, and what was answered."""

    holder: str = ""  # page, "" for nobody
    alive_s: float = 0.0  # when the holder was last heard
    last: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))  # sequence by page
    answers: tuple[Answer, ...] = ()


@dataclass(frozen=True, slots=True)
class Outcome:
    """What follows from a request."""

    act: Request | None = None  # to be carried out, and then settled
    say: str = ""  # worth an event


def admit(state: State, request: Request, now_s: float) -> tuple[State, Outcome]:
    """Look at one request."""
    kind, holds = request.kind, state.holder == request.page
    if kind is Kind.KEEP:  # says nothing, so it has no number of its own and is not answered either
        heard_s = max(state.alive_s, min(request.stamp_s, now_s))
        return (replace(state, alive_s=heard_s) if holds else state), Outcome()
    if request.sequence <= state.last.get(request.page, 0):
        return state, Outcome()  # it was answered before: sent twice, or a double click
    state = replace(state, last=_noted(state.last, request))
    age_s = now_s - request.stamp_s
    limit_s = ABORT_AGE_MAX_S if kind is Kind.ABORT else AGE_MAX_S
    if age_s > limit_s:
        why = f"it was {age_s:.1f} s old when it arrived (limit {limit_s:g} s); look again and repeat it"
        return settle(state, request, why), Outcome()
    if age_s < -AHEAD_MAX_S:
        why = f"it is dated {-age_s:.1f} s ahead of the robot's clock"
        return settle(state, request, why), Outcome()
    if kind not in _ANYBODY and not holds:
        who = f"page {state.holder} has control" if state.holder else "nobody has control"
        return settle(state, request, f"{who}; take control first"), Outcome()
    if kind not in _LEASE:
        return (replace(state, alive_s=now_s) if holds else state), Outcome(act=request)
    if kind is Kind.RELEASE:
        return settle(replace(state, holder=""), request), Outcome(
            say=f"page {request.page} gave control back"
        )
    before = state.holder
    state = replace(state, holder=request.page, alive_s=now_s)
    if before == request.page:
        return settle(state, request), Outcome()
    from_whom = f" from page {before}" if before else ""
    return settle(state, request), Outcome(say=f"page {request.page} took control{from_whom}")


def settle(state: State, request: Request, refusal: str = "", *, asked: bool = False) -> State:
    """Put the answer on record.

    Args:
        state: Before.
        request: What was asked.
        refusal: Why not, as a sentence; "" when it is done.
        asked: There is no answer yet.
    """
    verdict = "refused" if refusal else "asked" if asked else "accepted"
    answer = Answer(request.page, request.sequence, request.kind, verdict, refusal)
    kept = tuple(a for a in state.answers if (a.page, a.sequence) != (answer.page, answer.sequence))
    return replace(state, answers=(*kept, answer)[-ANSWERS_MAX:])


def expire(state: State, now_s: float) -> tuple[State, str]:
    """Take control from a page that has fallen silent; with the sentence that says so."""
    if not state.holder or now_s - state.alive_s <= LEASE_S:
        return state, ""
    silent_s = now_s - state.alive_s
    return replace(state, holder=""), f"page {state.holder} was silent for {silent_s:.1f} s and lost control"


def _noted(last: Mapping[str, int], request: Request) -> Mapping[str, int]:
    """The sequence numbers with this one; the page that asked longest ago is forgotten first."""
    kept = {page: number for page, number in last.items() if page != request.page}
    while len(kept) >= PAGES_MAX:
        del kept[next(iter(kept))]
    return MappingProxyType({**kept, request.page: request.sequence})
