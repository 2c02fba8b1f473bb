"""Ticks without drift or bunching; trajectories that end at rest."""

import numpy as np
import pytest

from labr_autonomy.clock import Ticker
from labr_autonomy.types import Mode, Trajectory


class FakeClock:
    """A clock that jumps to whatever is waited for."""

    def __init__(self):
        self.t = 100.0

    def now_s(self):
        return self.t

    async def sleep_until(self, due_s):
        self.t = max(self.t, due_s)


async def test_ticks_do_not_drift_with_work_between_them():
    clock = FakeClock()
    ticker = Ticker(clock, 0.02)
    for _ in range(50):
        await ticker.wait()
        clock.t += 0.005
    assert clock.t == pytest.approx(100.0 + 50 * 0.02 + 0.005)
    assert ticker.missed == 0


async def test_missed_ticks_are_skipped_not_bunched():
    clock = FakeClock()
    ticker = Ticker(clock, 0.02)
    await ticker.wait()
    clock.t += 1.0
    start = clock.t
    await ticker.wait()
    await ticker.wait()
    assert clock.t - start <= 0.04 + 1e-9
    assert ticker.missed >= 48


def straight(k=11):
    x = np.linspace(0.0, 1.0, k)
    zero = np.zeros((k, 3))
    return Trajectory(
        Mode.LAND,
        5.0,
        0.1,
        np.stack([x, 0 * x, 0 * x], 1),
        np.tile([1.0, 0.0, 0.0], (k, 1)),
        zero,
        0 * x,
        0 * x,
        0 * x + 1.0,
    )


def test_sampling_interpolates_and_rests_at_the_end():
    t = straight()
    assert t.sample(4.0).position_m[0] == 0.0
    assert t.sample(5.55).position_m[0] == pytest.approx(0.55)
    end = t.sample(99.0)
    assert end.position_m[0] == 1.0
    assert end.speed_mps == 0.0
    assert not end.velocity_mps.any()


def test_a_single_point_is_a_place_to_rest():
    point = Trajectory(Mode.AIR, 0.0, 0.1, *(np.ones((1, 3)),) * 3, np.ones(1), np.ones(1), np.ones(1))
    assert point.sample(3.0).position_m[0] == 1.0
    assert point.sample(3.0).speed_mps == 0.0
