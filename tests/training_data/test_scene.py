"""One scene: views, goals and maps, looked at again with the surface itself."""

from dataclasses import fields

import numpy as np
import pytest
from training_worlds import ROBOT, cell_middles

from labr_autonomy.frames import level_to_odom, quaternion_from_rpy
from labr_autonomy.gkpn.local_map import BEHIND_M, CELL_M, CHANNELS, SIDE
from labr_autonomy.gkpn.shards import NO_FLOOR
from labr_autonomy.types import Mode, Pose
from sim.bench.known import know
from sim.training_data.build import SceneConfig, build_scene, scene_spec
from sim.training_data.goals import BEARING_RAD, DISTANCE_M
from sim.training_data.walks import Walker

SPEC = {"family": "garage", "seed": 1_000_004, "difficulty": 0.5, "size_m": [22.0, 18.0]}
SEED = 1_000_004
VIEWS = 40
BELOW_M = ROBOT.body.below_m
UP = np.array([0.0, 0.0, 0.3])

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def known():
    return know({**SPEC, "clear_m": []}, ROBOT)


@pytest.fixture(scope="module")
def shard():
    return build_scene("garage", {**SPEC, "clear_m": []}, SEED, SceneConfig(views=VIEWS), ROBOT)


def pose_of(row):
    x, y, z, yaw, roll, pitch = (float(v) for v in row)
    return Pose(np.array([x, y, z]), quaternion_from_rpy(roll, pitch, yaw))


def each_goal(shard):
    for v in range(len(shard.poses)):
        pose = pose_of(shard.poses[v])
        goals = level_to_odom(shard.goals_m[v].astype(float), pose)
        yield from ((v, pose, goals[k], shard.in_air[v, k], shard.hard[v, k]) for k in range(len(goals)))


def on_the_floor(known, point):
    """The point at driving height over the floor right below, and that floor's slope."""
    x, y, z = (float(v) for v in point)
    floor = known.surface.floor_below(x, y, z + 0.1)
    return np.array([x, y, floor + BELOW_M]), known.surface.floor_slope(x, y, floor + BELOW_M)


def test_every_land_goal_is_a_place_to_stand_and_every_air_goal_one_to_hover_at(known, shard):
    too_low_m = []
    for _, _, goal, in_air, _ in each_goal(shard):
        if in_air:
            assert known.surface.clearance(goal) > 0.045
            continue
        place, slope = on_the_floor(known, goal)
        assert -0.051 <= goal[2] - place[2] <= 0.021  # tilted floors waver
        too_low_m.append(place[2] - goal[2])
        assert known.surface.clearance(place, on_floor=True, slope=slope) > 0.03
    assert np.percentile(too_low_m, [10, 90]) == pytest.approx([0.005, 0.045], abs=0.01)


def test_a_way_leads_to_every_goal(known, shard):
    rng = np.random.default_rng(5)
    everything = list(each_goal(shard))
    for n in rng.choice(len(everything), 25, replace=False):
        v, pose, goal, in_air, _ = everything[n]
        flying = shard.floor_m[v] < -0.1
        end = goal if in_air else on_the_floor(known, goal)[0]
        route = known.router.route(pose.position_m, end, start_in_air=bool(flying), goal_in_air=bool(in_air))
        assert route is not None


def test_distances_and_bearings_are_as_asked(shard):
    away = np.hypot(shard.goals_m[..., 0], shard.goals_m[..., 1])
    bearing = np.abs(np.arctan2(shard.goals_m[..., 1], shard.goals_m[..., 0]))
    in_air_jitter = 0.08 * np.sqrt(2)
    assert away.min() > DISTANCE_M[0] - in_air_jitter
    assert away.max() < DISTANCE_M[1] + in_air_jitter
    assert bearing.max() < BEARING_RAD + 0.15
    assert (away > 4.0).mean() > 0.2
    assert (bearing > 0.25 * np.pi).mean() > 0.1  # outside the camera's view


@pytest.fixture(scope="module", params=["garage", "rooms"])
def scene(request, known, shard):
    if request.param == "garage":
        return known, shard
    spec = {"family": "rooms", "seed": SEED, "difficulty": 0.7, "size_m": [12.0, 9.0], "clear_m": []}
    return know(spec, ROBOT), build_scene("rooms", spec, SEED, SceneConfig(views=VIEWS), ROBOT)


def test_the_straight_line_to_a_hard_goal_meets_something_and_to_an_easy_one_nothing(scene):
    known, shard = scene
    surface, seen = known.surface, np.zeros((2, 2), int)
    for v, pose, goal, in_air, hard in each_goal(shard):
        here = pose.position_m
        end = goal if in_air else on_the_floor(known, goal)[0]
        line = here + np.linspace(0.0, 1.0, 200)[1:, None] * (end - here)
        flown = in_air or shard.floor_m[v] < -0.1
        if flown:
            least = min(surface.clearance(p, on_floor=True, reach_m=0.3) for p in line)
            assert (least < 0.021) if hard else (least > -0.03)  # samples are finer here
        else:
            driven = [on_the_floor(known, p + UP) for p in line]
            least = min(surface.clearance(p, on_floor=True, slope=s, reach_m=0.3) for p, s in driven)
            off = np.abs(np.diff([p[2] for p, _ in driven])).max() > 0.06  # a drop, or the roof of a car
            beside = hard and any(overhangs(known, p) for p, _ in driven)
            assert (least < 0.08 or off or beside) if hard else (least > -0.03 and not off)
        seen[int(flown), int(hard)] += 1
    assert (seen > 10).all()


def overhangs(known, place):
    """Whether the outline reaches beyond a drop, or nearly."""
    turn = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    round_it = place[:2] + 0.36 * np.column_stack([np.cos(turn), np.sin(turn)])
    floors = known.surface.floors_below(round_it, place[2])
    return bool((np.abs(floors - (place[2] - BELOW_M)) > 0.055).any())


def test_the_robot_stands_on_the_floor_or_flies_clear_of_everything(known, shard):
    flying = shard.floor_m < -0.1
    assert 0 < flying.sum() < VIEWS
    for v in range(VIEWS):
        pose = pose_of(shard.poses[v])
        if flying[v]:
            assert known.surface.clearance(pose.position_m) > 0.0
        else:
            assert shard.floor_m[v] == pytest.approx(0.0, abs=1e-6)
            place, slope = on_the_floor(known, pose.position_m)
            assert place[2] == pytest.approx(pose.position_m[2], abs=1e-4)
            assert known.surface.clearance(place, on_floor=True, slope=slope) > 0.02


def test_the_land_field_agrees_with_the_surface_where_the_robot_could_stand(known, shard):
    rng = np.random.default_rng(8)
    standing = np.flatnonzero(shard.floor_m > -0.1)
    stands = collides = 0
    for v in standing[:: max(1, len(standing) // 6)]:
        xy = cell_middles(shard.land_corner_m[v].astype(float))
        floor_z = float(shard.poses[v, 2]) - BELOW_M
        for i, j in rng.integers(20, 140, (60, 2)):
            height = shard.floors_cm[v, i, j]
            if height == NO_FLOOR or abs(int(shard.land_cm[v, i, j]) - 30) < 8:
                continue
            place, slope = on_the_floor(known, [*xy[i, j], floor_z + 0.01 * height + BELOW_M])
            clear = known.surface.clearance(place, on_floor=True, slope=slope)
            if shard.land_cm[v, i, j] > 30:
                assert clear > 0.0
                stands += 1
            elif shard.land_cm[v, i, j] > 0:
                assert clear < 0.09 or near_edge(shard.floors_cm[v], i, j)
                collides += 1
    assert stands > 50
    assert collides > 3


def near_edge(floors, i, j):
    return (floors[max(i - 5, 0) : i + 6, max(j - 5, 0) : j + 6] == NO_FLOOR).any()


def test_the_map_is_almost_empty_at_first_and_then_knows_what_lies_behind(shard):
    maps = np.unpackbits(shard.maps, axis=2).reshape(VIEWS, CHANNELS, SIDE, SIDE)
    seen = maps[:, 1].reshape(VIEWS, -1).mean(axis=1)
    behind = maps[:, 1, : int(BEHIND_M / CELL_M) - 4].reshape(VIEWS, -1).mean(axis=1)
    assert behind[0] == 0.0
    assert seen[0] < np.median(seen)
    assert not maps[0, 0::2].any()  # one picture alone proves no obstacle
    assert maps[1:, 0::2].any()
    here = int(BEHIND_M / CELL_M), SIDE // 2
    stands = shard.floor_m > -0.1
    assert maps[stands, 1, *here].all()  # its own place, which no camera sees
    assert not maps[stands, 0, *here].any()
    assert (behind > 0.05).sum() > VIEWS // 4


def test_images_are_millimetres_within_the_cameras_range(shard):
    assert shard.images_mm.shape == (VIEWS, 90, 160)
    valid = shard.images_mm > 0
    assert 0.3 < valid.mean() < 0.99
    assert shard.images_mm[valid].min() >= 290
    assert shard.images_mm.max() <= 10_000


def test_the_same_seed_gives_the_same_arrays_and_another_seed_others(shard):
    few = SceneConfig(views=6, goals=4)
    one, two, three = (build_scene("garage", {**SPEC, "clear_m": []}, s, few, ROBOT) for s in (7, 7, 8))
    for field in fields(one):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(two, field.name))
    assert not np.array_equal(one.poses, three.poses)
    assert not np.array_equal(one.images_mm, three.images_mm)


def test_a_seed_draws_family_and_difficulty():
    places = {name: {"family": name} for name in ("rooms", "hall", "forest")}
    drawn = [scene_spec(places, seed) for seed in range(60)]
    assert {name for name, _ in drawn} == set(places)
    hardness = [spec["difficulty"] for _, spec in drawn if "difficulty" in spec]
    assert min(hardness) >= 0.2
    assert max(hardness) <= 0.9
    assert max(hardness) - min(hardness) > 0.4
    assert all(spec["seed"] == seed for seed, (_, spec) in enumerate(drawn))
    assert scene_spec(places, 17) == scene_spec(places, 17)


def test_a_walk_goes_on_without_jumps_and_flies_where_it_is_said_to(known):
    walker = Walker(known, ROBOT, np.random.default_rng(3))
    walks = [(flying, walker.walk(flying)) for flying in (False, True) * 6]
    assert sum(bool(walk) for _, walk in walks) > 8
    for flying, walk in walks:
        if not walk:
            continue
        assert walk[0].view
        assert walk[0].mode is walk[-1].mode is (Mode.AIR if flying else Mode.LAND)
        steps = np.linalg.norm(np.diff([s.pose.position_m for s in walk], axis=0), axis=1)
        assert np.median(steps) < 0.35
        views = sum(s.view for s in walk)
        assert len(walk) / 6 - 1 <= views <= len(walk) / 4 + 1
