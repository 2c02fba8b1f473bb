"""Every row of the failsafe table fires, clears, and yields to the more severe one."""

import math
from dataclasses import replace

import pytest

from labr_autonomy.guard.failsafe import TABLE, Health, Reaction, State, step
from labr_autonomy.types import Mode

FINE = Health(Mode.LAND, 0.05, 0.05, 0.02, 0.5, 0.1, 0, False, "", 0.9, 0.15)
BREAK = {
    "vio-late": {"vio_age_s": 0.5},
    "vio-lost": {"vio_age_s": math.inf},
    "vio-disagrees": {"vio_rejected": 16},
    "depth-late": {"depth_age_s": 0.6},
    "depth-untrusted": {"depth_fault": "depth images show 4.00 m everywhere"},
    "plan-late": {"plan_age_s": 2.0},
    "ground-late": {"ground_age_s": 0.4},
    "air-late": {"air_age_s": 3.0},
    "estop": {"estop": True},
    "wheel-fault": {"wheel_fault": "wheel stalled; resting 2 s before try 2 of 3"},
    "battery": {"battery_left": 0.1},
    "taken-over": {"taken_over": "somebody else took over: the autopilot is in land"},
}


@pytest.mark.parametrize("row", TABLE, ids=lambda r: r.code)
@pytest.mark.parametrize("mode", Mode)
def test_a_row_fires_when_its_cause_holds_and_only_then(row, mode):
    fine = replace(FINE, mode=mode)
    assert not row.holds(fine)
    broken = replace(fine, **BREAK[row.code])
    assert row.holds(broken)
    expected = row.on_land if mode is Mode.LAND else row.in_air
    state = step(State(), broken, 5.0)
    assert state.reaction >= expected
    if expected is not Reaction.NONE:
        assert state.sentence
    cleared = step(state, fine, 6.0)
    assert cleared.reaction is (state.reaction if state.reaction >= Reaction.LAND else Reaction.NONE)


def test_everything_fine_means_no_reaction():
    assert step(State(), FINE, 1.0) == State()


def test_the_more_severe_reaction_wins_and_the_first_cause_stays():
    flying = replace(FINE, mode=Mode.AIR)
    state = step(State(), replace(flying, depth_age_s=1.0), 1.0)
    assert (state.reaction, state.code) == (Reaction.HOLD, "depth-late")
    state = step(state, replace(flying, depth_age_s=2.0, battery_left=0.1), 2.0)
    assert (state.reaction, state.code, state.since_s) == (Reaction.LAND, "depth-late", 1.0)
    assert "battery" in state.sentence


def test_a_landing_is_not_called_off_when_its_cause_clears():
    flying = replace(FINE, mode=Mode.AIR)
    state = step(State(), replace(flying, battery_left=0.1), 1.0)
    assert step(state, flying, 2.0) == state


def test_sentences_carry_figures():
    state = step(State(), replace(FINE, depth_age_s=0.87), 1.0)
    assert "0.9 s" in state.sentence
