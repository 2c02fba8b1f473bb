"""The network's path is used while it deserves it, and not taken back too soon."""

from dataclasses import replace

import numpy as np
import pytest

from labr_autonomy.planner.routes import (
    GOOD_CYCLES,
    MU_MAX,
    STAY_S,
    Evidence,
    State,
    choose,
    densify,
    length_m,
    objection,
)
from labr_autonomy.types import Source

GOOD = Evidence(0.1, 0.0, 0.3, 4.0, 2.0, 5.9)


def test_a_good_path_is_followed():
    state, why = choose(State(), GOOD, 1.0)
    assert state.source is Source.GKPN
    assert not why


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"mu": MU_MAX}, "mu 0.50"),
        ({"goal_bearing_rad": -1.5}, "out of view"),
        ({"clearance_m": -0.1}, "obstacle"),
        ({"after_path_m": 9.0}, "detour"),
        ({"after_path_m": np.inf}, "detour"),
    ],
)
def test_each_objection_leads_to_the_map(change, word):
    state, why = choose(State(), replace(GOOD, **change), 1.0)
    assert state.source is Source.SEARCH
    assert word in why


def test_an_unreachable_goal_on_the_map_is_no_objection():
    assert not objection(replace(GOOD, after_path_m=np.inf, shortest_m=np.inf))


def test_the_network_returns_only_after_a_while():
    state, _ = choose(State(), replace(GOOD, mu=0.9), 0.0)
    for k in range(1, GOOD_CYCLES + 5):
        state, _ = choose(state, GOOD, 0.01 * k)
        assert state.source is Source.SEARCH
    state, _ = choose(state, GOOD, STAY_S + 0.1)
    assert state.source is Source.GKPN


def test_one_bad_cycle_restarts_the_count():
    state, _ = choose(State(), replace(GOOD, mu=0.9), 0.0)
    state, _ = choose(state, GOOD, 5.0)
    state, _ = choose(state, replace(GOOD, mu=0.9), 5.1)
    state, _ = choose(state, GOOD, 5.2)
    assert state.good == 1


def test_polyline_helpers():
    line = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    assert length_m(line) == pytest.approx(3.0)
    dense = densify(line, 0.1)
    assert np.linalg.norm(np.diff(dense, axis=0), axis=1).max() <= 0.1 + 1e-9
    assert dense[-1] == pytest.approx(line[-1])
