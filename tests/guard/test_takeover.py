"""Who flies, in every state x every input."""

import itertools
from dataclasses import replace

import pytest

from labr_autonomy.air.families import FAMILIES
from labr_autonomy.guard.takeover import FOLLOWING, RESUME_S, SURE_S, Inputs, State, step

MODES = ("offboard", "guided", "land", "hold", "position", "return", "unknown")
STATES = (State(), State(100.0 - RESUME_S - 0.1), State(99.9))
ARMING_STATES = [
    State(found=found, followed=followed, other_since_s=since_s)
    for found, followed, since_s in itertools.product(
        ("", "hold", "position", "offboard"), (False, True), (None, 99.9, 99.0)
    )
]
EVERY_INPUT = [
    Inputs(f, m, i, c, asked, restarted, resumes)
    for f, m, i, c, asked, restarted, resumes in itertools.product(
        (False, True), MODES, ("", "offboard", "guided", "land", "position"), *([(False, True)] * 4)
    )
]


def look(**changes):
    base = {"flying": True, "mode": "offboard", "intended": "offboard", "critical": False}
    return Inputs(**({**base, "landing_asked": False, "restarted": False} | changes))


@pytest.mark.parametrize("state", STATES)
def test_we_go_on_only_where_the_autopilot_follows_or_may_come_back(state):
    for i in EVERY_INPUT:
        after, sentence = step(state, i, 100.0)
        if not i.flying:
            assert (after, sentence) == (State(), "")
        elif i.restarted:
            assert "restarted" in sentence
        elif i.mode in FOLLOWING:
            assert (after, sentence) == (State(), "")
        elif i.mode == "unknown":
            assert (after, sentence) == (state, "")
        elif i.landing_asked and i.mode == "land":
            assert sentence == ""
        elif (
            not i.resumes
            or i.intended in ("land", "position")
            or (not i.intended and (i.mode == "position" or not i.critical))
        ):
            assert i.mode in sentence
            assert "somebody else" in sentence
        else:
            long = state.failsafe_since_s is not None and 100.0 - state.failsafe_since_s > RESUME_S
            assert bool(sentence) is long


@pytest.mark.parametrize("state", ARMING_STATES)
def test_while_arming_only_a_mode_that_somebody_chose_is_yielded_to(state):
    for i in (replace(i, flying=False, arming=True) for i in EVERY_INPUT):
        after, sentence = step(state, i, 100.0)
        asked = i.intended or i.mode
        own = not i.intended and i.critical and i.mode in ("land", "return", "hold")
        if i.restarted:
            assert sentence == "the autopilot restarted while arming"
        elif i.mode == "unknown":
            assert (after, sentence) == (state, "")
        elif asked in FOLLOWING or own:
            assert sentence == ""
            assert not after.in_doubt
            assert after.followed is (state.followed or asked in FOLLOWING)
        elif asked == (state.found or asked) and not state.followed:
            assert (after, sentence) == (State(found=state.found or asked), "")
        else:
            assert after.in_doubt
            assert after.followed is state.followed
            assert ("somebody else took over" in sentence) is (state.other_since_s == 99.0)


def test_an_ordinary_arming_finds_a_mode_and_leaves_it_for_ours():
    state, told = State(), set()
    for k, (mode, intended) in enumerate([("hold", "hold")] * 9 + [("offboard", "offboard")] * 9):
        state, sentence = step(state, look(flying=False, arming=True, mode=mode, intended=intended), k * 0.1)
        told.add((sentence, state.in_doubt))
    assert told == {("", False)}


@pytest.mark.parametrize("followed", [False, True])
def test_another_mode_while_arming_is_believed_when_it_lasts_and_not_after_one_late_message(followed):
    state = State(found="hold", followed=followed)
    other = look(flying=False, arming=True, mode="position", intended="position")
    state, sentence = step(state, other, 10.0)
    assert state.in_doubt
    assert sentence == ""
    after, _ = step(state, look(flying=False, arming=True), 10.05)
    assert not after.in_doubt
    _, sentence = step(state, other, 10.0 + SURE_S)
    assert "in position" in sentence


def test_the_mode_found_at_the_start_is_somebodys_choice_once_it_has_followed():
    state, _ = step(State(), look(flying=False, arming=True, mode="hold", intended="hold"), 10.0)
    state, _ = step(state, look(flying=False, arming=True), 10.1)
    state, _ = step(state, look(flying=False, arming=True, mode="hold", intended="hold"), 10.2)
    assert state.in_doubt


def test_lost_set_points_are_told_from_a_takeover_before_the_heartbeat_says_critical():
    state, sentence = step(State(), look(mode="land"), 10.0)
    assert sentence == ""
    assert step(state, look(), 10.1) == (State(), "")
    _, sentence = step(State(), look(mode="land", intended="land"), 10.0)
    assert "in land" in sentence


def test_a_pilot_who_takes_over_during_a_failsafe_gets_it_at_once():
    state, sentence = step(State(), look(mode="land", critical=True), 10.0)
    assert sentence == ""
    _, sentence = step(state, look(mode="position", intended="position", critical=True), 10.02)
    assert "position" in sentence


def test_an_autopilot_that_never_comes_back_is_not_waited_for():
    _, sentence = step(State(), look(mode="land", intended="", critical=True, resumes=False), 10.0)
    assert "in land" in sentence


def test_a_silent_link_does_not_stop_the_clock_of_a_failsafe():
    state, _ = step(State(), look(mode="land", critical=True), 10.0)
    state, _ = step(state, look(mode="unknown"), 11.0)
    _, sentence = step(state, look(mode="land", critical=True), 10.1 + RESUME_S)
    assert "failsafe went to land" in sentence


@pytest.mark.parametrize("family", FAMILIES.values(), ids=lambda family: family.name)
def test_a_mode_that_no_table_has_is_a_takeover_as_well(family):
    for custom_mode in (0x0B040000, 0x00630000, 99):  # PX4: a mode of the pilot's own, numbers of no release
        _, sentence = step(State(), look(mode=family.mode_name(custom_mode), intended=""), 10.0)
        assert "somebody else took over" in sentence
