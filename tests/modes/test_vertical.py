"""Vertical moves: right end, right speed, at rest."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labr_autonomy.modes.vertical import ACCELERATION_MPS2, CLEAR_M, vertical


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(0.1, 1.5))
def test_it_ends_where_asked_at_rest_and_never_faster(z0, z1, speed):
    t = vertical(np.array([1.0, 2.0, z0]), 0.3, z1, speed, 10.0)
    assert t.position_m[-1] == pytest.approx([1.0, 2.0, z1], abs=1e-6)
    assert t.velocity_mps[-1] == pytest.approx([0, 0, 0], abs=1e-6)
    assert np.abs(t.velocity_mps[:, 2]).max() <= speed + 1e-9
    assert np.abs(np.diff(t.velocity_mps[:, 2])).max(initial=0.0) <= ACCELERATION_MPS2 * 0.0501
    assert (np.diff(t.position_m[:, 2]) * (1 if z1 >= z0 else -1) >= -1e-9).all()


def test_speed_is_the_derivative_of_the_height():
    t = vertical(np.zeros(3), 0.0, 2.0, 0.6, 0.0)
    moved = np.diff(t.position_m[:-1, 2]) / t.step_s
    assert moved == pytest.approx(0.5 * (t.velocity_mps[1:-1, 2] + t.velocity_mps[:-2, 2]), abs=0.02)


@pytest.mark.parametrize("turn_rad", [-2.5, 0.4, 3.1])
def test_a_climb_turns_once_it_is_clear_of_the_floor(turn_rad):
    t = vertical(np.zeros(3), 0.5, 1.5, 0.8, 0.0, (turn_rad, 1.2))
    low = t.position_m[:, 2] < CLEAR_M - 0.02
    assert t.yaw_rad[low] == pytest.approx(0.5)
    assert t.yaw_rad[-1] == pytest.approx(0.5 + turn_rad)
    assert (t.yaw_rate_rps[-1], t.position_m[-1, 2]) == pytest.approx((0.0, 1.5), abs=1e-6)
    assert np.abs(t.yaw_rate_rps).max() <= 1.2 + 1e-9
    turned = np.diff(t.yaw_rad[:-1]) / t.step_s
    assert turned == pytest.approx(0.5 * (t.yaw_rate_rps[1:-1] + t.yaw_rate_rps[:-2]), abs=0.06)
