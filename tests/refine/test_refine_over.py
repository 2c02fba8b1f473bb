"""Between nodes and from any start, no limit is passed that braking keeps; a plan that does stays inside."""

from __future__ import annotations

import math

import numpy as np
import pytest
from refine_rooms import boxes2, boxes3

from labr_autonomy.config import RobotConfig
from labr_autonomy.refine.air import AirModel, Envelope, trajectory
from labr_autonomy.refine.braking import brake_axis
from labr_autonomy.refine.land import LandModel
from labr_autonomy.refine.limits import GIVE, Limit, worst
from labr_autonomy.refine.planner import Refiner
from labr_autonomy.refine.rti import Task
from labr_autonomy.refine.values import STEP_S, STEPS, AirState, LandState
from labr_autonomy.types import Source

CONFIG = RobotConfig()
AIR = CONFIG.air


def peak(v, a, jerk):
    """The most that a velocity reaches when the jerk is against it from now on."""
    return v + max(a, 0.0) ** 2 / (2.0 * jerk)


def motion(tr, pitch_s=0.005):
    return [tr.sample(float(t)) for t in np.arange(tr.start_s, tr.end_s, pitch_s)]


# ---- braking along one axis


@pytest.mark.parametrize("seed", range(200))
def test_braking_on_the_grid_keeps_jerk_and_acceleration_and_rests(seed):
    rng = np.random.default_rng(seed)
    v0, a0 = rng.uniform(-1.5, 1.5) * (seed % 7 > 0), rng.uniform(-3.0, 3.0) * (seed % 5 > 0)
    a = brake_axis(v0, a0, 2.5, 10.0)
    assert a[0] == a0
    assert a[-1] == 0.0
    assert np.abs(np.diff(a)).max() <= 10.0 * STEP_S + 1e-12
    assert np.abs(a).max() <= max(2.5, abs(a0)) + 1e-12
    assert v0 + STEP_S * float(((a[1:] + a[:-1]) / 2.0).sum()) == pytest.approx(0.0, abs=1e-12)
    v = v0 + np.concatenate([[0.0], np.cumsum((a[1:] + a[:-1]) / 2.0 * STEP_S)])
    t = np.linspace(0.0, STEP_S, 41)
    dense = v[:-1, None] + a[:-1, None] * t + np.diff(a)[:, None] / STEP_S * t**2 / 2.0
    for sign in (-1.0, 1.0):
        if peak(sign * v0, sign * a0, 10.0) > 0.4:  # where a limit might be: no control peaks lower
            assert (sign * dense).max() <= peak(sign * v0, sign * a0, 10.0) + 1e-9


# ---- what leaves


STARTS = [  # (vertical velocity, vertical acceleration): 5 to 1 mm/s below what braking lets fall to 0.5 m/s
    (-(0.499 - a**2 / 20.0), -a) for a in (0.2, 0.43, 0.6, 1.04, 1.5)
] + [(-0.4072, -1.0438), (-0.4672, -0.4265), (-0.4296, -0.9472), (-0.4811, -0.3426)]


@pytest.mark.parametrize(("v", "a"), STARTS)
def test_a_limit_that_can_be_kept_is_kept_between_nodes(refiner, v, a):
    assert peak(-v, -a, AIR.jerk_mps3) < AIR.descend_mps
    state = AirState(np.array([3.0, 5.0, 2.2]), np.array([0.4, 0.0, v]), np.array([0.0, 0.0, a]), 0.0)
    down = np.array([[4.0, 5.0, 1.5], [6.0, 5.0, 0.5]])
    result = refiner.air(state, down, boxes3([]), 0.0, None)
    assert result.source is Source.GKPN
    assert max(-now.velocity_mps[2] for now in motion(result.trajectory)) <= AIR.descend_mps + GIVE


@pytest.mark.parametrize("seed", range(30))
def test_from_beyond_a_limit_nothing_is_worse_than_braking(refiner, seed):
    rng = np.random.default_rng(seed)
    v = np.array([*rng.uniform(-1.3, 1.3, 2), rng.uniform(-0.7, 1.0)])
    a = rng.uniform(-2.0, 2.0, 3)
    state = AirState(np.array([5.0, 5.0, 1.4]), v, a, math.atan2(v[1], v[0]))
    keys = state.position + np.outer(
        np.linspace(0.2, 1.0, 5), [4.0 * v[0], 4.0 * v[1], rng.uniform(-0.7, 0.7)]
    )
    result = refiner.air(state, keys, boxes3([]), 0.0, None)
    plan, brake = motion(result.trajectory), motion(refiner.brake_air(state, 0.0))
    for does, most in (
        (lambda now: math.hypot(*now.velocity_mps[:2]), AIR.speed_mps),
        (lambda now: now.velocity_mps[2], AIR.climb_mps),
        (lambda now: -now.velocity_mps[2], AIR.descend_mps),
        (lambda now: math.hypot(*now.acceleration_mps2[:2]), AIR.acceleration_mps2),
        (lambda now: abs(now.acceleration_mps2[2]), AIR.acceleration_mps2),
    ):
        braking = np.array([does(now) for now in brake])
        doing = np.array([does(now) for now in plan])
        allowed = np.full(len(doing), most)
        shared = min(len(doing), len(braking))
        allowed[:shared] = np.maximum(allowed[:shared], braking[:shared])
        assert (doing <= allowed + GIVE + 3e-3).all()  # 3 mm/s: the check samples every 25 ms


@pytest.mark.parametrize("v", [-0.55, -0.7])
def test_a_speed_beyond_its_limit_comes_down_as_fast_as_braking(refiner, v):
    state = AirState(np.array([3.0, 5.0, 2.2]), np.array([0.4, 0.0, v]), np.zeros(3), 0.0)
    result = refiner.air(state, np.array([[6.0, 5.0, 0.5]]), boxes3([]), 0.0, None)
    brake = refiner.brake_air(state, 0.0)
    within = next(now.stamp_s for now in motion(brake) if -now.velocity_mps[2] <= AIR.descend_mps)
    late = [-now.velocity_mps[2] for now in motion(result.trajectory) if now.stamp_s > within]
    assert max(late) <= AIR.descend_mps + GIVE


def test_above_the_height_limit_it_neither_rises_nor_hangs(refiner):
    state = AirState(np.array([3.0, 5.0, 2.6]), np.zeros(3), np.zeros(3), 0.0)
    result = refiner.air(state, np.array([[7.0, 5.0, 1.5]]), boxes3([], (10.0, 10.0, 4.0)), 0.0, None)
    assert result.source is Source.GKPN
    assert max(now.position_m[2] for now in motion(result.trajectory)) <= 2.6 + 0.005
    assert result.trajectory.position_m[-1, 2] < 2.3


@pytest.mark.parametrize(
    ("v", "a", "up_m", "nodes", "back_m"),
    [
        (0.465, 0.07, 0.52, 2, -0.259),
        (0.568, 1.193, 0.521, 9, -0.066),
        (0.456, 0.141, 0.318, 3, -0.265),
        (0.438, 0.989, 0.446, 8, -0.195),
    ],
)
def test_the_solver_sees_peaks_between_nodes(refiner, v, a, up_m, nodes, back_m):
    """A reference that jumps up and down: the descent is at its limit for less than an interval."""
    planner = refiner.air.__self__
    model = planner._model
    x0 = np.array([5.0, 5.0, 1.05, 0.43, 0.18, v, 0.1, 0.12, a])
    brake = model.brake(x0, ENV)
    task = Task(
        model.problem,
        planner._step,
        x0,
        model.bounds(ENV, brake),
        model.settle,
        model.dense,
        boxes3([]),
        planner.hard_m,
        lambda x, u: model.over(x, u, ENV, brake),
    )
    reference = np.tile(x0[:3], (STEPS + 1, 1))
    reference[:, 2] += np.where(np.arange(STEPS + 1) < nodes, up_m, back_m)
    plan = task.solve(model.cold(x0, reference), reference, None)
    assert plan is not None
    assert plan.verdict.over == ""


# ---- the rest of the previous plan

ROUND = np.array([[4.4, 4.9, 1.2], [5.2, 5.5, 1.2], [6.2, 5.5, 1.2], [7.5, 5.5, 1.2]])
CORNER = (5.0, 0.0, 0.0, 6.0, 5.0, 3.1)


def flown_for(refiner, after_s):
    """A plan round a corner, and the state that far along it."""
    begin = AirState(np.array([4.4, 4.2, 1.2]), np.array([0.0, 0.8, 0.0]), np.zeros(3), math.pi / 2.0)
    before = refiner.air(begin, ROUND, boxes3([CORNER]), 0.0, None).trajectory
    assert before.source is Source.GKPN
    at = before.sample(after_s)
    return before, AirState(at.position_m, at.velocity_mps, at.acceleration_mps2, at.yaw_rad)


@pytest.mark.parametrize("after_s", [0.13, 0.3, 0.47, 0.6, 0.85])
def test_without_a_new_plan_the_previous_one_is_flown_to_its_end_as_it_is(refiner, after_s):
    before, state = flown_for(refiner, after_s)
    nowhere = np.full((1, 3), np.nan)
    result = refiner.air(state, nowhere, boxes3([CORNER]), after_s, before)
    assert (result.source, result.stopped) == (Source.PREVIOUS, True)
    assert result.clearance_m + refiner.air.__self__.outline_m >= refiner.air_hard_m - 1e-3
    for t in np.arange(after_s, before.end_s, 0.02):
        assert result.trajectory.sample(t).position_m == pytest.approx(before.sample(t).position_m, abs=1e-3)


@pytest.mark.parametrize(("after_s", "x", "y"), [(0.3, 4.4, 5.0), (0.47, 4.4, 5.1), (0.6, 4.5, 5.2)])
def test_with_nothing_free_the_way_farther_from_obstacles_is_flown(refiner, after_s, x, y):
    """A post appears where braking leads, and too near to the previous plan as well."""
    before, state = flown_for(refiner, after_s)
    field = boxes3([CORNER, (x, y, 0.0, x + 0.1, y + 0.1, 3.1)])

    def nearest(tr):
        return field.lookup(np.array([now.position_m for now in motion(tr)])).min()

    result = refiner.air(state, np.full((1, 3), np.nan), field, after_s, before)
    assert result.source is Source.PREVIOUS
    assert nearest(refiner.brake_air(state, after_s)) + 0.05 < nearest(result.trajectory) < refiner.air_hard_m


# ---- the check itself


def test_a_plan_over_a_limit_does_not_leave(monkeypatch):
    """A solver that is told of wide limits; without the check its plan would leave."""
    refiner = Refiner(CONFIG)
    honest = AirModel.bounds
    wide = Envelope(3.0, 2.0, 2.0, 4.0, 20.0, 1.2, 0.12, 2.5)
    monkeypatch.setattr(AirModel, "bounds", lambda self, env, brake: honest(self, wide, brake))
    state = AirState(np.array([2.0, 5.0, 1.2]), np.array([1.1, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), 0.0)
    keys = np.array([[5.0, 5.0, 1.2], [8.0, 5.0, 1.2]])
    guarded = refiner.air(state, keys, boxes3([]), 0.0, None)
    assert guarded.source is Source.BRAKE
    assert "the best plan flies at 1." in guarded.reason
    assert "1.200 at most" in guarded.reason
    assert max(math.hypot(*now.velocity_mps[:2]) for now in motion(guarded.trajectory)) <= AIR.speed_mps
    monkeypatch.setattr(AirModel, "over", lambda *_: "")
    unguarded = refiner.air(state, keys, boxes3([]), 0.0, None)
    assert unguarded.source is Source.GKPN
    assert (
        max(math.hypot(*now.velocity_mps[:2]) for now in motion(unguarded.trajectory)) > AIR.speed_mps + 0.02
    )


def test_a_drive_over_a_limit_does_not_leave(monkeypatch):
    refiner = Refiner(CONFIG)
    wide = LandModel(CONFIG.land.model_copy(update={"speed_mps": 1.5, "acceleration_mps2": 3.0}))
    monkeypatch.setattr(LandModel, "bounds", lambda self, brake, honest=LandModel.bounds: honest(wide, brake))
    state = LandState(np.array([2.0, 5.0]), 0.0, 0.7, 0.0)
    keys = np.array([[5.0, 6.0], [8.0, 5.0]])
    guarded = refiner.land(state, keys, boxes2([]), 0.0, None)
    assert guarded.source is Source.BRAKE
    assert "the best plan" in guarded.reason
    assert "at most" in guarded.reason
    monkeypatch.setattr(LandModel, "over", lambda *_: "")
    assert refiner.land(state, keys, boxes2([]), 0.0, None).source is Source.GKPN


ENV = Envelope.of(AIR, 0.0, CONFIG.body.below_m)


@pytest.mark.parametrize(
    ("axis", "v", "a", "jerk", "says"),
    [
        (2, -0.49, -0.5, 9.0, "descends"),  # the nodes keep the limit, the parabola between them does not
        (2, 0.79, 0.5, -9.0, "climbs at"),
        (0, 1.19, 0.5, -9.0, "flies"),
        (1, 0.0, 2.6, 0.0, "accelerates"),
        (2, 0.0, -2.6, 0.0, "rises"),
        (0, 0.0, 0.0, 12.0, "jerks by"),
        (2, 0.0, 0.0, 12.0, "jerks upwards"),
    ],
)
def test_each_limit_is_seen(axis, v, a, jerk, says):
    model = AirModel()
    x0, u = np.zeros(9), np.zeros((1, 3))
    x0[2], x0[3 + axis], x0[6 + axis], u[0, axis] = 1.2, v, a, jerk
    x = model.simulate(x0, u)
    rest = np.zeros(9)
    rest[2] = 1.2
    still = (np.tile(rest, (3, 1)), np.zeros((2, 3)))
    assert model.over(x, u, ENV, still).startswith(says)
    assert model.over(*still, ENV, still) == ""


def test_where_braking_is_within_again_the_limit_holds():
    braking = np.array([0.6, 0.55, 0.4, 0.0])
    assert worst((Limit("goes {:.2f}", np.array([0.6, 0.55, 0.5, 0.5]), 0.5, braking),)) == ""
    assert (
        worst((Limit("goes {:.2f}", np.array([0.6, 0.55, 0.51, 0.5]), 0.5, braking),))
        == "goes 0.51, 0.500 at most"
    )
    assert (
        worst((Limit("goes {:.2f}", np.array([0.6, 0.56, 0.5, 0.5]), 0.5, braking),))
        == "goes 0.56, 0.550 at most"
    )
    assert "nan" in worst((Limit("goes {:.2f}", np.array([0.6, math.nan]), 0.5, braking),))


# ---- what is flown between nodes is what was planned


def test_a_sample_between_nodes_is_a_state_of_the_plan():
    model = AirModel()
    x0 = np.array([1.0, 2.0, 1.5, 0.4, -0.2, -0.3, 0.5, -0.6, -0.9])
    x, u = model.brake(x0, ENV)
    tr = trajectory(x, np.zeros((len(x), 2)), 4.0, Source.BRAKE)
    for k in range(len(u)):
        for t in (0.0, 0.013, 0.05, 0.088):
            p, v, a, j = x[k, :3], x[k, 3:6], x[k, 6:], u[k]
            now = tr.sample(4.0 + STEP_S * k + t)
            assert now.position_m == pytest.approx(p + v * t + a * t**2 / 2 + j * t**3 / 6, abs=1e-9)
            assert now.velocity_mps == pytest.approx(v + a * t + j * t**2 / 2, abs=1e-9)
            assert now.acceleration_mps2 == pytest.approx(a + j * t, abs=1e-9)
