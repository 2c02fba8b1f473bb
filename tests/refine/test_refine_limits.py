"""Limits, rest and clearance of what leaves the refiner, on random problems, from the trajectory alone."""

from __future__ import annotations

import numpy as np
import pytest
from refine_rooms import boxes2, boxes3, random_boxes

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import wrap_pi
from labr_autonomy.refine.values import AirState, LandState
from labr_autonomy.types import Mode, Source

CONFIG = RobotConfig()
TINY = 1e-9


def random_key_points(rng, start, step_m=0.8):
    heading = rng.uniform(-3, 3)
    turns = np.cumsum(rng.normal(0, 0.5, 5)) + heading
    points = start + np.cumsum(step_m * np.stack([np.cos(turns), np.sin(turns)], axis=1), axis=0)
    return points + rng.normal(0, 0.08, points.shape)


def free_start(rng, field, least_m):
    while True:
        p = rng.uniform(1.0, 9.0, field.distance_m.ndim)
        if field.distance_m.ndim == 3:
            p[2] = rng.uniform(0.6, 2.0)
        if field.lookup(p[None])[0] > least_m:
            return p


def check_land(tr, state):
    lim = CONFIG.land
    dt = tr.step_s
    assert np.array_equal(tr.position_m[0], [*state.position_xy, state.height_m])
    assert (tr.yaw_rad[0], tr.speed_mps[0], tr.yaw_rate_rps[0]) == (state.yaw, state.speed, state.yaw_rate)
    assert tr.speed_mps.max() <= max(lim.speed_mps, state.speed) + TINY
    assert tr.speed_mps.min() >= min(-lim.reverse_mps, state.speed) - TINY
    assert np.abs(tr.yaw_rate_rps).max() <= max(lim.yaw_rate_rps, abs(state.yaw_rate)) + TINY
    assert np.abs(np.diff(tr.speed_mps)).max() <= lim.acceleration_mps2 * dt + TINY
    assert np.abs(np.diff(tr.yaw_rate_rps)).max() <= lim.yaw_acceleration_rps2 * dt + 1e-6
    assert tr.speed_mps[-1] == 0.0
    assert tr.yaw_rate_rps[-1] == 0.0
    # the path is what the speeds drive: summed by hand on a hundred sub-steps
    for k in range(len(tr.yaw_rad) - 1):
        t = np.linspace(0, 1, 101)
        v = tr.speed_mps[k] + t * (tr.speed_mps[k + 1] - tr.speed_mps[k])
        w = tr.yaw_rate_rps[k] + t * (tr.yaw_rate_rps[k + 1] - tr.yaw_rate_rps[k])
        yaw = tr.yaw_rad[k] + np.concatenate([[0], np.cumsum((w[1:] + w[:-1]) / 2 * dt / 100)])
        moved = np.array([np.trapezoid(v * np.cos(yaw), t), np.trapezoid(v * np.sin(yaw), t)]) * dt
        # a turn changes its rate inside an interval, so that its yaw is on the chord at the nodes only
        near = 6e-4 if tr.source is Source.TURN else 1e-5
        assert np.allclose(tr.position_m[k + 1, :2] - tr.position_m[k, :2], moved, rtol=0.0, atol=near)


def check_air(tr, state):
    lim, dt, v, a = CONFIG.air, tr.step_s, tr.velocity_mps, tr.acceleration_mps2
    assert np.array_equal(tr.position_m[0], state.position)
    assert np.array_equal(v[0], state.velocity)
    assert np.array_equal(a[0], state.acceleration)
    assert np.hypot(v[:, 0], v[:, 1]).max() <= lim.speed_mps + TINY
    assert v[:, 2].max() <= lim.climb_mps + TINY
    assert v[:, 2].min() >= -lim.descend_mps - TINY
    assert np.hypot(a[:, 0], a[:, 1]).max() <= lim.acceleration_mps2 + TINY
    assert np.abs(a[:, 2]).max() <= lim.acceleration_mps2 + TINY
    assert np.linalg.norm(np.diff(a[:, :2], axis=0), axis=1).max() <= lim.jerk_mps3 * dt + TINY
    assert np.abs(np.diff(a[:, 2])).max() <= lim.jerk_mps3 * dt + TINY
    assert np.abs(tr.yaw_rate_rps).max() <= lim.yaw_rate_rps + TINY
    assert not v[-1].any()
    assert not a[-1].any()
    assert tr.yaw_rate_rps[-1] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_driving_keeps_limits_rest_and_clearance(refiner, seed):
    rng = np.random.default_rng(seed)
    field = boxes2(random_boxes(seed, (0.8, 5), (9.2, 5)))
    solved = 0
    for _ in range(60):
        start = free_start(rng, field, 0.45)
        state = LandState(start, rng.uniform(-3, 3), rng.uniform(-0.2, 0.8), rng.uniform(-1.5, 1.5))
        if rng.random() < 0.5:
            state = LandState(start, state.yaw, 0.0, 0.0)
        result = refiner.land(state, random_key_points(rng, start), field, 7.0, None)
        check_land(result.trajectory, state)
        assert result.trajectory.start_s == 7.0
        solved += result.source is Source.GKPN
        if result.source is Source.BRAKE:
            assert result.stopped
            continue
        dense = np.array([result.trajectory.sample(7.0 + t).position_m[:2] for t in np.arange(0, 4.0, 0.02)])
        least = field.lookup(dense).min()
        assert least >= CONFIG.body.radius_m + CONFIG.clearance.hard_m - 5e-3  # 2 mm of chord between nodes
        assert result.clearance_m == pytest.approx(least - CONFIG.body.radius_m, abs=5e-3)
    assert solved > 10


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_flying_keeps_limits_rest_and_clearance(refiner, seed):
    rng = np.random.default_rng(seed)
    boxes = [
        (x0, y0, 0, x1, y1, rng.choice([0.6, 3.1])) for x0, y0, x1, y1 in random_boxes(seed, (1, 5), (9, 5))
    ]
    field = boxes3(boxes)
    solved = 0
    for _ in range(60):
        start = free_start(rng, field, 0.45)
        points = random_key_points(rng, start[:2])
        points = np.column_stack([points, np.clip(start[2] + np.cumsum(rng.normal(0, 0.2, 5)), 0.5, 2.2)])
        v, a = rng.uniform(-0.5, 0.5, 3), rng.uniform(-0.5, 0.5, 3)
        v[2] *= 0.5
        if rng.random() < 0.5:
            v, a = np.zeros(3), np.zeros(3)
        toward = np.arctan2(*(points[0] - start)[1::-1]) + rng.uniform(-1.2, 1.2)
        state = AirState(start, v, a, toward)
        result = refiner.air(state, points, field, 3.0, None)
        check_air(result.trajectory, state)
        solved += result.source is Source.GKPN
        if result.source is Source.BRAKE:
            assert result.stopped
            continue
        dense = np.array([result.trajectory.sample(3.0 + t).position_m for t in np.arange(0, 4.0, 0.02)])
        assert field.lookup(dense).min() >= refiner.air_hard_m - 8e-3  # chord between nodes: a dt^2 / 8
    assert solved > 15


def test_a_start_beyond_the_limits_comes_down_to_them(refiner):
    state = LandState(np.array([2.0, 5.0]), 0.0, 1.1, 2.0)
    tr = refiner.land(state, np.array([[3.0, 5.0], [7.0, 5.0]]), boxes2([]), 0.0, None).trajectory
    assert tr.source is Source.GKPN
    assert (np.diff(tr.speed_mps[:5]) < 0).all()
    assert tr.speed_mps[8:].max() <= CONFIG.land.speed_mps
    air = AirState(np.array([2.0, 5.0, 1.2]), np.array([1.5, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), 0.0)
    tr = refiner.air(air, np.array([[4.0, 5.0, 1.2], [8.0, 5.0, 1.2]]), boxes3([]), 0.0, None).trajectory
    assert tr.source is Source.GKPN
    assert np.linalg.norm(tr.velocity_mps[15:, :2], axis=1).max() <= CONFIG.air.speed_mps


def test_lower_speeds_for_one_call(refiner):
    state = LandState(np.array([1.0, 5.0]), 0.0, 0.0, 0.0)
    tr = refiner.land(state, np.array([[6.0, 5.0]]), boxes2([]), 0.0, None, speed_mps=0.3).trajectory
    assert 0.25 < tr.speed_mps.max() < 0.36
    air = AirState(np.array([1.0, 5.0, 1.0]), np.zeros(3), np.zeros(3), 0.0)
    up = np.array([[2.0, 5.0, 2.2]])
    tr = refiner.air(air, up, boxes3([]), 0.0, None, speed_mps=0.6, climb_mps=0.2).trajectory
    assert 0.1 < tr.velocity_mps[:, 2].max() <= 0.2
    assert np.linalg.norm(tr.velocity_mps[:, :2], axis=1).max() <= 0.6


@pytest.mark.parametrize("seed", range(20))
def test_brakes_stop_within_limits_from_any_state(refiner, seed):
    rng = np.random.default_rng(seed)
    state = LandState(
        rng.uniform(0, 9, 2), rng.uniform(-3, 3), rng.uniform(-0.2, 0.8), rng.uniform(-1.5, 1.5)
    )
    tr = refiner.brake_land(state, 1.0)
    check_land(tr, state)
    assert tr.end_s - 1.0 <= 0.95  # 0.8 m/s at 1 m/s^2, on the grid
    a = rng.uniform(-1.5, 1.5, 3)
    v = rng.uniform(-0.6, 0.6, 3) * [1, 1, 0.3]
    air = AirState(rng.uniform(0, 9, 3), v, a, 0.4)
    tr = refiner.brake_air(air, 1.0)
    assert tr.mode is Mode.AIR
    assert not tr.velocity_mps[-1].any()
    assert tr.end_s - 1.0 < 2.0
    # velocities are the derivative of positions, to the trapezoid's error
    moved = np.diff(tr.position_m, axis=0)
    assert np.allclose(moved, (tr.velocity_mps[1:] + tr.velocity_mps[:-1]) / 2 * 0.1, atol=2e-3)
    assert np.abs(np.diff(tr.acceleration_mps2, axis=0)).max() <= CONFIG.air.jerk_mps3 * 0.1 + 1e-6


def test_turn_ends_at_the_heading_and_stays_in_place(refiner):
    state = LandState(np.array([1.0, 2.0]), 3.0, 0.0, 0.0)
    for yaw in (-3.0, 0.0, 1.5, 3.1):
        tr = refiner.turn(state, yaw, 5.0)
        check_land(tr, state)
        assert wrap_pi(tr.yaw_rad[-1] - yaw) == pytest.approx(0.0, abs=1e-3)
        assert np.abs(tr.yaw_rad - 3.0).max() <= abs(wrap_pi(yaw - 3.0)) + 1e-6  # the short way, no overshoot
        assert np.ptp(tr.position_m, axis=0).max() == 0.0
    moving = LandState(np.array([1.0, 2.0]), 0.0, 0.5, -1.2)
    tr = refiner.turn(moving, 2.0, 5.0)
    check_land(tr, moving)
    assert wrap_pi(tr.yaw_rad[-1] - 2.0) == pytest.approx(0.0, abs=1e-3)
