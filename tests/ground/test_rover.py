from __future__ import annotations

import math

import pytest

from firmware_bridge.parameters import TICKS_PER_M
from labr_autonomy.config import RobotConfig
from sim.rover import BRAKE_MPS2, DRIVE_MPS2, TAU_S, Rover

CONFIG = RobotConfig()
DT = 0.004


def run(rover: Rover, left: float, right: float, duration_s: float, **options):
    for _ in range(round(duration_s / DT)):
        rover.step(DT, left, right, **options)
    return rover.state


def test_small_step_is_first_order():
    rover = Rover(CONFIG, 1)
    state = run(rover, 0.1, 0.1, TAU_S)
    assert state.left_wheel_mps == pytest.approx(0.1 * (1.0 - math.exp(-1.0)), rel=0.02)


def test_acceleration_is_limited():
    rover, before = Rover(CONFIG, 1), 0.0
    for _ in range(100):
        now = rover.step(DT, 1.0, 1.0).left_wheel_mps
        assert now - before <= DRIVE_MPS2 * DT + 1e-12
        before = now


def test_brakes_stop_within_v_over_b_and_hold():
    rover = Rover(CONFIG, 1)
    run(rover, 0.8, 0.8, 1.0)
    state = run(rover, 0.8, 0.8, 0.8 / BRAKE_MPS2 + DT, braked=True)
    assert (state.left_wheel_mps, state.v_mps) == (0.0, 0.0)
    ticks = state.left_ticks
    assert run(rover, 0.8, 0.8, 0.5, braked=True).left_ticks == ticks


def test_the_faster_right_wheel_turns_left():
    state = run(Rover(CONFIG, 2), 0.2, 0.4, 1.0)
    assert state.w_rps == pytest.approx(0.2 / CONFIG.body.track_m, rel=0.1)


def test_encoders_count_the_wheel_and_the_ground_gets_a_few_percent_less():
    rover, way = Rover(CONFIG, 3), 0.0
    for _ in range(5000):
        way += rover.step(DT, 0.5, 0.5).v_mps * DT
    wheel = rover.state.left_ticks / TICKS_PER_M
    assert wheel == pytest.approx(0.5 * 20.0 - 0.5 * 0.08, rel=0.005)
    assert 0.0 < 1.0 - way / wheel < 0.05


def test_slip_comes_in_bursts_and_repeats_with_the_seed():
    def slips(seed):
        rover = Rover(CONFIG, seed)
        run(rover, 0.5, 0.5, 1.0)
        return [1.0 - rover.step(DT, 0.5, 0.5).v_mps / rover.state.left_wheel_mps for _ in range(7000)]

    first = slips(4)
    assert max(first) > 0.045  # one wheel in a burst
    assert sum(s > 0.045 for s in first) < 0.1 * len(first)
    assert first == slips(4)


def test_power_matches_the_table_at_driving_speed_and_rests_at_idle():
    rover = Rover(CONFIG, 1)
    assert rover.step(DT, 0.0, 0.0).watts == CONFIG.energy.idle_w
    assert run(rover, 0.6, 0.6, 2.0).watts == pytest.approx(84.0, abs=0.5)  # paper, Table 3
    assert run(rover, 0.0, 0.0, 0.0 + DT, braked=True).watts == CONFIG.energy.idle_w
    run(rover, 0.0, 0.0, 2.0, braked=True)
    assert rover.step(DT, 0.6, 0.6).watts > CONFIG.energy.idle_w


def test_power_grows_with_speed_and_acceleration():
    slow, fast = (run(Rover(CONFIG, 1), v, v, 2.0).watts for v in (0.3, 0.8))
    assert CONFIG.energy.idle_w < slow < 84.0 < fast
    rover = Rover(CONFIG, 1)
    run(rover, 0.3, 0.3, 2.0)
    assert run(rover, 0.8, 0.8, 2 * DT).watts > slow + 5.0
