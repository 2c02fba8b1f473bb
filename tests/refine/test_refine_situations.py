"""The refiner in the situations that it must not fail in."""

from __future__ import annotations

import math

import numpy as np
import pytest
from refine_rooms import boxes2, boxes3

from labr_autonomy.clock import SystemClock
from labr_autonomy.config import RobotConfig
from labr_autonomy.perception.fields import Field2, Field3
from labr_autonomy.planner.pipeline import RING_M
from labr_autonomy.refine import check, reference, rti
from labr_autonomy.refine.planner import Refiner
from labr_autonomy.refine.values import AirState, LandState
from labr_autonomy.types import Source

HARD_M = 0.32


def drive(refiner, field, state, points, seconds=20.0, tick_s=0.1, replan=None):
    """Follow the plans exactly; returns the states on the way and the sources used."""
    now, previous, way, sources = 100.0, None, [state], []
    for k in range(round(seconds / tick_s)):
        keys = replan(state) if replan else points
        result = refiner.land(state, keys, field, now, previous)
        sources.append(result.source)
        previous = result.trajectory
        now = 100.0 + (k + 1) * tick_s
        s = previous.sample(now)
        state = LandState(s.position_m[:2], s.yaw_rad, s.speed_mps, s.yaw_rate_rps)
        way.append(state)
    return way, sources


def test_behind_and_slow_turns_first(refiner):
    state = LandState(np.array([5.0, 5.0]), 0.0, 0.0, 0.0)
    result = refiner.land(state, np.array([[4.0, 5.0], [3.0, 5.0]]), boxes2([]), 0.0, None)
    assert result.source is Source.TURN
    assert not result.stopped
    assert abs(abs(result.trajectory.yaw_rad[-1]) - math.pi) < 0.05
    way, _ = drive(refiner, boxes2([]), state, np.array([[4.0, 5.0], [3.0, 5.0]]))
    assert np.linalg.norm(way[-1].position_xy - [3.0, 5.0]) < 0.05


@pytest.mark.parametrize("bearing", np.radians([0, 30, 60, 90, 120, 180, -150]))
@pytest.mark.parametrize("away", [0.06, 0.15, 0.4, 1.2])
def test_rests_at_the_goal_within_5_cm(refiner, bearing, away):
    goal = np.array([5.0 + away * math.cos(bearing), 5.0 + away * math.sin(bearing)])
    state = LandState(np.array([5.0, 5.0]), 0.0, 0.0, 0.0)
    way, _ = drive(refiner, boxes2([]), state, goal[None], 6.0)
    assert np.linalg.norm(way[-1].position_xy - goal) < 0.05
    assert abs(way[-1].speed) < 0.02
    assert max(np.linalg.norm(s.position_xy - [5.0, 5.0]) for s in way) < away + 0.25


@pytest.mark.parametrize("count", [2, 5])
def test_key_points_packed_together(refiner, count):
    points = np.array([5.0, 5.0]) + np.linspace(0.1, 0.5, count)[:, None] * [0.8, 0.6]
    way, _ = drive(refiner, boxes2([]), LandState(np.array([5.0, 5.0]), 0.5, 0.0, 0.0), points, 5.0)
    assert np.linalg.norm(way[-1].position_xy - points[-1]) < 0.05


def test_at_the_goal_it_stays(refiner):
    state = LandState(np.array([5.0, 5.0]), 1.0, 0.0, 0.0)
    result = refiner.land(state, np.array([[5.0, 5.0]]), boxes2([]), 0.0, None)
    assert not result.stopped
    assert np.ptp(result.trajectory.position_m, axis=0).max() < 0.02


@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_passage_of_90_cm(refiner, yaw):
    field = boxes2([(4.0, 0.0, 6.0, 4.6), (4.0, 5.5, 6.0, 10.0)])
    points = np.array([[3.5, 5.1], [4.3, 5.1], [5.1, 5.0], [5.9, 5.0], [7.5, 5.0]])
    way, sources = drive(refiner, field, LandState(np.array([2.7, 5.3]), yaw, 0.0, 0.0), points, 12.0)
    assert np.linalg.norm(way[-1].position_xy - [7.5, 5.0]) < 0.05
    assert field.lookup(np.array([s.position_xy for s in way])).min() >= HARD_M - 0.005
    assert Source.BRAKE not in sources


@pytest.mark.parametrize("start", [(0.415, 5.0), (0.40, 0.42), (0.36, 5.0)])
def test_backs_out_of_a_start_that_is_too_close(refiner, start):
    field = boxes2([])
    state = LandState(np.array(start), math.pi, 0.0, 0.0)
    first = field.lookup(state.position_xy[None])[0]
    assert first < HARD_M
    goal = np.array([3.0, 5.0])
    way, _ = drive(refiner, field, state, goal[None], 12.0)
    distance = field.lookup(np.array([s.position_xy for s in way]))
    assert distance.min() >= first - 0.002
    assert np.linalg.norm(way[-1].position_xy - goal) < 0.05


def test_key_points_inside_an_obstacle_are_pushed_free(refiner):
    field = boxes2([(4.0, 4.0, 5.0, 5.1)])
    points = np.array([[3.0, 5.0], [3.8, 5.05], [4.6, 5.05], [5.4, 5.0], [7.0, 5.0]])
    assert field.lookup(points).min() < 0.0
    state = LandState(np.array([2.0, 5.0]), 0.0, 0.0, 0.0)
    way, sources = drive(refiner, field, state, points, 12.0)
    assert np.linalg.norm(way[-1].position_xy - points[-1]) < 0.05
    assert field.lookup(np.array([s.position_xy for s in way])).min() >= HARD_M - 0.005
    assert Source.BRAKE not in sources


def test_key_points_through_a_wall_are_refused(refiner):
    field = boxes2([(3.0, 0.0, 4.5, 10.0)])
    state = LandState(np.array([2.3, 5.0]), 0.0, 0.0, 0.0)
    result = refiner.land(state, np.array([[3.5, 5.0], [6.0, 5.0]]), field, 0.0, None)
    assert result.stopped
    assert result.source is Source.BRAKE
    assert "blocked" in result.reason


def test_a_refusal_while_moving_keeps_the_previous_plan_while_it_is_free(refiner):
    open_, wall = boxes2([]), boxes2([(5.5, 0.0, 7.0, 10.0)])
    state = LandState(np.array([3.0, 5.0]), 0.0, 0.6, 0.0)
    ahead = np.array([[6.0, 5.0], [8.0, 5.0]])
    before = refiner.land(state, ahead, open_, 10.0, None).trajectory
    s = before.sample(10.13)  # not a multiple of the step
    now = LandState(s.position_m[:2], s.yaw_rad, s.speed_mps, s.yaw_rate_rps)
    bad = np.array([[3.4, 5.0], [3.4, 9.9], [3.4, 12.0]])  # out of the room
    near = boxes2([(0.0, 5.6, 3.7, 9.9)])
    result = refiner.land(now, bad, near, 10.13, before)
    if result.stopped:
        assert result.source is Source.PREVIOUS
        late = result.trajectory.position_m[-1] - before.position_m[-1]
        assert np.linalg.norm(late) < 0.02  # the same place, in the time that is left
    result = refiner.land(now, np.array([[6.2, 5.0]]), wall, 10.13, before)
    assert wall.lookup(result.trajectory.position_m[:, :2]).min() >= HARD_M - 0.005


def test_an_obstacle_that_pops_up_stops_the_robot(refiner):
    state = LandState(np.array([3.0, 5.0]), 0.0, 0.8, 0.0)
    before = refiner.land(state, np.array([[8.0, 5.0]]), boxes2([]), 0.0, None).trajectory
    field = boxes2([(3.75, 0.0, 4.5, 10.0)])  # 0.43 m of room for 0.32 m of braking
    s = before.sample(0.1)
    now = LandState(s.position_m[:2], s.yaw_rad, s.speed_mps, s.yaw_rate_rps)
    result = refiner.land(now, np.array([[8.0, 5.0]]), field, 0.1, before)
    assert result.stopped
    assert result.source is Source.BRAKE
    assert field.lookup(result.trajectory.position_m[:, :2]).min() > 0.30 or "braking within" in result.reason


@pytest.mark.parametrize("shift_s", [0.0, 0.037, 0.1, 0.16, 0.5, 1.23])
def test_the_previous_plan_is_shifted_by_any_time(refiner, shift_s):
    model = refiner.land.__self__._model
    state = LandState(np.array([3.0, 5.0]), 3.1, 0.4, 0.3)
    before = refiner.land(state, np.array([[2.0, 4.8], [0.9, 4.3]]), boxes2([]), 50.0, None).trajectory
    at = before.sample(50.0 + shift_s)
    x0 = np.array([*at.position_m[:2], at.yaw_rad - 2 * math.pi, at.speed_mps, at.yaw_rate_rps])
    x, u = model.shifted(before, 50.0 + shift_s, x0)
    for k in (1, 5, 12):
        then = before.sample(50.0 + shift_s + 0.1 * k)
        assert np.allclose(x[k, :2], then.position_m[:2], atol=2e-3)  # a seed lies on chords: a h^2 / 8
        assert x[k, 2] == pytest.approx(then.yaw_rad - 2 * math.pi, abs=1e-9)  # the turn count of the state
        assert x[k, 3] == pytest.approx(then.speed_mps, abs=1e-9)
    assert np.allclose(x[0, 3:] + np.cumsum(u, axis=0)[-1] * 0.1, 0.0, atol=1e-9)  # still ends at rest


# ---- unknown space


def speed_at(tr, x_m):
    return float(np.interp(x_m, tr.position_m[:, 0], tr.speed_mps))


def test_slows_before_unknown_space_but_creeps_on(refiner):
    state = LandState(np.array([2.0, 5.0]), 0.0, 0.8, 0.0)
    keys = np.array([[8.0, 5.0]])
    known = refiner.land(state, keys, boxes2([]), 0.0, None).trajectory
    field = boxes2([], unknown=[(3.2, 0.0, 10.0, 10.0)])
    tr = refiner.land(state, keys, field, 0.0, None).trajectory
    assert speed_at(known, 2.9) > 0.7
    assert speed_at(tr, 2.9) < 0.35  # the outline meets the unknown there
    way, _ = drive(refiner, field, LandState(np.array([2.0, 5.0]), 0.0, 0.0, 0.0), keys, 8.0)
    inside = [s.speed for s in way if 3.3 < s.position_xy[0] < 7.0]
    assert inside  # it went on
    assert min(inside) > 0.2


def test_unknown_space_near_the_outline_counts_as_free(refiner):
    field = boxes2([], unknown=[(2.05, 4.0, 2.85, 6.0)])  # what the camera cannot see before the robot
    state = LandState(np.array([2.0, 5.0]), 0.0, 0.0, 0.0)
    path = reference.shape(state.position_xy, np.array([[8.0, 5.0]]), field, 0.32, 0.42)
    assert reference.first_unknown(path, field, 0.9) == math.inf
    far = boxes2([], unknown=[(2.05, 4.0, 3.05, 6.0)])
    assert reference.first_unknown(path, far, 0.9) == pytest.approx(0.95, abs=0.051)


def wedge(state, half_rad, ring_m):
    """What a robot has seen that was just put down: a ring about it, and what its camera shows."""
    known = np.zeros((200, 200), bool)
    x, y = (np.indices(known.shape) + 0.5) * 0.05 - state.position_xy[:, None, None]
    off = np.angle(np.exp(1j * (np.arctan2(y, x) - state.yaw)))
    known |= (np.hypot(x, y) < ring_m) | (np.abs(off) < half_rad)
    return Field2.from_occupied(~known, known, np.zeros(2), 0.05)


@pytest.mark.parametrize("side", [-1, 1])
def test_what_is_unseen_beside_the_way_ahead_is_looked_at(refiner, side):
    state, keys = LandState(np.array([5.0, 5.0]), 0.0, 0.0, 0.0), np.array([[8.0, 5.0 + 0.3 * side]])
    plan = refiner.land(state, keys, wedge(state, 0.7, 0.42), 0.0, None)
    assert plan.source is Source.TURN
    assert "looking" in plan.reason
    turned = plan.trajectory.yaw_rad[-1]
    assert 0.66 < side * turned < 1.4, "to the nearer of what is hidden, which the camera then has in view"


def test_the_way_ahead_of_a_robot_just_put_down_is_free(refiner):
    state = LandState(np.array([5.0, 5.0]), 0.4, 0.0, 0.0)
    keys = state.position_xy + 3.0 * np.array([[np.cos(0.4), np.sin(0.4)]])
    field = wedge(state, 0.75, 0.3 + RING_M)  # half of the camera's 87 degrees
    assert refiner.land(state, keys, field, 0.0, None).source is Source.GKPN


BEND = np.array([[5.8, 5.15], [6.3, 5.7], [6.8, 6.3], [7.3, 6.9]])  # soon leaves the view to the east


def behind_a_box(*looks):
    """What a robot has seen that looked about, with a box before it on the right."""
    known = np.any([wedge(state, 0.75, 0.3 + RING_M).known for state in looks], axis=0)
    x, y = (np.indices(known.shape) + 0.5) * 0.05
    known &= ~((x > 6.4) & (y > 4.0) & (y < 5.7))
    return Field2.from_occupied(~known, known, np.zeros(2), 0.05)


def test_a_robot_at_rest_looks_where_its_way_will_leave_its_view(refiner):
    state = LandState(np.array([5.0, 5.0]), 0.0, 0.0, 0.0)
    plan = refiner.land(state, BEND, behind_a_box(state), 0.0, None)
    assert plan.source is Source.TURN
    turned = plan.trajectory.yaw_rad[-1]
    assert 0.3 < turned < 0.8
    there = LandState(state.position_xy, turned, 0.0, 0.0)
    assert refiner.land(there, BEND, behind_a_box(state, there), 0.0, None).source is Source.GKPN


def test_a_robot_that_rolls_or_has_seen_all_of_it_does_not_look_there_first(refiner):
    state = LandState(np.array([5.0, 5.0]), 0.0, 0.0, 0.0)
    rolls = LandState(state.position_xy, 0.0, 0.3, 0.0)
    assert refiner.land(rolls, BEND, behind_a_box(state), 0.0, None).source is Source.GKPN
    wall = boxes2([(6.2, 4.0, 6.5, 7.5)])  # ends the way as soon, but there is nothing to see
    assert refiner.land(state, BEND, wall, 0.0, None).source is Source.GKPN


def test_no_look_that_the_way_itself_would_turn_back(refiner):
    """It would turn to and fro for ever."""
    state = LandState(np.array([5.0, 5.0]), 0.0, 0.0, 0.0)
    keys = np.array([[5.7, 4.9], [5.3, 5.6], [5.0, 6.5]])
    plan = refiner.land(state, keys, behind_a_box(state), 0.0, None)
    assert plan.source is Source.GKPN


# ---- in the air


def test_air_passes_a_door_and_a_beam(refiner):
    door = [(5.0, 0.0, 0.0, 5.2, 4.5, 3.1), (5.0, 5.5, 0.0, 5.2, 10.0, 3.1)]
    beam = [(6.5, 0.0, 1.9, 6.7, 10.0, 3.1)]
    field = boxes3(door + beam)
    state = AirState(np.array([3.0, 5.0, 1.0]), np.zeros(3), np.zeros(3), 0.0)
    goal = np.array([8.0, 5.0, 1.0])
    keys = np.array([[4.0, 5.1, 1.0], [5.1, 5.1, 1.1], [6.6, 5.0, 1.1], goal])
    now, previous, least = 0.0, None, 9.0
    for k in range(90):
        result = refiner.air(
            state, keys[max(0, sum(state.position[0] > keys[:3, 0])) :], field, now, previous
        )
        previous, now = result.trajectory, 0.1 * (k + 1)
        s = previous.sample(now)
        state = AirState(s.position_m, s.velocity_mps, s.acceleration_mps2, s.yaw_rad)
        least = min(least, field.lookup(state.position[None])[0])
    assert least >= refiner.air_hard_m - 0.005
    assert np.linalg.norm(state.position - goal) < 0.05


def test_air_turns_before_flying_blind_and_looks_along_the_path(refiner):
    state = AirState(np.array([5.0, 5.0, 1.0]), np.zeros(3), np.zeros(3), 0.0)
    keys = np.array([[4.0, 5.0, 1.0], [2.0, 5.0, 1.0]])
    result = refiner.air(state, keys, boxes3([]), 0.0, None)
    assert result.source is Source.TURN
    assert np.ptp(result.trajectory.position_m, axis=0).max() == 0.0
    assert abs(result.trajectory.yaw_rad[-1]) == pytest.approx(math.pi, abs=0.02)
    sideways = AirState(state.position, np.zeros(3), np.zeros(3), math.pi - 0.7)
    tr = refiner.air(sideways, keys, boxes3([]), 0.0, None).trajectory
    assert tr.source is Source.GKPN
    assert tr.yaw_rad[-1] == pytest.approx(math.pi, abs=0.05)


def test_a_flight_can_always_stop_within_what_was_seen_but_creeps_on(refiner):
    """Air across the way that no image has shown, as behind a corner."""
    seen = boxes3([])
    known = seen.known.copy()
    known[60:75] = False  # from x = 6.0 m on
    field = Field3(seen.distance_m, known, seen.origin_m, seen.cell_m)
    state = AirState(np.array([3.0, 5.0, 1.0]), np.zeros(3), np.zeros(3), 0.0)
    goal, previous, fastest, inside = np.array([[9.0, 5.0, 1.0]]), None, 0.0, []
    for k in range(120):
        previous = refiner.air(state, goal, field, 0.1 * k, previous).trajectory
        s = previous.sample(0.1 * (k + 1))
        state = AirState(s.position_m, s.velocity_mps, s.acceleration_mps2, s.yaw_rad)
        speed = float(np.linalg.norm(state.velocity))
        left_m = 6.0 - RobotConfig().body.radius_m - state.position[0]
        fastest = max(fastest, speed)
        if -1.0 < left_m < 0.6:
            assert speed < max(0.45, math.sqrt(2.0 * 2.5 * max(left_m, 0.0)))
        if 0.0 < state.position[0] - 6.0 < 1.2:
            inside.append(speed)
    assert fastest > 0.8
    assert min(inside) > 0.15, "it went on"
    assert np.linalg.norm(state.position - goal[0]) < 0.1


def test_air_refuses_a_wall_and_brakes(refiner):
    field = boxes3([(6.0, 0.0, 0.0, 7.0, 10.0, 3.1)])
    state = AirState(np.array([5.1, 5.0, 1.0]), np.array([0.4, 0.0, 0.0]), np.zeros(3), 0.0)
    result = refiner.air(state, np.array([[6.5, 5.0, 1.0], [8.0, 5.0, 1.0]]), field, 0.0, None)
    assert result.stopped
    assert result.source is Source.BRAKE
    assert result.clearance_m > 0.1


# ---- the guard check matters


def test_without_the_dense_check_a_bad_plan_would_leave(monkeypatch):
    """A post thinner than the spacing of the plan's nodes, and a solver told that nothing is there."""
    refiner = Refiner(RobotConfig())
    field = boxes2([(5.0, 4.9, 5.1, 5.1)])
    state = LandState(np.array([4.0, 5.0]), 0.0, 0.6, 0.0)
    keys = np.array([[7.0, 5.0]])
    monkeypatch.setattr(rti.Polytopes, "planes", lambda self, seed: np.tile([0.0, 0.0, -50.0], (25, 4)))
    monkeypatch.setattr(reference, "_pushed", lambda points, *rest: points)
    monkeypatch.setattr(reference, "CHECK_M", 0.09)
    real = reference.shape
    monkeypatch.setattr(
        reference, "shape", lambda *a: reference.Path(real(a[0], a[1], boxes2([]), *a[3:]).points_m, False)
    )
    guarded = refiner.land(state, keys, field, 0.0, None)
    assert guarded.stopped
    assert field.lookup(guarded.trajectory.position_m[:, :2]).min() >= HARD_M - 1e-3
    monkeypatch.setattr(rti, "dense_check", lambda points, field, hard: check.Verdict(True, 1.0))
    unguarded = refiner.land(state, keys, field, 0.0, None)
    assert not unguarded.stopped
    assert field.lookup(unguarded.trajectory.position_m[:, :2]).min() < 0.0


def test_dense_check_rules():
    field = boxes2([])  # the wall's face is at x = 0.1

    def verdict(*xs):
        return check.dense_check(np.array([[x, 5.0] for x in xs]), field, HARD_M).free

    assert verdict(1.0, 0.8, 0.5)
    assert not verdict(1.0, 0.4, 1.0)
    assert verdict(0.38, 0.40, 0.43, 1.0)  # leaves
    assert verdict(0.38, 0.38)  # stands
    assert not verdict(0.38, 0.37, 1.0)  # comes closer first
    assert not verdict(0.38, 0.41, 0.38)  # comes back
    assert not verdict(0.38, 0.45, 0.39, 1.0)


@pytest.mark.parametrize("bad", [np.full((5, 3), np.nan), np.array([[1.0, np.inf, 0.0]])])
def test_key_points_that_are_no_numbers_are_refused(refiner, bad):
    land = refiner.land(LandState(np.array([5.0, 5.0]), 0.0, 0.5, 0.0), bad, boxes2([]), 0.0, None)
    air = AirState(np.array([5.0, 5.0, 1.0]), np.array([0.5, 0.0, 0.0]), np.zeros(3), 0.0)
    for result in (land, refiner.air(air, bad, boxes3([]), 0.0, None)):
        assert result.stopped
        assert result.source is Source.BRAKE
        assert np.isfinite(result.trajectory.position_m).all()


def test_a_map_without_obstacles_and_no_key_points(refiner):
    field = boxes2([], walls=False)
    state = LandState(np.array([5.0, 5.0]), 0.0, 0.0, 0.0)
    assert refiner.land(state, np.array([[7.0, 5.0]]), field, 0.0, None).source is Source.GKPN
    stays = refiner.land(state, np.zeros((0, 3)), field, 0.0, None)
    assert np.ptp(stays.trajectory.position_m, axis=0).max() < 1e-3
    hover = AirState(np.array([5.0, 5.0, 1.0]), np.zeros(3), np.zeros(3), 0.0)
    stays = refiner.air(hover, hover.position[None], boxes3([]), 0.0, None)
    assert np.ptp(stays.trajectory.position_m, axis=0).max() < 0.01


def test_both_problems_are_built_in_under_5_s():
    began_s = SystemClock().now_s()
    Refiner(RobotConfig())
    assert SystemClock().now_s() - began_s < 5.0
