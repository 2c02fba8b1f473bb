"""The search against brute force, and its edges."""

from __future__ import annotations

import heapq
import itertools
import math

import numpy as np
import pytest
from refine_rooms import boxes2, random_boxes, shortest_way

from labr_autonomy.clock import SystemClock
from labr_autonomy.refine import search
from labr_autonomy.refine.reference import to_key_points
from labr_autonomy.refine.search import CostToGo


def brute_force(free, price, start, goal):
    """Cost of the cheapest way by a heap and nothing else."""
    best, heap = {start: 0.0}, [(0.0, start)]
    while heap:
        cost, cell = heapq.heappop(heap)
        if cell == goal:
            return cost
        if cost > best[cell]:
            continue
        for dx in (-1, 0, 1):
            for dy in (-1, 0, 1):
                n = (cell[0] + dx, cell[1] + dy)
                if n == cell or not (0 <= n[0] < free.shape[0] and 0 <= n[1] < free.shape[1]) or not free[n]:
                    continue
                c = cost + math.hypot(dx, dy) * 0.5 * (price[cell] + price[n])
                if c < best.get(n, math.inf):
                    best[n] = c
                    heapq.heappush(heap, (c, n))
    return math.inf


def priced(path, field, price):
    fine = np.concatenate(
        [a + np.linspace(0, 1, 200)[:, None] * (b - a) for a, b in itertools.pairwise(path)]
    )
    cells = np.floor((fine - field.origin_m) / field.cell_m).astype(int)
    steps = np.linalg.norm(np.diff(fine, axis=0), axis=1) / field.cell_m
    return float((steps * price[tuple(cells[:-1].T)]).sum())


@pytest.mark.parametrize("seed", range(4))
def test_cost_equals_brute_force_and_the_path_is_free(seed):
    start, goal = (0.85, 5.05), (9.15, 4.05 + seed * 0.5)
    field = boxes2(random_boxes(seed, start, goal, 14), unknown=[(4.0, 2.0, 6.0, 8.0)] if seed % 2 else ())
    distance = field.distance_m.astype(float)
    free = distance > 0.35
    price = search.cell_cost(distance, field.known, 0.35, 2.0)
    a, b = ((int(p[0] / 0.1), int(p[1] / 0.1)) for p in (start, goal))
    wanted = brute_force(free, price, a, b)
    path = shortest_way(field, np.array(start), np.array(goal), 0.35)
    if path is None:
        assert wanted == math.inf
        return
    assert priced(path, field, price) <= wanted * 1.06  # straight cuts may not cost more, up to sampling
    assert np.allclose(path[0], start)
    assert np.allclose(path[-1], goal)
    fine = np.concatenate(
        [p + np.linspace(0, 1, 100)[:, None] * (q - p) for p, q in itertools.pairwise(path)]
    )
    assert field.lookup(fine).min() > 0.35 - 0.08  # cells are judged at their centres


def test_prefers_known_ground_and_open_space():
    wall = [(4.0, 2.0, 5.0, 6.0)]
    low = shortest_way(boxes2(wall), np.array([2.0, 4.0]), np.array([7.0, 4.0]), 0.35)
    assert low is not None
    unknown = boxes2(wall, unknown=[(0.0, 0.0, 10.0, 2.0), (3.0, 0.0, 6.0, 2.0)])
    around = shortest_way(unknown, np.array([2.0, 4.0]), np.array([7.0, 4.0]), 0.35, unknown_cost=10.0)
    assert around is not None
    assert around[:, 1].max() > 6.0
    assert (
        shortest_way(unknown, np.array([2.0, 4.0]), np.array([7.0, 4.0]), 0.35, unknown_cost=1.0) is not None
    )


def test_ends_are_snapped():
    field = boxes2([(4.0, 4.0, 6.0, 6.0)])
    inside = shortest_way(field, np.array([2.0, 5.0]), np.array([4.1, 5.0]), 0.35)
    assert inside is not None
    assert 0.3 < 4.0 - inside[-1, 0] < 0.5
    assert shortest_way(field, np.array([2.0, 5.0]), np.array([5.0, 5.0]), 0.35) is None
    close = shortest_way(field, np.array([3.8, 5.0]), np.array([2.0, 5.0]), 0.35)
    assert close is not None
    assert np.array_equal(close[0], [3.8, 5.0])
    beyond = shortest_way(field, np.array([2.0, 2.0]), np.array([2.0, 30.0]), 0.0)
    assert beyond is None or beyond[-1, 1] < 10.0


def test_no_way_is_none():
    field = boxes2([(4.0, 0.0, 5.0, 10.0)])
    assert shortest_way(field, np.array([2.0, 5.0]), np.array([7.0, 5.0]), 0.35) is None


@pytest.mark.slow
def test_200_by_200_in_the_time_of_one_tick():
    rng = np.random.default_rng(0)
    boxes = [(*c, *(c + rng.uniform(0.3, 1.2, 2))) for c in rng.uniform([2, 1], [17, 18], (25, 2))]
    field = boxes2(boxes, (20.0, 20.0))
    shortest_way(field, np.array([1.0, 1.0]), np.array([19.0, 19.0]), 0.35)  # builds the topology
    took = []
    for _ in range(5):
        began = SystemClock().now_s()
        path = shortest_way(field, np.array([1.0, 1.0]), np.array([19.0, 19.0]), 0.35)
        took.append(SystemClock().now_s() - began)
    assert path is not None
    assert min(took) < 0.1  # 30 ms on an idle machine


def test_key_points_of_a_path():
    path = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 10.0]])
    points = to_key_points(path)
    assert np.allclose(points, [[0.8, 0], [1.6, 0], [2.0, 0.4], [2.0, 1.2], [2.0, 2.0]])
    short = to_key_points(path[:2], spacing_m=0.9)
    assert np.allclose(short, [[0.9, 0], [1.8, 0], [2.0, 0]])
    assert np.allclose(to_key_points(np.array([[1.0, 1.0], [1.2, 1.0]])), [[1.2, 1.0]])


def _rooms_with_a_gap(half_m):
    """Two rooms, and between them a wall at x = 3 with a gap in its middle at y = 2."""
    across = [(3.0, 0.0, 3.1, 2.0 - half_m), (3.0, 2.0 + half_m, 3.1, 4.0)]
    return boxes2(across, (6.0, 4.0))


def test_a_tight_gap_is_a_way_only_when_asked_for_and_is_named():
    field = _rooms_with_a_gap(0.25)
    start, goal = np.array([1.0, 2.3]), np.array([5.0, 1.8])
    assert CostToGo(field, goal, 0.36).path(start) is None
    tight = CostToGo(field, goal, 0.36, tight_m=0.12)
    way = tight.path(start)
    assert way is not None
    gap = tight.first_gap(way)
    assert abs(gap[0] - 3.05) < 0.4
    assert abs(gap[1] - 2.0) < 0.25
    assert CostToGo(field, goal, 0.36, tight_m=0.12, closed=[gap]).path(start) is None


def test_a_wide_gap_is_preferred_to_a_tight_one():
    wide = _rooms_with_a_gap(0.6)
    ways = CostToGo(wide, np.array([5.0, 2.0]), 0.36, tight_m=0.12)
    assert ways.first_gap(ways.path(np.array([1.0, 2.0]))) is None


def round_a_block(goal_y):
    """Ways round a block, above or below, to a goal behind it: as long as each other for 5.0."""
    field = boxes2([(4.0, 2.5, 5.0, 7.5)])
    return CostToGo(field, np.array([7.5, goal_y]), 0.36)


@pytest.mark.parametrize("heading", [-1.2, -0.7, 0.7, 1.2])
def test_of_two_ways_that_are_nearly_as_long_the_one_that_it_looks_along_is_kept(heading):
    start = np.array([2.8, 5.0])
    for goal_y in (4.8, 5.2):
        way = round_a_block(goal_y).path(start, heading, 0.53)
        assert np.sign(way[1][1] - 5.0) == np.sign(heading)
    sides = {np.sign(round_a_block(y).path(start)[1][1] - 5.0) for y in (4.8, 5.2)}
    assert sides == {-1.0, 1.0}  # without the price of a turn it changes its mind


@pytest.mark.parametrize("heading", [-1.2, 1.2])
def test_a_way_that_is_clearly_shorter_is_worth_a_turn(heading):
    way = round_a_block(7.5).path(np.array([2.8, 5.0]), heading, 0.53)
    assert way[1][1] > 5.0


@pytest.mark.parametrize("seed", range(6))
def test_a_way_that_begins_well_is_free_and_dearer_than_the_cheapest_by_no_more_than_it_saves(seed):
    start, goal = np.array([0.85, 5.05]), np.array([9.15, 5.0])
    field = boxes2(random_boxes(seed, start, goal, 14))
    price = search.cell_cost(field.distance_m.astype(float), field.known, 0.35, 2.0)
    ways = CostToGo(field, goal, 0.35)
    for heading in np.linspace(-math.pi, math.pi, 7):
        way = ways.path(start, float(heading), 0.53)
        assert np.allclose(way[[0, -1]], [start, goal])
        fine = np.concatenate(
            [a + np.linspace(0, 1, 99)[:, None] * (b - a) for a, b in itertools.pairwise(way)]
        )
        assert field.lookup(fine).min() > 0.35 - 0.08
        assert 0.1 * priced(way, field, price) < 1.05 * ways.cost_m(start) + 0.53 * 2.0 * math.pi


def test_a_way_does_not_lead_where_it_is_likely_solid_while_there_is_another_but_else_it_does():
    field = boxes2([(4.0, 0.0, 4.2, 7.0)], unknown=[(4.2, 0.0, 10.0, 10.0)])
    likely = np.zeros(field.known.shape, bool)
    likely[60, :] = True
    start, goal = np.array([5.0, 3.0]), np.array([8.0, 3.0])
    behind = CostToGo(field, goal, 0.36, likely=likely)
    assert math.isfinite(behind.cost_m(start))
    likely[60, 50:] = False
    assert CostToGo(field, goal, 0.36, likely=likely).path(start)[:, 1].max() > 5.2
    assert CostToGo(field, goal, 0.36).path(start)[:, 1].max() < 3.5


@pytest.mark.parametrize("seed", range(3))
def test_ways_end_where_they_and_the_offer_together_are_cheapest(seed):
    rng = np.random.default_rng(seed)
    start = (0.85, 5.05)
    field = boxes2(random_boxes(seed, start, (9.15, 4.05), 14))
    free = field.distance_m > 0.35
    offers = np.full(free.shape, np.inf)
    places = np.argwhere(free)[rng.choice(int(free.sum()), 40, replace=False)]
    offers[tuple(places.T)] = rng.uniform(0.0, 30.0, 40)
    ways = CostToGo(field, np.array([20.0, 20.0]), 0.35, offers=offers)
    alone = []
    for cell in places:
        to = CostToGo(field, field.origin_m + (cell + 0.5) * 0.1, 0.35)
        alone.append(to.cost_m(np.array(start)) + offers[tuple(cell)])
    assert ways.cost_m(np.array(start)) == pytest.approx(min(alone), rel=1e-6)
    best = field.origin_m + (places[int(np.argmin(alone))] + 0.5) * 0.1
    assert np.allclose(ways.end(np.array(start)), best)
    assert np.allclose(ways.path(np.array(start))[-1], best)


def test_where_no_offer_can_be_reached_there_is_no_way():
    field = _rooms_with_a_gap(0.2)
    offers = np.full(field.distance_m.shape, np.inf)
    offers[50, 20] = 0.0
    ways = CostToGo(field, np.array([5.0, 2.0]), 0.36, offers=offers)
    assert ways.path(np.array([1.0, 2.0])) is None
    assert ways.end(np.array([1.0, 2.0])) is None
