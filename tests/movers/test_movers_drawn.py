"""Tracks that are drawn: by seed, across the way, clear of walls, start, goals and each other."""

import itertools

import numpy as np
import pytest
from movers_rig import BODY, CONFIG

from sim.bench.tasks import sample_task
from sim.movers.draw import PASS_M, SPEED_MPS, START_CLEAR_M, TURN_S, WALL_M, draw_movers
from sim.movers.mover import Mover
from sim.movers.place import movers_for
from sim.movers.way import likely_way
from sim.worlds.build import build_world
from sim.worlds.free_space import FreeSpace
from sim.worlds.surface import Surface

PLACES = [(-4.5, -3.0, BODY.below_m), (4.5, 3.0, BODY.below_m)]


@pytest.fixture(scope="module")
def hall():
    world = build_world({"family": "hall", "size_m": [12, 9]}, seed=5, clear_m=PLACES)
    surface = Surface(world, BODY)
    return world, surface, FreeSpace(world, surface, CONFIG)


@pytest.fixture(scope="module")
def drawn(hall):
    world, surface, free = hall
    return [movers_for(4, seed, PLACES, world, surface, CONFIG, free=free) for seed in range(6)]


def test_the_way_leads_from_start_to_goal_over_the_floor(hall):
    way = likely_way(hall[2].land, PLACES, BODY.below_m)
    assert np.hypot(*(way[0, :2] - PLACES[0][:2])) < 0.1
    assert np.hypot(*(way[-1, :2] - PLACES[1][:2])) < 0.1
    assert np.linalg.norm(np.diff(way[:, :2], axis=0), axis=1).max() < 0.15
    direct = np.hypot(9.0, 6.0)
    assert direct <= np.linalg.norm(np.diff(way, axis=0), axis=1).sum() < 1.4 * direct


def test_the_way_ends_below_a_goal_in_the_air_and_where_the_floor_does(hall):
    way = likely_way(hall[2].land, [PLACES[0], (4.5, 3.0, 1.6)], BODY.below_m)
    assert np.hypot(*(way[-1, :2] - PLACES[1][:2])) < 0.15
    way = likely_way(hall[2].land, [PLACES[0], (40.0, 3.0, 1.6)], BODY.below_m)
    assert 5.0 < way[-1, 0] < 6.0
    assert len(likely_way(hall[2].land, [(40.0, 3.0, 1.6), PLACES[0]], BODY.below_m)) == 0


def test_the_same_seed_draws_the_same_and_another_other_ones(hall, drawn):
    world, surface, free = hall
    assert movers_for(4, 2, PLACES, world, surface, CONFIG, free=free) == drawn[2]
    assert drawn[2] != drawn[3]
    kinds = {m.shape.kind for movers in drawn for m in movers}
    assert kinds == {"person", "box"}
    assert sum(len(movers) for movers in drawn) >= 12


def test_tracks_are_clear_of_walls_all_along(hall, drawn):
    world = hall[0]
    for mover in itertools.chain(*drawn):
        radius, height = mover.shape.radius_m, mover.shape.height_m
        outline = BODY.model_copy(
            update={"radius_m": radius, "below_m": 0.5 * height - 0.1, "above_m": 0.5 * height}
        )
        exact = Surface(world, outline)
        for along in np.linspace(0.0, mover.length_m, 30):
            at = mover.at(along)
            assert at.floor_z_m == pytest.approx(0.0, abs=1e-3)
            middle = np.array([at.x_m, at.y_m, 0.5 * height])
            assert exact.clearance(middle) >= WALL_M - 0.03  # between two of the steps that were looked at


def test_tracks_cross_the_way_and_pause_only_where_they_leave_it_free(hall, drawn):
    way = likely_way(hall[2].land, PLACES, BODY.below_m)
    for mover in itertools.chain(*drawn):
        track = np.array([[at.x_m, at.y_m] for at in map(mover.at, np.linspace(0, mover.length_m, 60))])
        gaps = np.hypot(*(track[:, None] - way[None, :, :2]).transpose(2, 0, 1)).min(axis=1)
        assert gaps.min() < 0.1
        room = mover.shape.radius_m + BODY.radius_m + PASS_M
        passable = [gaps[end] >= room - 1e-6 for end in (0, -1)]
        assert any(passable)
        assert [pause > TURN_S for pause in mover.pauses_s] == passable
        for place in PLACES:
            assert np.hypot(*(track - place[:2]).T).min() >= START_CLEAR_M + mover.shape.radius_m - 0.05
        assert SPEED_MPS[0] <= mover.speed_mps <= SPEED_MPS[1]


def test_movers_never_meet(drawn):
    for movers in drawn:
        for a, b in itertools.combinations(movers, 2):
            along_a, along_b = (np.linspace(0.0, m.length_m, 40) for m in (a, b))
            pa = np.array([[p.x_m, p.y_m] for p in map(a.at, along_a)])
            pb = np.array([[p.x_m, p.y_m] for p in map(b.at, along_b)])
            gap = np.hypot(*(pa[:, None] - pb[None]).transpose(2, 0, 1)).min()
            assert gap > a.shape.radius_m + b.shape.radius_m


def test_without_room_there_are_fewer(hall):
    world, surface, free = hall
    short = likely_way(free.land, [PLACES[0], (-3.9, -3.0, BODY.below_m)], BODY.below_m)
    assert draw_movers(5, 1, short, PLACES, surface, BODY) == ()
    assert movers_for(0, 1, PLACES, world, surface, CONFIG) == ()


def test_a_task_with_movers_is_the_same_task():
    spec = {"family": "indoor"}
    plain, crossed = (sample_task(s, 7, CONFIG) for s in (spec, {**spec, "movers": 3}))
    assert 1 <= len(crossed.movers) <= 3
    assert plain.movers == ()
    assert (plain.world, plain.start, plain.goal_m) == (crossed.world, crossed.start, crossed.goal_m)
    assert all(Mover.from_dict(m).as_dict() == m for m in crossed.movers)
