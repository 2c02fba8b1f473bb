import itertools

import pytest

from labr_autonomy.console.admission import (
    ABORT_AGE_MAX_S,
    AGE_MAX_S,
    ANSWERS_MAX,
    LEASE_S,
    PAGES_MAX,
    State,
    admit,
    expire,
    settle,
)
from labr_autonomy.console.requests import Kind, Request

NOW_S = 100.0
LEASE_KINDS = {Kind.TAKE, Kind.RELEASE, Kind.KEEP}
GOAL = (1.0, 2.0, None)


def ask(kind, page="A", sequence=1, age_s=0.1):
    return Request(page, sequence, kind, NOW_S - age_s, GOAL if kind is Kind.GOTO else None)


def held_by(page):
    return State(holder=page, alive_s=NOW_S) if page else State()


@pytest.mark.parametrize("holder", ["", "A", "B"])
@pytest.mark.parametrize("kind", Kind)
@pytest.mark.parametrize("age_s", [-1.0, 0.0, 0.4, 0.6, 2.0, 4.0])
def test_only_the_page_with_control_acts_and_only_on_what_is_fresh(holder, kind, age_s):
    before = held_by(holder)
    after, outcome = admit(before, ask(kind, age_s=age_s), NOW_S)
    fresh = -0.2 <= age_s <= (ABORT_AGE_MAX_S if kind is Kind.ABORT else AGE_MAX_S)
    allowed = holder == "A" or kind in (Kind.ABORT, Kind.TAKE)
    assert (outcome.act is not None) == (fresh and allowed and kind not in LEASE_KINDS)
    if kind is Kind.KEEP:
        assert after.answers == ()
    elif outcome.act is None:
        (answer,) = after.answers
        assert (answer.verdict == "accepted") == (fresh and allowed)
        assert bool(answer.reason) == (answer.verdict == "refused")
    if kind is Kind.TAKE and fresh:
        assert after.holder == "A"
    elif kind is Kind.RELEASE and fresh and allowed:
        assert after.holder == ""
    else:
        assert after.holder == before.holder


def test_the_same_request_twice_acts_once_and_keeps_its_answer():
    state, first = admit(held_by("A"), ask(Kind.PAUSE), NOW_S)
    state = settle(state, first.act)
    again, second = admit(state, ask(Kind.PAUSE), NOW_S + 0.01)
    assert second.act is None
    assert again == state


def test_an_older_request_that_arrives_late_does_not_act():
    state, _ = admit(held_by("A"), ask(Kind.PAUSE, sequence=7), NOW_S)
    _, outcome = admit(state, ask(Kind.RESUME, sequence=6), NOW_S)
    assert outcome.act is None


def test_an_old_request_is_refused_with_its_figures():
    state, _ = admit(held_by("A"), ask(Kind.RESUME, age_s=0.8), NOW_S)
    assert "0.8 s old" in state.answers[-1].reason
    assert "limit 0.5 s" in state.answers[-1].reason


def test_taking_over_is_said_and_names_both_pages():
    state, outcome = admit(held_by("B"), ask(Kind.TAKE), NOW_S)
    assert state.holder == "A"
    assert outcome.say == "page A took control from page B"
    _, again = admit(state, ask(Kind.TAKE, sequence=2), NOW_S)
    assert again.say == ""


def test_a_silent_page_loses_control_and_a_living_one_keeps_it():
    state, said = expire(held_by("A"), NOW_S + LEASE_S - 0.01)
    assert (state.holder, said) == ("A", "")
    asked, _ = admit(state, ask(Kind.PAUSE, sequence=5), NOW_S)
    kept, _ = admit(asked, Request("A", 5, Kind.KEEP, NOW_S + LEASE_S), NOW_S + LEASE_S)
    assert expire(kept, NOW_S + 2 * LEASE_S - 0.01)[0].holder == "A"
    lost, said = expire(kept, NOW_S + 2 * LEASE_S + 0.1)
    assert lost.holder == ""
    assert "page A was silent for 5.1 s" in said


@pytest.mark.parametrize(("stamp_s", "alive_s"), [(NOW_S - 9.0, NOW_S), (NOW_S + 1.0, NOW_S + 1.0)])
def test_a_sign_of_life_counts_from_when_the_page_was_heard(stamp_s, alive_s):
    kept, _ = admit(held_by("A"), Request("A", 1, Kind.KEEP, stamp_s), NOW_S + 4.0)
    assert kept.alive_s == alive_s
    ahead, _ = admit(held_by("A"), Request("A", 1, Kind.KEEP, NOW_S + 99.0), NOW_S + 4.0)
    assert ahead.alive_s == NOW_S + 4.0


def test_a_page_that_watches_keeps_nobody_alive():
    state, _ = admit(held_by("A"), Request("B", 1, Kind.KEEP, NOW_S + LEASE_S), NOW_S + LEASE_S)
    assert expire(state, NOW_S + LEASE_S + 0.1)[0].holder == ""


def test_an_answer_that_is_pending_is_replaced_by_the_final_one():
    request = ask(Kind.GOTO)
    state = settle(State(), request, asked=True)
    assert [a.verdict for a in state.answers] == ["asked"]
    state = settle(state, request, "no way there")
    assert [(a.verdict, a.reason) for a in state.answers] == [("refused", "no way there")]


def test_memory_stays_bounded():
    state = State()
    for i, page in itertools.product(range(1, 4), range(100)):
        state, _ = admit(state, ask(Kind.PAUSE, page=f"p{page}", sequence=i), NOW_S)
    assert len(state.answers) == ANSWERS_MAX
    assert len(state.last) == PAGES_MAX
