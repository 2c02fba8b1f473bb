"""Nothing stale, broken, fast or out of bounds passes."""

import math
from dataclasses import replace

import numpy as np
import pytest

from labr_autonomy.config import RobotConfig
from labr_autonomy.guard.fence import Zone
from labr_autonomy.guard.setpoint import AGE_MAX_S, SPEED_SLACK, check_setpoint
from labr_autonomy.types import Mode, SetPoint

CONFIG = RobotConfig()
FENCE = [Zone(((-5.0, -5.0), (5.0, -5.0), (5.0, 5.0), (-5.0, 5.0)), keep_in=True)]


def setpoint(mode=Mode.AIR, **changes):
    base = SetPoint(10.0, mode, np.array([1.0, 1.0, 1.0]), np.zeros(3), np.zeros(3), 0.0, 0.0, 0.0)
    return replace(base, **changes)


def check(sp, now_s=10.0):
    return check_setpoint(sp, CONFIG, FENCE, 0.0, now_s)


def test_a_good_one_passes_unchanged():
    assert check(setpoint()).setpoint is not None


@pytest.mark.parametrize("late_s", [AGE_MAX_S + 0.001, 1.0, 100.0])
def test_a_stale_one_is_refused_with_its_age(late_s):
    verdict = check(setpoint(), 10.0 + late_s)
    assert verdict.setpoint is None
    assert "ms old" in verdict.reason


@pytest.mark.parametrize("field", ["position_m", "velocity_mps", "acceleration_mps2"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_broken_one_is_refused(field, value):
    assert check(setpoint(**{field: np.array([0.0, value, 0.0])})).setpoint is None
    assert check(setpoint(yaw_rad=value)).setpoint is None


def test_outside_the_fence_is_refused_with_the_distance():
    verdict = check(setpoint(position_m=np.array([6.0, 0.0, 1.0])))
    assert verdict.setpoint is None
    assert "1.00 m outside" in verdict.reason


def test_too_high_is_refused():
    assert check(setpoint(position_m=np.array([0.0, 0.0, CONFIG.air.height_max_m + 0.4]))).setpoint is None


def test_speeds_are_limited_and_keep_their_direction():
    out = check(setpoint(velocity_mps=np.array([10.0, 5.0, 0.0]))).setpoint
    assert np.abs(out.velocity_mps).max() <= CONFIG.air.speed_mps * SPEED_SLACK + 1e-9
    assert out.velocity_mps[0] == pytest.approx(2 * out.velocity_mps[1])
    out = check(setpoint(Mode.LAND, speed_mps=5.0, yaw_rate_rps=-9.0)).setpoint
    assert out.speed_mps == pytest.approx(CONFIG.land.speed_mps * SPEED_SLACK)
    assert out.yaw_rate_rps == -CONFIG.land.yaw_rate_rps
    assert check(setpoint(Mode.LAND, speed_mps=-5.0)).setpoint.speed_mps == pytest.approx(
        -CONFIG.land.reverse_mps * SPEED_SLACK
    )
