"""Closed loop at 10 Hz through rooms with boxes: noisy state, noisy key points, no contact, arrival."""

from __future__ import annotations

import numpy as np
import pytest
from refine_rooms import boxes2, boxes3, random_boxes, shortest_way

from labr_autonomy.refine.reference import to_key_points
from labr_autonomy.refine.values import AirState, LandState
from labr_autonomy.types import Source

START, JITTER_M = (0.9, 5.0), 0.08


def jittered(rng, points, goal):
    """Key points as a network would draw them; the goal itself is known."""
    at_goal = np.linalg.norm(points - goal, axis=1) < 0.01
    return points + rng.normal(0.0, JITTER_M, points.shape) * ~at_goal[:, None]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_drives_through_a_room(refiner, seed):
    rng, goal = np.random.default_rng(seed), np.array([9.1, 5.0 + (seed % 5 - 2) * 1.2])
    field = boxes2(random_boxes(seed, START, goal, 12))
    state = LandState(np.array(START), rng.uniform(-3, 3), 0.0, 0.0)
    now, previous, least = 100.0, None, np.inf
    for _ in range(300):
        path = shortest_way(field, state.position_xy, goal, refiner.land_hard_m + 0.01)
        assert path is not None
        keys = to_key_points(path)
        result = refiner.land(state, jittered(rng, keys, goal), field, now, previous)
        if result.stopped:
            result = refiner.land(state, keys, field, now, previous, source=Source.SEARCH)
        previous = result.trajectory
        on_the_way = np.array([previous.sample(now + t).position_m[:2] for t in (0.025, 0.05, 0.075, 0.1)])
        least = min(least, field.lookup(on_the_way).min())
        now += 0.1
        s = previous.sample(now)
        moving = abs(s.speed_mps) > 0.01
        state = LandState(
            s.position_m[:2] + rng.normal(0, 0.004, 2),
            s.yaw_rad + rng.normal(0, 0.008),
            s.speed_mps + moving * rng.normal(0, 0.008),
            s.yaw_rate_rps,
        )
        if np.linalg.norm(state.position_xy - goal) < 0.05 and abs(state.speed) < 0.02:
            break
    assert np.linalg.norm(state.position_xy - goal) < 0.05
    assert least > 0.31  # the outline is 0.30


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_flies_through_a_room(refiner, seed):
    rng, goal = np.random.default_rng(seed), np.array([9.1, 5.0 + (seed % 5 - 2) * 1.2, 1.4])
    boxes = [
        (x0, y0, 0.0, x1, y1, 3.1 if rng.random() < 0.6 else rng.uniform(0.4, 1.0))
        for x0, y0, x1, y1 in random_boxes(seed, START, goal[:2], 12)
    ]
    field = boxes3(boxes)
    tall = boxes2([(b[0], b[1], b[3], b[4]) for b in boxes if b[5] > 0.8])
    state = AirState(np.array([*START, 1.2]), np.zeros(3), np.zeros(3), rng.uniform(-3, 3))
    now, previous, least = 50.0, None, np.inf
    for _ in range(300):
        path = shortest_way(tall, state.position[:2], goal[:2], refiner.air_hard_m + 0.01)
        assert path is not None
        flat = to_key_points(path)
        keys = np.column_stack([flat, np.linspace(state.position[2], goal[2], len(flat) + 1)[1:]])
        result = refiner.air(state, jittered(rng, keys, goal), field, now, previous)
        if result.stopped:
            result = refiner.air(state, keys, field, now, previous, source=Source.SEARCH)
        previous = result.trajectory
        on_the_way = np.array([previous.sample(now + t).position_m for t in (0.025, 0.05, 0.075, 0.1)])
        least = min(least, field.lookup(on_the_way).min())
        now += 0.1
        s = previous.sample(now)
        state = AirState(
            s.position_m + rng.normal(0, 0.005, 3),
            s.velocity_mps + rng.normal(0, 0.01, 3),
            s.acceleration_mps2,
            s.yaw_rad,
        )
        if np.linalg.norm(state.position - goal) < 0.05 and np.linalg.norm(s.velocity_mps) < 0.05:
            break
    assert np.linalg.norm(state.position - goal) < 0.05
    assert least > 0.31
