"""Splines, their cost and its gradient, and the way on the map, against independent arithmetic."""

import math

import numpy as np
import pytest
from scipy.interpolate import BSpline

from labr_autonomy.perception.fields import Field2, Field3
from labr_autonomy.refine.search import cell_cost
from labr_autonomy.refine.shortest import costs_from
from sim.bench.mapping import astar, bspline, optimise
from sim.bench.mapping.optimise import WEIGHTS, Aims, cost, optimised, raised

pytestmark = pytest.mark.timeout(90)  # the first run compiles the kernels


def curve(seed, n=9, d=3):
    return np.cumsum(np.random.default_rng([seed, 1]).normal(0.3, 0.2, (n, d)), axis=0)


def test_the_spline_is_the_cubic_b_spline_of_scipy():
    q, step = curve(1), 0.25
    knots = step * np.arange(-3, len(q) + 1)
    times = np.linspace(0.0, step * (len(q) - 3) - 1e-9, 50)
    ours = bspline.evaluate(q, step, times)
    for order, values in enumerate(ours):
        assert values == pytest.approx(BSpline(knots, q, 3)(times, nu=order), abs=1e-8)


def test_derivatives_agree_with_finite_differences():
    q, step, h = curve(2), 0.25, 1e-5
    times = np.linspace(0.05, step * 6 - 0.06, 23)
    before, middle, after = (bspline.evaluate(q, step, times + dt) for dt in (-h, 0.0, h))
    for lower in (0, 1):
        slope = (after[lower] - before[lower]) / (2.0 * h)
        assert middle[lower + 1] == pytest.approx(slope, abs=1e-4)


def test_the_first_control_points_meet_the_state():
    p, v, a = np.random.default_rng(3).normal(size=(3, 3))
    q = np.vstack([bspline.boundary(p, v, a, 0.3), curve(3, 4)])
    for got, wanted in zip(bspline.evaluate(q, 0.3, np.zeros(1)), (p, v, a), strict=True):
        assert got[0] == pytest.approx(wanted)


def blobs(seed, shape):
    rng = np.random.default_rng([seed, 5])
    occupied = np.zeros(shape, bool)
    for _ in range(14):
        low = (rng.uniform(0.1, 0.85, len(shape)) * shape).astype(int)
        occupied[tuple(slice(a, a + int(rng.integers(2, 6))) for a in low)] = True
    known = np.ones(shape, bool)
    make = Field2.from_occupied if len(shape) == 2 else Field3.from_occupied
    return make(occupied, known, np.zeros(len(shape)), 0.1)


@pytest.mark.parametrize("shape", [(40, 40), (30, 30, 24)])
@pytest.mark.parametrize("seed", range(4))
def test_the_gradient_of_the_cost_is_its_slope(shape, seed):
    values, origin = raised(blobs(seed, shape))
    rng = np.random.default_rng([seed, 2])
    q = np.cumsum(rng.normal(0.15, 0.12, (12, 3)), axis=0) + 0.4
    if len(shape) == 2:
        q[:, 2] = 0.0
    aims = np.array([0.45, 0.5, 0.3, 0.2, 0.7, 1.0, 30.0, 4.0])
    _, grad = cost(q, 0.25, WEIGHTS, values, origin, 0.1, aims)
    assert np.abs(grad).max() > 1.0
    h, off = 1e-6, 0
    axes = len(shape)
    for i in range(len(q)):
        for k in range(axes):
            pair = []
            for sign in (-1.0, 1.0):
                moved = q.copy()
                moved[i, k] += sign * h
                pair.append(cost(moved, 0.25, WEIGHTS, values, origin, 0.1, aims)[0])
            slope = (pair[1] - pair[0]) / (2.0 * h)
            off += abs(slope - grad[i, k]) > 1e-4 * max(1.0, abs(slope))
    assert off == 0


def test_the_distance_in_the_cost_is_the_fields_own():
    field = blobs(1, (30, 30, 24))
    values, origin = raised(field)
    points = np.random.default_rng(4).uniform(-0.3, 3.2, (60, 3))
    ours = [optimise._distance(values, origin, 0.1, p, np.empty(3)) for p in points]
    assert ours == pytest.approx(field.lookup(points), abs=1e-6)


def test_optimising_lowers_the_cost_and_keeps_the_ends():
    occupied = np.zeros((40, 40), bool)
    occupied[18:22, 15:19] = True
    field = Field2.from_occupied(occupied, np.ones_like(occupied), np.zeros(2), 0.1)
    q = np.zeros((14, 3))
    q[:, 0], q[:, 1] = np.linspace(0.4, 3.6, 14), 1.85
    out = optimised(q, 1.0, field, Aims(0.42, 1.0, math.inf, math.inf, 1.0))
    assert np.array_equal(out[:3], q[:3])
    assert np.array_equal(out[-3:], q[-3:])
    fine = bspline.evaluate(out[:, :2], 1.0, np.linspace(0.0, 11.0, 300))[0]
    before = bspline.evaluate(q[:, :2], 1.0, np.linspace(0.0, 11.0, 300))[0]
    assert field.lookup(before).min() < 0.0
    assert field.lookup(fine).min() > 0.32


@pytest.mark.parametrize("seed", range(5))
def test_a_star_finds_what_dijkstra_finds(seed):
    field = blobs(seed, (60, 60))
    free = field.distance_m > 0.3
    price = cell_cost(field.distance_m, field.known, 0.3, 1.0)
    cells = np.argwhere(free)
    start, goal = cells[0], cells[-1]
    begin = np.ravel_multi_index(tuple(start), free.shape)
    wanted, _ = costs_from(free, price.astype(float), np.array([begin]), np.zeros(1))
    best = wanted[int(np.ravel_multi_index(tuple(goal), free.shape))]
    way, reached, found = astar.search(
        free[:, :, None], price[:, :, None], np.append(start, 0), np.append(goal, 0), 1.0, free.size
    )
    assert reached == np.isfinite(best)
    if reached:
        assert found == pytest.approx(best, rel=1e-5)
        assert np.array_equal(way[0, :2], start)
        assert np.array_equal(way[-1, :2], goal)
        assert np.abs(np.diff(way, axis=0)).max() == 1
        assert free[tuple(way[:, :2].T)].all()


def test_straight_cuts_stay_free_and_cost_no_more():
    field = blobs(2, (60, 60))
    way = astar.way_on_map(field, np.array([0.35, 0.35]), np.array([5.6, 5.6]), 0.3, 0.5)
    assert way is not None
    assert way.reached
    assert len(way.points_m) < 15
    dense = np.vstack([np.linspace(a, b, 60) for a, b in zip(way.points_m, way.points_m[1:], strict=False)])
    assert field.lookup(dense).min() > 0.3 - 0.08  # half a cell of rounding


def test_without_a_way_it_goes_as_near_as_it_can():
    occupied = np.zeros((40, 40), bool)
    occupied[20:22, :] = True
    field = Field2.from_occupied(occupied, np.ones_like(occupied), np.zeros(2), 0.1)
    way = astar.way_on_map(field, np.array([0.5, 2.0]), np.array([3.5, 2.0]), 0.38, 0.5)
    assert way is not None
    assert not way.reached
    assert 1.3 < way.points_m[-1, 0] < 1.7


def test_a_goal_outside_the_map_is_approached_where_the_line_leaves_it():
    free = np.zeros((40, 40), bool)
    field = Field2.from_occupied(free, ~free, np.zeros(2), 0.1)
    way = astar.way_on_map(field, np.array([2.0, 2.0]), np.array([12.0, 7.0]), 0.38, 0.5)
    assert way is not None
    assert way.points_m[-1] == pytest.approx([3.95, 2.975], abs=0.06)


def test_unknown_space_is_as_good_as_free():
    occupied = np.zeros((40, 40), bool)
    known = np.ones_like(occupied)
    known[15:25] = False
    field = Field2.from_occupied(occupied, known, np.zeros(2), 0.1)
    way = astar.way_on_map(field, np.array([0.5, 2.0]), np.array([3.5, 2.0]), 0.38, 0.5)
    assert way is not None
    assert way.points_m[-1] == pytest.approx([3.5, 2.0])
    assert way.cost_m == pytest.approx(3.0, abs=0.15)
