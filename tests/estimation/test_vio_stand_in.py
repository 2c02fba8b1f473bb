from __future__ import annotations

import math

import numpy as np
import pytest

from labr_autonomy.frames import quaternion_from_rpy, yaw_of
from labr_autonomy.types import Pose
from sim.vio import PERIOD_S, VioModel, VioStandIn

STILL = np.zeros(3)
NOISELESS = VioModel(position_sigma_m=0.0, rotation_sigma_rad=0.0, velocity_sigma_mps=0.0)


def straight(stand_in, way_m, speed_mps=0.6, start_s=0.0):
    v = np.array([speed_mps, 0.0, 0.0])
    for k in range(round(way_m / speed_mps / PERIOD_S)):
        stand_in.feed(start_s + k * PERIOD_S, Pose(v * k * PERIOD_S, quaternion_from_rpy(0, 0, 0)), v)
    return stand_in.due(math.inf)


def test_samples_come_late_once_and_in_order():
    vio = VioStandIn(1)
    for k in range(3):
        vio.feed(k * 0.1, Pose(STILL, quaternion_from_rpy(0, 0, 0)), STILL)
    assert vio.due(0.029) == []
    assert [s.stamp_s for s in vio.due(0.131)] == pytest.approx([0.0, 0.1])
    assert [s.stamp_s for s in vio.due(9.0)] == pytest.approx([0.2])
    assert vio.due(9.0) == []


def test_noise_is_as_stated_and_standing_still_does_not_drift():
    vio = VioStandIn(2)
    at = Pose(np.array([3.0, -1.0, 0.12]), quaternion_from_rpy(0, 0, 1.0))
    for k in range(2000):
        vio.feed(k * PERIOD_S, at, STILL)
    samples = vio.due(math.inf)
    p = np.array([s.position_m for s in samples]) - at.position_m
    yaw = np.array([yaw_of(s.quaternion) for s in samples]) - 1.0
    v = np.array([s.velocity_mps for s in samples])
    assert p.std(axis=0) == pytest.approx([0.005] * 3, rel=0.1)
    assert yaw.std() == pytest.approx(math.radians(0.1), rel=0.1)
    assert v.std(axis=0) == pytest.approx([0.02] * 3, rel=0.1)
    assert np.abs(p.sum(axis=0) / 2000).max() < 5e-4
    assert vio.yaw_error_rad == 0.0


def test_drift_grows_with_the_way_by_about_half_a_percent():
    ends, yaws = [], []
    for seed in range(40):
        vio = VioStandIn(seed, NOISELESS)
        last = straight(vio, 10.0)[-1]
        true = np.array([0.6, 0, 0]) * last.stamp_s
        ends.append(np.linalg.norm(last.position_m - true))
        yaws.append(math.degrees(vio.yaw_error_rad))
    assert 0.015 < np.sqrt(np.square(ends).sum() / 40) < 0.08
    assert 0.1 < np.sqrt(np.square(yaws).sum() / 40) < 0.6


def test_velocity_agrees_with_the_drifting_position():
    samples = straight(VioStandIn(3, NOISELESS), 6.0)
    p = np.array([s.position_m for s in samples])
    v = np.array([s.velocity_mps for s in samples])
    assert np.allclose(np.diff(p, axis=0) / PERIOD_S, v[1:], atol=1e-9)


def test_the_seed_decides_everything():
    a, b, c = (straight(VioStandIn(seed), 1.0)[-1].position_m for seed in (5, 5, 6))
    assert (a == b).all()
    assert (a != c).any()
