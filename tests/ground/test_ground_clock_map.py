from __future__ import annotations

import random

import pytest

from labr_autonomy.ground.clock_map import WRAP_MS, ClockMap


@pytest.mark.parametrize("ppm", [-40.0, 0.0, 40.0])
@pytest.mark.parametrize("start_ms", [0, WRAP_MS - 30_000])
def test_stamps_are_right_within_two_milliseconds_whatever_the_jitter(ppm, start_ms):
    rng = random.Random(1)
    clock_map, worst = ClockMap(), 0.0
    for k in range(3000):  # a minute at 50 Hz
        true_s = 500.0 + 0.02 * k
        counter = int(start_ms + 1000.0 * (true_s - 500.0) * (1.0 + ppm * 1e-6)) % WRAP_MS
        late = 0.0003 + (rng.expovariate(200.0) if rng.random() < 0.7 else 0.0)
        stamp = clock_map.add(counter, true_s + late)
        if k > 50:
            worst = max(worst, abs(stamp - true_s))
    assert worst < 0.002


def test_estimate_of_the_controllers_clock_is_never_ahead_of_it():
    """A deadline counted from it is therefore never later than meant."""
    rng = random.Random(2)
    clock_map = ClockMap()
    for k in range(1000):
        true_s = 10.0 + 0.02 * k
        clock_map.add(int(1000.0 * true_s), true_s + rng.uniform(0.0, 0.03))
        assert clock_map.controller_ms(true_s + 0.005) <= 1000.0 * (true_s + 0.005) + 1.0


def test_a_stall_of_the_reader_does_not_shift_the_stamps():
    clock_map = ClockMap()
    for k in range(100):
        clock_map.add(20 * k, 5.0 + 0.02 * k)
    stamp = clock_map.add(2000, 5.0 + 2.0 + 0.8)  # read 0.8 s late
    assert stamp == pytest.approx(7.0, abs=0.002)


def test_a_clock_that_goes_back_is_a_restart():
    clock_map = ClockMap()
    clock_map.add(50_000, 1.0)
    stamp = clock_map.add(100, 1.02)
    assert clock_map.restarts == 1
    assert stamp == pytest.approx(1.02)
