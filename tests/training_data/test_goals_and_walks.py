"""Goals and walks in small worlds: nothing beyond what parts them, and the robot lies as the floor does."""

import math

import numpy as np
import pytest
from training_worlds import BELOW_M, ROBOT, block, drop_world, known_of, place_near, ramp_world

from labr_autonomy.frames import level_to_odom, quaternion_from_rpy
from labr_autonomy.types import Mode, Pose
from sim.training_data.build import FLIGHT_M, LAYER_HALF_M
from sim.training_data.fields import air_truth, land_truth
from sim.training_data.goals import draw_goals
from sim.training_data.walks import Stop, Walker
from sim.worlds.meshes import flat


def standing(known, x, y, yaw=0.0):
    place = place_near(known, x, y)
    number = int(np.linalg.norm(known.places_m - place, axis=1).argmin())
    pose = Pose(place, quaternion_from_rpy(0.0, 0.0, yaw))
    reach = int(known.free.land.reach[number])
    return Stop(pose, (0.0, 0.0, yaw), float(place[2]) - BELOW_M, Mode.LAND, reach, view=True)


def hovering(known, x, y, z):
    cell = int(np.linalg.norm(known.cells_m - [x, y, z], axis=1).argmin())
    pose = Pose(known.cells_m[cell], quaternion_from_rpy(0.0, 0.0, 0.0))
    floor = float(known.cells_m[cell, 2] - known.cells_height_m[cell])
    return Stop(pose, (0.0, 0.0, 0.0), floor, Mode.AIR, int(known.cells_reach[cell]), view=True)


def layer_of(known, stop):
    """The layer of the air in which ways are measured, as `build` takes it."""
    place = stop.pose.position_m
    z_m = place[2] if stop.mode is Mode.AIR else stop.floor_z_m + FLIGHT_M
    return air_truth(known).layer(place[:2], float(z_m), LAYER_HALF_M)


def goals_of(known, stop, count=16, turns=6):
    """Goals in odom (n, 3), and whether they are in the air and hard, over several draws."""
    place = place_near(known, *stop.pose.position_m[:2])
    land = land_truth(known, stop.pose.position_m[:2], stop.floor_z_m, place)
    found = [
        draw_goals(known, stop, land, layer_of(known, stop), count, np.random.default_rng(seed), ROBOT)
        for seed in range(turns)
    ]
    odom = np.concatenate([level_to_odom(goals.level_m, stop.pose) for goals in found])
    return odom, np.concatenate([g.in_air for g in found]), np.concatenate([g.hard for g in found])


@pytest.fixture(scope="module")
def parted():
    """Two halves that a wall up to beyond the greatest height of flight keeps apart, all walled in."""
    walls = [block(x, -3, x + 0.2, 3, 0, 3.6) for x in (-5.2, -0.1, 5.0)]
    walls += [block(-5.2, y, 5.2, y + 0.2, 0, 3.6) for y in (-3.2, 3.0)]
    return known_of(flat((-5.2, -3.2), (5.2, 3.2), 0.0), *walls)


def test_no_goal_lies_where_no_way_leads(parted):
    goals, in_air, _ = goals_of(parted, standing(parted, -3.5, 0.0))
    assert in_air.sum() == len(in_air) // 2
    assert (goals[:, 0] < -0.4).all()


def test_land_goals_stay_on_what_can_be_driven_to_and_air_goals_do_not():
    known = drop_world()
    goals, in_air, _ = goals_of(known, standing(known, -1.0, 0.0))
    assert (goals[~in_air, 0] < 1.8).all()
    assert (goals[in_air, 0] > 2.0).any()


def test_a_flying_robot_gets_land_goals_on_the_floor_below_it():
    known = drop_world()
    stop = hovering(known, 3.5, 0.0, 0.5)
    assert stop.floor_z_m == pytest.approx(-1.0, abs=1e-6)
    goals, in_air, hard = goals_of(known, stop)
    assert (~in_air).sum() == len(in_air) // 2
    assert np.abs(goals[~in_air, 2] - (-1.0 + BELOW_M)).max() < 0.051
    assert (goals[~in_air, 0] > 2.2).all()
    assert not hard[~in_air].any()  # nothing stands between


def test_half_of_the_goals_are_behind_the_block_where_there_is_one():
    known = known_of(flat((-6, -4), (6, 4), 0.0), block(-1.0, -1.5, 0.0, 1.5, 0.0, 2.0))
    goals, in_air, hard = goals_of(known, standing(known, -3.0, 0.0))
    for kind in (in_air, ~in_air):
        assert 0.35 < hard[kind].mean() < 0.65
    behind = np.abs(goals[:, 1]) < 0.7
    assert hard[behind & ~in_air & (goals[:, 0] > 0.5)].all()
    assert not hard[(goals[:, 0] < -1.4)].any()


def test_without_any_place_for_a_goal_there_is_none():
    walls = [block(x, -0.8, x + 0.2, 0.8, 0, 3.6) for x in (-0.9, 0.7)]
    walls += [block(-0.9, y, 0.9, y + 0.2, 0, 3.6) for y in (-0.9, 0.7)]
    known = known_of(flat((-0.9, -0.9), (0.9, 0.9), 0.0), *walls)
    stop = standing(known, 0.0, 0.0)
    land = land_truth(known, stop.pose.position_m[:2], 0.0, stop.pose.position_m)
    assert draw_goals(known, stop, land, None, 4, np.random.default_rng(1), ROBOT) is None


def test_on_a_ramp_the_robot_lies_as_the_ramp_does():
    known = ramp_world()
    walker = Walker(known, ROBOT, np.random.default_rng(2))
    stops = [stop for _ in range(25) for stop in walker.walk(flying=False)]
    # nowhere near the foot of the ramp, its block or the sides
    x, y, z = np.array([stop.pose.position_m for stop in stops]).T
    steep = (x > 0.5) & (x < 2.4) & (np.abs(y) < 2.5) & (np.array([s.mode is Mode.LAND for s in stops]))
    assert steep.sum() > 100
    np.testing.assert_allclose(z[steep], 0.1 * x[steep] + BELOW_M, atol=2e-3)
    roll, pitch, yaw = np.array([stop.rpy_rad for stop in stops])[steep].T
    slope = math.atan(0.1)
    assert np.abs(pitch + slope * np.cos(yaw)).max() < math.radians(3.2)
    assert np.abs(roll + slope * np.sin(yaw)).max() < math.radians(3.2)
    assert abs((pitch + slope * np.cos(yaw)).mean()) < math.radians(0.5)


def test_a_walk_in_a_narrow_corridor_keeps_off_its_walls():
    walls = [block(-6, y, 6, y + 0.2, 0, 3.6) for y in (-0.75, 0.55)] + [block(-6.2, -0.75, -6, 0.75, 0, 3.6)]
    known = known_of(flat((-6.2, -0.75), (6, 0.75), 0.0), *walls)
    walker = Walker(known, ROBOT, np.random.default_rng(2))
    for flying in (False, True):
        stops = [stop for _ in range(20) for stop in walker.walk(flying)]
        assert len(stops) > 300
        assert {stop.mode for stop in stops} == {Mode.AIR if flying else Mode.LAND}
        y = np.array([stop.pose.position_m[1] for stop in stops])
        assert np.abs(y).max() < 0.55 - 0.3 - 0.02
        assert np.abs(y).max() > 0.1  # but not all in the middle


def test_a_walk_begins_looking_anywhere_and_then_along_the_way(parted):
    walker = Walker(parted, ROBOT, np.random.default_rng(4))
    walks = [walk for walk in (walker.walk(flying=False) for _ in range(30)) if walk]
    first = np.array([walk[0].rpy_rad[2] for walk in walks])
    assert np.hypot(np.cos(first).mean(), np.sin(first).mean()) < 0.5
    off = []
    for walk in walks:
        moved = np.diff([stop.pose.position_m[:2] for stop in walk], axis=0)
        going = np.linalg.norm(moved, axis=1) > 0.1
        yaw = np.array([stop.rpy_rad[2] for stop in walk])[1:]
        off.append(np.abs(np.angle(np.exp(1j * (np.arctan2(moved[:, 1], moved[:, 0]) - yaw))))[going])
    assert np.median(np.concatenate(off)) < math.radians(25)


def test_a_goal_far_round_is_left_to_the_map_and_one_over_a_low_wall_is_not():
    walls = [block(x, -6, x + 0.2, 6, 0, 3.6) for x in (-3.2, 6.0)]
    walls += [block(-3.2, y, 6.2, y + 0.2, 0, 3.6) for y in (-6.2, 6.0)]
    room = flat((-3.2, -6.2), (6.2, 6.2), 0.0)
    high = known_of(room, *walls, block(1.0, -5.0, 1.2, 6.0, 0, 3.6))  # open at its southern end alone
    low = known_of(room, *walls, block(1.0, -5.0, 1.2, 6.0, 0, 0.6))
    beyond = {}
    for name, known in (("high", high), ("low", low)):
        goals, in_air, _ = goals_of(known, standing(known, -0.5, 3.0))
        near = (goals[:, 0] > 1.3) & (goals[:, 1] > 1.0)  # behind the wall, a long way round
        beyond[name] = int((near & ~in_air).sum()), int((near & in_air).sum())
    assert beyond["high"] == (0, 0)
    assert beyond["low"][0] == 0
    assert beyond["low"][1] > 3
