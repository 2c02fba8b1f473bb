"""How much of the way to goals in the air is driven, and where flights to them begin."""

import math

import pytest
from bench_fakes import make_result

from sim.bench import air_goals

HOPS = [(0.0, 0.0, 0.0, 0.1, 0), (1.0, 1.0, 0.0, 0.5, 1), (2.0, 2.0, 0.0, 0.1, 0), (3.0, 6.0, 3.0, 0.1, 1)]
GOAL = (9.0, 7.0, 1.5)


def test_the_last_flight_counts_and_only_its_distance_on_the_level():
    assert air_goals.take_off_m(make_result(track=HOPS), GOAL) == pytest.approx(5.0)
    assert math.isnan(air_goals.take_off_m(make_result(track=HOPS[:1]), GOAL))
    assert math.isnan(air_goals.take_off_m(make_result(track=[]), GOAL))
    assert air_goals.take_off_m(make_result(track=[(0.0, 9.0, 5.0, 0.9, 1)]), GOAL) == pytest.approx(2.0)


def test_shares_are_of_metres_and_a_robot_that_stood_has_none():
    assert air_goals.driven_share(make_result(land_m=9.0, air_m=3.0)) == pytest.approx(0.75)
    assert math.isnan(air_goals.driven_share(make_result(land_m=0.0, air_m=0.0)))


def test_a_row_has_medians_the_farthest_and_the_share_that_is_near():
    near, far = make_result(land_m=8.0, air_m=2.0), make_result(track=HOPS, land_m=6.0, air_m=4.0)
    row = air_goals.figures([near, far], [(4.0, 1.0, 1.5), GOAL])
    assert row["driven_share_air_pct_p50"] == pytest.approx(70.0)
    assert row["take_off_m_p50"] == pytest.approx(2.5)
    assert row["take_off_m_max"] == pytest.approx(5.0)
    assert row["take_off_near_pct"] == pytest.approx(50.0)
    assert air_goals.figures([], [])["driven_share_air_pct_p50"] is None
