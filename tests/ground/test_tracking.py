"""The tracking law brings a unicycle onto its trajectory."""

import math

import numpy as np
import pytest

from labr_autonomy.ground.tracking import follow
from labr_autonomy.types import Mode, SetPoint


def reference(t, v=0.6, w=0.4):
    yaw = w * t
    x, y = v / w * math.sin(yaw), v / w * (1 - math.cos(yaw))
    zero = np.zeros(3)
    return SetPoint(t, Mode.LAND, np.array([x, y, 0.0]), zero, zero, yaw, w, v)


@pytest.mark.parametrize("start", [(0.0, 0.2, 0.0), (-0.3, 0.0, 0.3), (0.1, -0.2, -0.4)])
def test_an_offset_on_an_arc_is_worked_off(start):
    x, y, yaw = start
    dt = 0.02
    for k in range(400):
        out = follow(reference(k * dt), x, y, yaw)
        x += out.speed_mps * math.cos(yaw) * dt
        y += out.speed_mps * math.sin(yaw) * dt
        yaw += out.yaw_rate_rps * dt
    assert out.error_m < 0.03


def test_on_the_spot_it_turns_to_the_reference_heading():
    zero = np.zeros(3)
    yaw = 2.0
    for _ in range(300):
        out = follow(SetPoint(0.0, Mode.LAND, zero, zero, zero, 0.5, 0.0, 0.0), 0.0, 0.0, yaw)
        yaw += out.yaw_rate_rps * 0.02
    assert yaw == pytest.approx(0.5, abs=0.02)
    assert abs(out.speed_mps) < 1e-6


def test_on_the_reference_it_only_feeds_forward():
    out = follow(reference(1.0), *reference(1.0).position_m[:2], reference(1.0).yaw_rad)
    assert out.speed_mps == pytest.approx(0.6)
    assert out.yaw_rate_rps == pytest.approx(0.4)
