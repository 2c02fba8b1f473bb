"""The JSBSim quad: power, contact, axes, resets."""

import math
import time

import numpy as np
import pytest

from labr_autonomy.frames import quaternion_from_rpy, roll_pitch_of, yaw_of
from sim.quad import STEP_S, Quad

REST = np.array([0.0, 0.0, 0.12])


def settle(quad, commands, steps):
    for _ in range(steps):
        state = quad.step(np.asarray(commands, dtype=float))
    return state


@pytest.fixture
def quad():
    q = Quad()
    q.set_volts(19.0)
    return q


@pytest.mark.slow
def test_it_stands_where_it_was_put_for_minutes(quad):
    quad.reset(np.array([3.0, -2.0, 0.12]), 0.7)
    first = settle(quad, np.zeros(4), 10)
    last = settle(quad, np.zeros(4), 120 * 250)
    assert last.position_m == pytest.approx([3.0, -2.0, 0.12], abs=5e-4)
    assert np.linalg.norm(last.position_m - first.position_m) < 1e-4
    assert yaw_of(last.quaternion) == pytest.approx(0.7, abs=1e-6)
    assert last.specific_force_mps2 == pytest.approx([0.0, 0.0, 9.80665], abs=1e-3)
    assert last.wheel_load_n.sum() == pytest.approx(3.4 * 9.80665, rel=1e-3)
    assert last.on_ground


@pytest.mark.parametrize("speed_mps", [0.2, 0.4, 0.6])
def test_a_touch_down_does_not_bounce(quad, speed_mps):
    quad.reset(np.array([0.0, 0.0, 0.1221 + speed_mps**2 / (2 * 9.80665)]), 0.0)
    heights, touched = [], False
    for _ in range(500):
        state = quad.step(np.zeros(4))
        touched = touched or state.on_ground
        if touched:
            heights.append(state.position_m[2])
    assert max(heights[heights.index(min(heights)) :]) < 0.12 + 0.01
    assert min(heights) > 0.12 - 0.03
    assert heights[-1] == pytest.approx(0.12, abs=1e-3)


def test_a_sideways_touch_down_stops_by_friction(quad):
    quad.reset(np.array([0.0, 0.0, 0.3]), 0.0, quaternion=quaternion_from_rpy(0.05, 0.0, 0.0))
    state = settle(quad, np.zeros(4), 500)
    assert np.linalg.norm(state.velocity_mps) < 1e-3
    assert abs(state.position_m[1]) < 0.1
    assert roll_pitch_of(state.quaternion) == pytest.approx((0.0, 0.0), abs=1e-3)


def test_hovering_takes_what_the_energy_model_says():
    """Find the duty that holds the weight, then look at the power."""
    quad = Quad()
    quad.set_volts(18.5)
    low, high = 0.3, 0.9
    for _ in range(20):
        duty = 0.5 * (low + high)
        quad.reset(np.array([0.0, 0.0, 20.0]), 0.0)
        state = settle(quad, np.full(4, duty), 60)
        low, high = (duty, high) if state.specific_force_mps2[2] < 9.80665 else (low, duty)
    assert 540.0 < state.electrical_w < 640.0
    assert 0.4 < duty < 0.7  # thrust over weight stays above 1.7


@pytest.mark.parametrize(
    ("commands", "axis", "sign"),
    [
        ((0.5, 0.6, 0.6, 0.5), 0, 1),  # left motors up: rolls right
        ((0.5, 0.6, 0.5, 0.6), 1, 1),  # rear motors up: nose down
        ((0.5, 0.5, 0.6, 0.6), 2, 1),  # clockwise propellers up: turns left
    ],
)
def test_motor_order_is_px4s(quad, commands, axis, sign):
    quad.reset(np.array([0.0, 0.0, 5.0]), 0.4)
    rates = settle(quad, commands, 40).angular_velocity_rps
    assert sign * rates[axis] > 0.1
    others = np.delete(np.abs(rates), axis)
    assert others.max() < 0.1 * abs(rates[axis])


def test_world_axes_are_east_north_up(quad):
    quad.reset(np.array([1.0, 2.0, 5.0]), 0.0, quaternion=quaternion_from_rpy(0.0, 0.2, math.pi / 2))
    state = settle(quad, np.full(4, 0.56), 100)  # looks north, nose down
    assert state.position_m[1] > 2.05
    assert state.position_m[0] == pytest.approx(1.0, abs=0.01)
    assert state.velocity_mps[1] > 0.3


def test_a_reset_is_quick_and_repeats_bitwise(quad):
    def run():
        quad.reset(np.array([0.5, 0.5, 1.0]), 0.3)
        return settle(quad, (0.55, 0.56, 0.57, 0.55), 100).position_m

    first = run()
    started = time.perf_counter()
    again = run()
    assert time.perf_counter() - started < 1.0
    assert again == pytest.approx(first, abs=1e-9)


def test_the_floor_can_rise(quad):
    quad.set_floor(0.5)
    quad.reset(np.array([0.0, 0.0, 0.62]), 0.0)
    assert settle(quad, np.zeros(4), 200).position_m[2] == pytest.approx(0.62, abs=1e-3)


def test_wind_pushes_downwind(quad):
    quad.set_wind(np.array([4.0, 0.0, 0.0]))
    quad.reset(np.array([0.0, 0.0, 50.0]), 0.0)
    state = settle(quad, np.full(4, 0.56), 250)
    assert state.velocity_mps[0] > 0.05
    assert abs(state.velocity_mps[1]) < 0.01


def test_less_voltage_gives_less_thrust(quad):
    quad.reset(np.array([0.0, 0.0, 5.0]), 0.0)
    full = settle(quad, np.full(4, 0.6), 50).specific_force_mps2[2]
    quad.set_volts(15.0)
    assert settle(quad, np.full(4, 0.6), 50).specific_force_mps2[2] < 0.75 * full


def test_it_is_quiet(capfd):
    quad = Quad()
    quad.reset(REST, 0.0)
    quad.step(np.zeros(4))
    out, err = capfd.readouterr()
    assert (out, err) == ("", "")


def test_the_step_is_fixed_at_250_hz():
    assert Quad().step_s == STEP_S == 0.004
