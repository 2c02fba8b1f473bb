"""What hinders driving: on level floors, slopes, steps, drops, and under tables."""

from __future__ import annotations

import math

import numpy as np
import pytest
from floor_scenes import (
    BELOW_M,
    CONFIG,
    FAR,
    LEVEL,
    OPTICS,
    RAYS,
    box,
    clear,
    looked_at,
    mapped,
    plane,
    seen,
    standing,
)

from labr_autonomy.frames import quaternion_from_rpy, rotation_matrix
from labr_autonomy.perception.ground import BELOW, FLOOR, STANDS, scan
from labr_autonomy.perception.rolling_map import RollingMap
from labr_autonomy.types import DepthFrame, Pose


def test_an_even_floor_is_free_as_far_as_it_is_seen():
    field = mapped([LEVEL])
    assert clear(field, 3.0) > 1.0
    assert field.is_known(np.array([[1.0, 0.0], [3.0, 0.5], [-2.0, 0.0]])).tolist() == [True, True, False]


@pytest.mark.parametrize("slope", [0.08, 0.15, 0.25, -0.12])
def test_a_ramp_is_driven_on_and_a_wall_of_its_height_is_not(slope):
    ramp = [plane(-FAR, 1.5, 0.0), plane(1.5, 4.5, 0.0, slope), plane(4.5, FAR, 3.0 * slope)]
    field = mapped(ramp)
    for x in (1.2, 1.6, 2.0, 2.5):
        assert clear(field, x) > 0.4
    wall = mapped([plane(-FAR, 1.5, 0.0), box([1.5, -9.0, 0.0], [9.0, 9.0, 0.3])])
    assert clear(wall, 1.3) < 0.25


@pytest.mark.parametrize("slope", [0.15, 0.3])
def test_on_a_ramp_its_own_floor_is_free_and_a_box_on_it_is_not(slope):
    pitch = -math.atan(slope)
    at = Pose(
        np.array([0.0, 0.0, BELOW_M / math.cos(pitch)]), quaternion_from_rpy(0.0, pitch, 0.0)
    )  # nose up
    floor = plane(-90.0, 90.0, slope * -90.0, slope)
    assert clear(mapped([floor], at), 2.0) > 0.8
    on_it = box([1.5, -0.2, slope * 1.5 - 0.1], [1.7, 0.2, slope * 1.7 + 0.25])
    assert clear(mapped([floor, on_it], at), 1.4) < 0.2


@pytest.mark.parametrize("height", [0.09, 0.15, 0.30])
@pytest.mark.parametrize("x", [0.9, 1.5, 2.2])
def test_a_low_box_is_in_the_way(height, x):
    field = mapped([LEVEL, box([x, -0.15, 0.0], [x + 0.3, 0.15, height])])
    assert clear(field, x - 0.1) == pytest.approx(0.1, abs=0.09)
    assert clear(field, x, 0.6) > 0.3


def test_under_a_table_is_free_and_its_legs_are_not():
    legs = [box([x, y, 0.0], [x + 0.04, y + 0.04, 0.7]) for x in (1.2, 2.0) for y in (-0.6, 0.56)]
    field = mapped([LEVEL, *legs, box([1.1, -0.7, 0.7], [2.1, 0.7, 0.74])], frames=18)
    assert clear(field, 1.4) > 0.35
    for y in (-0.58, 0.58):
        assert clear(field, 1.22, y) < 0.06


def test_the_edge_of_a_drop_is_in_the_way():
    deck = [plane(-FAR, 1.2, 0.0), plane(1.2, FAR, -0.8)]
    field = mapped(deck)
    assert clear(field, 1.5) < 0.15
    assert clear(field, 0.8) > 0.2


def test_a_wall_is_met_to_within_a_cell_and_a_doorway_stays_as_wide_as_it_is():
    walls = [box([2.0, -3.0, 0.0], [2.1, -0.42, 2.0]), box([2.0, 0.42, 0.0], [2.1, 3.0, 2.0])]
    field = mapped([LEVEL, *walls], frames=18)
    assert clear(field, 1.5, 1.0) == pytest.approx(0.5, abs=0.06)
    assert clear(field, 2.05) == pytest.approx(0.42, abs=0.06)


def test_each_return_is_called_what_it_is():
    at = standing()
    things = [plane(-FAR, 1.2, 0.0), plane(1.2, FAR, -0.4), box([1.0, 0.3, 0.0], [1.1, 0.8, 0.5])]
    depth = seen(things, at)
    rotation = rotation_matrix(at.quaternion)
    eye = at.position_m + np.array([CONFIG.camera.x_m, 0.0, CONFIG.camera.z_m])
    optics = (OPTICS.fx, OPTICS.fy, OPTICS.cx, OPTICS.cy, 0.0)
    kinds, floors = scan(depth, optics, rotation, eye, 0.0, (0.0, 0.0), stride=1, first=0, range_m=(0.3, 10))
    places = eye[:, None, None] + depth * np.einsum("ij,jvu->ivu", rotation, RAYS)
    x, _, z = places
    looked = (depth > 0) & (x < 6.0)
    on_box = looked & (z > 0.05) & (x < 1.15)
    floor = looked & (abs(z) < 1e-3)
    lower = looked & (z < -0.35)
    assert (kinds[on_box] == STANDS).mean() > 0.99
    assert (kinds[floor] == FLOOR).mean() > 0.99
    assert (kinds[lower] == BELOW).mean() > 0.99
    assert np.abs(floors[on_box]).max() < 0.05
    assert (kinds[depth == 0] == 0).all()


def test_what_nobody_has_seen_leaves_no_room():
    grid = looked_at([LEVEL, box([1.5, -0.2, 0.0], [1.9, 0.2, 0.27])], standing())
    seen_m, room = grid.land_field(standing(), 0.0), grid.land_room(standing(), 0.0, 4.0)
    for x, y in ((1.68, 0.0), (-1.0, 0.0), (0.3, 1.0)):  # inside the box, behind the robot, beside it
        assert clear(room, x, y) < 0.0 < clear(seen_m, x, y)
    assert clear(room, 1.68, 0.6) > 0.25  # the free floor beside the box stays free
    assert clear(room, 1.0) > 0.3
    assert room.distance_m.shape == (160, 160)


def test_the_floor_about_a_robot_that_was_put_down_is_taken_for_free():
    grid = looked_at([LEVEL, box([0.47, -0.2, 0.0], [0.6, 0.2, 0.3])], standing())
    before = grid.land_room(standing(), 0.0, 2.0)
    grid.assume_free(standing(), 0.2)
    after = grid.land_room(standing(), 0.0, 2.0)
    assert clear(before, 0.0) == pytest.approx(0.3, abs=0.05)
    assert clear(after, -0.05) == pytest.approx(0.45, abs=0.05)
    assert clear(after, 0.48) < 0.05  # but not what was seen to stand there


@pytest.mark.parametrize("pitch", [0.0, 0.06])
def test_a_floor_seen_from_the_air_is_no_obstacle_and_what_stands_on_it_is(pitch):
    rng, grid = np.random.default_rng(3), RollingMap(CONFIG)
    at = Pose(np.array([0.0, 0.0, 1.3]), quaternion_from_rpy(0.0, pitch, 0.0))
    crate = box([4.0, -0.5, 0.0], [4.5, 0.5, 0.4])
    for k in range(20):
        grid.update(DepthFrame(k, 0.1 * k, seen([LEVEL, crate], at, rng), OPTICS), at, 0.0)
    field = grid.land_field(at, 0.0)
    places = np.array([[x, y] for x in np.arange(2.2, 3.4, 0.1) for y in np.arange(-0.8, 0.9, 0.1)])
    assert (field.lookup(places) > 0.3).all()
    assert field.lookup(np.array([[4.05, 0.0]]))[0] < 0.1


def test_gaps_between_rays_are_not_taken_for_obstacles():
    grid = looked_at([LEVEL], standing())
    middle = grid.driving.odds.shape[0] // 2
    grid.driving.odds[middle + 30 : middle + 32, middle - 9 : middle + 9] = 0
    assert clear(grid.land_room(standing(), 0.0, 3.0), 1.5) > 0.5
    grid.driving.odds[middle + 30 : middle + 34, middle - 9 : middle + 9] = 0
    assert clear(grid.land_room(standing(), 0.0, 3.0), 1.6) < 0.0


@pytest.mark.parametrize("gap_m", [0.06, 0.09])
def test_rays_below_a_drawer_do_not_free_its_place(gap_m):
    """As the robot passes, its front leaves the image and the floor beneath it stays in view."""
    drawer, wall = box([1.2, 0.35, gap_m], [1.9, 0.75, 0.66]), box([4.0, -9.0, 0.0], [4.1, 9.0, 2.0])
    rng, grid = np.random.default_rng(4), RollingMap(CONFIG)
    for k, x in enumerate(np.arange(0.0, 1.0, 0.03)):
        at = standing(float(x), yaw=0.4)
        grid.update(DepthFrame(k, 0.1 * k, seen([LEVEL, drawer, wall], at, rng), OPTICS), at, 0.0)
    room = grid.land_room(standing(1.0), 0.0, 3.0)
    front = [[1.2, y] for y in np.arange(0.4, 0.7, 0.05)]
    side = [[x, 0.35] for x in np.arange(1.2, 1.8, 0.05)]
    assert (grid.land_field(standing(1.0), 0.0).lookup(np.array(front + side)) < 0.05).all()
    assert (room.lookup(np.array(front + side)) < 0.05).all()
    assert clear(room, 1.5, 0.0) > 0.2  # and beside it there is room


def test_what_was_only_looked_under_is_not_free():
    """A bed whose frame begins at the camera's height, seen from its end; there is room beside it."""
    bed, wall = box([1.5, 0.2, 0.17], [3.5, 1.6, 0.5]), box([5.0, -9.0, 0.0], [5.1, 9.0, 2.0])
    room = looked_at([LEVEL, bed, wall], standing(), frames=20).land_room(standing(), 0.0, 3.0)
    below = np.array([[x, y] for x in np.arange(1.6, 2.8, 0.1) for y in np.arange(0.3, 1.0, 0.1)])
    assert (room.lookup(below) < 0.03).all()
    assert clear(room, 2.0, -0.3) > 0.4


@pytest.mark.parametrize(("misses", "free"), [(2, False), (4, True)])
def test_a_place_that_few_rays_passed_is_not_free(misses, free):
    """They may have missed the leg of a chair."""
    grid = looked_at([LEVEL], standing())
    layer = grid.driving
    middle = layer.odds.shape[0] // 2
    patch = np.s_[middle + 30 : middle + 36, middle - 3 : middle + 3]
    layer.bands[patch], layer.odds[patch] = -2 * misses, -2 * misses
    assert (clear(grid.land_room(standing(), 0.0, 3.0), 1.65) > 0.0) is free


def test_a_low_box_is_not_forgotten_by_looking_over_it():
    """The floor gives no returns any more, as in glare; the wall behind it does."""
    things = [LEVEL, box([1.3, -0.2, 0.0], [1.6, 0.2, 0.09]), box([4.0, -9.0, 0.0], [4.1, 9.0, 2.0])]
    grid, rng = looked_at(things, standing()), np.random.default_rng(6)
    for k in range(60):
        image = seen(things, standing(), rng)
        image[int(OPTICS.cy) + 10 :] = 0.0
        grid.update(DepthFrame(9 + k, 0.1 * k, image, OPTICS), standing(), 0.0)
    assert clear(grid.land_field(standing(), 0.0), 1.32) < 0.06


def test_what_was_only_looked_over_is_not_free():
    """A door stop may lie in the shadow of another; beside them there is room."""
    low, wall = box([1.3, -0.5, 0.0], [1.4, 0.1, 0.08]), box([5.0, -9.0, 0.0], [5.1, 9.0, 2.0])
    grid = looked_at([LEVEL, low, wall], standing(), frames=20)
    behind = np.array([[x, y] for x in np.arange(1.5, 1.8, 0.1) for y in np.arange(-0.35, -0.05, 0.1)])
    assert (grid.land_room(standing(), 0.0, 3.0).lookup(behind) < 0.05).all()
    assert clear(grid.land_room(standing(), 0.0, 3.0), 1.6, 0.6) > 0.3


def test_a_single_return_is_not_taken_for_free_when_it_is_put_down():
    grid = looked_at([LEVEL], standing())
    layer, middle = grid.driving, grid.driving.odds.shape[0] // 2
    cell = np.s_[middle + 9, middle]  # at 0.45 m
    layer.bands[cell], layer.odds[cell] = 20, 20
    grid.assume_free(standing(), 0.25)
    assert layer.odds[cell] == 20
