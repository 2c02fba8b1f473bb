from __future__ import annotations

import pytest

from labr_autonomy.guard.wheel_faults import REST_S, TRIES, WITHIN_S, State, step

STALL = ("wheel stalled",)


def run(moments):
    """Sentences at (stamp, faults) one after another."""
    state, said = State(), []
    for now_s, faults in moments:
        state, sentence = step(state, faults, now_s)
        said.append(sentence)
    return said


def test_without_faults_nothing_is_said():
    assert run([(k * 0.02, ()) for k in range(50)]) == [""] * 50


def test_a_fault_rests_the_wheels_and_then_they_may_try_again():
    first, cleared, rested = run([(1.0, STALL), (1.1, ()), (1.0 + REST_S, ())])
    assert "wheel stalled" in first
    assert "try 2 of 3" in cleared
    assert rested == ""


def test_a_fault_that_lasts_counts_once():
    said = run([(0.02 * k, STALL) for k in range(round(REST_S / 0.02) + 2)])
    assert said[-1] == ""


@pytest.mark.parametrize("gap_s", [REST_S + 0.5, WITHIN_S / TRIES - 1.0])
def test_the_third_within_a_minute_is_for_good(gap_s):
    moments = []
    for k in range(TRIES):
        moments += [(k * gap_s, STALL), (k * gap_s + 0.1, ())]
    said = run([*moments, (1e4, ())])
    assert "look at the wheels" in said[-2]
    assert "look at the wheels" in said[-1]


def test_faults_far_apart_are_chance():
    said = run([m for k in range(6) for m in ((k * WITHIN_S, STALL), (k * WITHIN_S + REST_S + 0.1, ()))])
    assert said[-1] == ""
    assert not any("look at" in s for s in said)
