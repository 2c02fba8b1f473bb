"""Tasks by seed: reproducible, spread, and possible."""

from __future__ import annotations

import math
from dataclasses import asdict

import numpy as np
import pytest
from analytic_worlds import ROBOT, low_wall, rim, rooms_of, standing_at, two_rooms, wall

from labr_autonomy.errors import BadInput
from sim.bench.known import know
from sim.bench.tasks import AIR_CLEAR_M, HEIGHT_M, LAND_CLEAR_M, sample_task

BELOW_M = ROBOT.body.below_m


def spec_of(folder, blocks, **more):
    world = rooms_of(blocks)
    np.savez(folder / "place.npz", V=world.vertices_m, F=world.faces)
    return {"mesh": "place.npz", "scale": 1.0, "worlds_dir": str(folder), **more}


@pytest.fixture(scope="module")
def offices(tmp_path_factory):
    blocks = [*rim(-10, -4, 10, 4), wall(-0.1, -4, 0.1, 1), wall(-0.1, 2.2, 0.1, 4), wall(4, -1, 5, 1, 0.8)]
    return spec_of(tmp_path_factory.mktemp("offices"), blocks)


@pytest.fixture(scope="module")
def drawn(offices):
    return [sample_task(offices, seed, ROBOT) for seed in range(40)]


def test_the_same_seed_gives_the_same_task_and_another_another(offices, drawn):
    know.__globals__["_know"].cache_clear()
    assert asdict(sample_task(offices, 7, ROBOT)) == asdict(drawn[7])
    assert len({task.goal_m for task in drawn}) > 36


def test_every_start_and_goal_is_verified_by_the_surface(offices, drawn):
    known = know(offices, ROBOT)
    surface = known.surface
    for task in drawn:
        x, y, yaw, floor = task.start
        begin = standing_at(x, y, floor)
        assert surface.clearance(begin, on_floor=True) >= LAND_CLEAR_M - 1e-6
        assert surface.floor_below(*begin) == pytest.approx(floor, abs=1e-3)
        eye = begin + np.array([0.14 * math.cos(yaw), 0.14 * math.sin(yaw), 0.06])
        assert surface.sees(eye, eye + 0.6 * np.array([math.cos(yaw), math.sin(yaw), 0.0]))
        goal = np.array(task.goal_m)
        if task.in_air:
            assert surface.clearance(goal) >= AIR_CLEAR_M - 1e-6
            assert HEIGHT_M[0] - 1e-6 <= goal[2] <= HEIGHT_M[1] + 1e-6
        else:
            assert surface.clearance(goal, on_floor=True) >= LAND_CLEAR_M - 1e-6
            assert surface.floor_below(*goal) == pytest.approx(goal[2] - BELOW_M, abs=1e-3)
        assert task.distance_m == pytest.approx(np.linalg.norm(goal - begin))
        assert task.distance_m * 0.98 <= task.shortest_m
        assert 0.0 < task.bound_j < 20_000.0
        assert task.bound_s < task.limit_s


def test_distances_are_spread_kinds_are_halved_and_goals_are_mostly_hidden(drawn):
    away = np.array([task.distance_m for task in drawn])
    assert away.min() >= 4.0
    assert away.max() <= 25.0
    # an even draw from 4.4 to some 18.5 m has its mean at 11.4 m and 4.1 m of spread
    assert away.mean() == pytest.approx(11.4, abs=1.6)
    assert away.std() > 3.2
    flying = np.mean([task.in_air for task in drawn])
    assert 0.33 < flying < 0.67
    seen = np.mean([task.in_sight for task in drawn])
    assert 0.2 < seen < 0.5


def test_in_sight_is_what_the_camera_could_see(offices, drawn):
    surface = know(offices, ROBOT).surface
    for task in drawn:
        x, y, yaw, floor = task.start
        c, s = math.cos(yaw), math.sin(yaw)
        eye = np.array([x + 0.14 * c, y + 0.14 * s, floor + BELOW_M + 0.06])
        dx, dy, dz = np.array(task.goal_m) - eye
        ahead, left = c * dx + s * dy, -s * dx + c * dy
        in_view = ahead > 0 and abs(left) <= ahead and abs(dz) <= ahead * 120 / 212
        assert task.in_sight is bool(in_view and surface.sees(eye, np.array(task.goal_m)))


def test_a_family_is_drawn_from_the_seed():
    one, two = (sample_task({"family": "hall", "size_m": [12, 8]}, seed, ROBOT) for seed in (3, 4))
    assert one.world["seed"] == 3
    assert two.world["seed"] == 4
    assert one.world["family"] == "hall"


def test_start_and_goals_of_a_world_file_are_taken_in_turn(tmp_path):
    spec = spec_of(tmp_path, two_rooms(), start=[-4.0, 0.0, 90.0], goals=[[4.0, 0.0], [3.0, 1.0, 1.5]])
    on_land, in_air = (sample_task(spec, seed, ROBOT) for seed in (4, 5))
    assert on_land.start == pytest.approx((-4.0, 0.0, math.pi / 2, 0.0), abs=1e-6)
    assert on_land.goal_m == pytest.approx((4.0, 0.0, BELOW_M), abs=1e-6)
    assert not on_land.in_air
    assert in_air.goal_m == (3.0, 1.0, 1.5)
    assert in_air.in_air
    assert in_air.world["goals"] == spec["goals"]
    turned = sample_task({**spec, "start": [-4.0, 0.0, 1.0, 0.0]}, 4, ROBOT)
    assert turned.start == pytest.approx((-4.0, 0.0, 1.0, 0.0), abs=1e-6)


def test_bounds_keep_starts_and_goals(tmp_path):
    spec = spec_of(tmp_path, rim(-10, -4, 10, 4), bounds=[[-9.0, -3.0, -0.5], [1.0, 3.0, 2.0]])
    for seed in range(8):
        task = sample_task(spec, seed, ROBOT)
        for x, y, z in ((*task.start[:2], task.start[3]), task.goal_m):
            assert -9.0 <= x <= 1.0
            assert -3.0 <= y <= 3.0
            assert z <= 2.0


def test_some_land_goals_need_a_hop_where_only_flight_joins(tmp_path):
    blocks = [*rim(-8, -3, 8, 3), wall(-0.1, -3, 0.1, 3, 1.0)]
    spec = spec_of(tmp_path, blocks)
    tasks = [sample_task(spec, seed, ROBOT) for seed in range(40)]
    over = [t.start[0] * t.goal_m[0] < 0.0 for t in tasks if not t.in_air]
    assert 0 < sum(over) < 0.35 * len(over)


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"start": [0.0, 0.0, 0.0]}, "cannot stand at the start"),
        ({"start": [-3.0, 0.0]}, "the start of"),
        ({"start": [-3.0, 0.0, 0.0], "goals": [[0.0, 0.0, 0.5]]}, "cannot fly at the goal"),
        ({"start": [-3.0, 0.0, 0.0], "goals": [[0.0, 0.0]]}, "cannot stand at the goal"),
        ({"bounds": [[-3.9, -1.9, 0.0], [-1.0, 1.0, 3.0]]}, "offers no goal"),
        ({"bounds": [[20.0, 20.0, 0.0], [24.0, 24.0, 3.0]]}, "no place to stand"),
    ],
)
def test_a_world_that_offers_no_task_is_refused_in_one_sentence(tmp_path, more, says):
    with pytest.raises(BadInput, match=says):
        sample_task(spec_of(tmp_path, low_wall(), **more), 0, ROBOT)
