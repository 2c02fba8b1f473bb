"""Signed distances against worlds in which they can be written down."""

import numpy as np
import pytest
from training_worlds import (
    BELOW_M,
    box_world,
    cell_middles,
    drop_world,
    place_near,
    ramp_world,
)

from labr_autonomy.gkpn.shards import NO_FLOOR
from sim.training_data.fields import air_truth, land_truth


def signed_to_rectangle(xy, low, high):
    """Distance to an upright block seen from above, negative inside."""
    gap = np.maximum(np.asarray(low) - xy, xy - np.asarray(high))
    return np.linalg.norm(np.maximum(gap, 0.0), axis=-1) + np.minimum(gap.max(axis=-1), 0.0)


@pytest.fixture(scope="module")
def boxed():
    return box_world()


def test_the_distance_on_land_to_a_block_is_that_of_its_outline_from_both_sides(boxed):
    here = place_near(boxed, -3.0, 0.0)
    land = land_truth(boxed, np.array([-2.93, 0.04]), 0.0, here)
    xy = cell_middles(land.corner_m)
    assert np.abs(xy[80, 80] - [-2.93, 0.04]).max() <= 0.1  # the view in the middle
    expected = signed_to_rectangle(xy, (-1.0, -0.5), (1.0, 0.5))
    near = (np.abs(xy[..., 0]) < 2.0) & (np.abs(xy[..., 1]) < 1.5)
    wrong = 0.01 * land.distance_cm[near] - expected[near]
    assert wrong.min() > -0.076  # its sides are on borders of fine cells, and count for both: a diagonal
    assert wrong.max() < 0.01
    assert land.distance_cm[near].min() < -40  # the block's middle is half a metre deep


def test_a_view_far_from_the_place_below_has_the_same_truth_in_the_same_cells(boxed):
    one = land_truth(boxed, np.array([-3.0, 0.0]), 0.0, place_near(boxed, -3.0, 0.0))
    two = land_truth(boxed, np.array([-3.0, 0.0]), 0.0, place_near(boxed, -3.5, 1.2))
    np.testing.assert_array_equal(one.corner_m, two.corner_m)
    near = np.s_[60:140, 60:100]
    assert np.abs(one.distance_cm[near].astype(int) - two.distance_cm[near]).max() <= 1
    np.testing.assert_array_equal(one.floors_cm[near], two.floors_cm[near])


def test_beyond_a_drop_there_is_no_floor_and_no_way():
    known = drop_world()
    land = land_truth(known, np.array([0.0, 0.0]), 0.0, place_near(known, 0.0, 0.0))
    xy = cell_middles(land.corner_m)
    inside = (np.abs(xy[..., 1]) < 2.0) & (xy[..., 0] > 0.0) & (xy[..., 0] < 5.0)
    wrong = 0.01 * land.distance_cm - np.clip(2.0 - xy[..., 0], -1.27, 1.27)
    side = np.abs(xy[..., 1]) < 1.5
    assert np.abs(wrong[inside & side]).max() < 0.06
    beyond = inside & (xy[..., 0] > 2.1)
    assert (land.floors_cm[beyond] == NO_FLOOR).all()
    assert (land.floors_cm[inside & (xy[..., 0] < 1.9)] == 0).all()


def test_a_ramp_is_no_obstacle_its_height_is_known_and_a_block_on_it_is_one():
    known = ramp_world()
    land = land_truth(known, np.array([-1.0, 0.0]), 0.0, place_near(known, -1.0, 0.0))
    xy = cell_middles(land.corner_m)
    on_ramp = (
        (xy[..., 0] > 0.1) & (xy[..., 0] < 5.8) & (np.abs(xy[..., 1]) > 0.7) & (np.abs(xy[..., 1]) < 2.8)
    )
    assert (land.distance_cm[on_ramp] > 5).all()
    assert np.abs(land.floors_cm[on_ramp] - 10.0 * xy[..., 0][on_ramp]).max() <= 1.0
    inside = (np.abs(xy[..., 0] - 3.5) < 0.4) & (np.abs(xy[..., 1]) < 0.4)
    assert (land.distance_cm[inside] < 0).all()
    up = land_truth(known, np.array([2.0, 0.0]), 0.2, place_near(known, 2.0, 0.0))
    at = cell_middles(up.corner_m)
    low = (at[..., 0] > -3.0) & (at[..., 0] < -0.2) & (np.abs(at[..., 1]) < 2.0)
    assert (up.floors_cm[low] == -20).all()  # counted from the floor under the robot


def test_the_distance_in_the_air_is_exact_near_the_block_and_negative_in_it_and_under_the_floor(boxed):
    air = air_truth(boxed)
    air_cm, origin_m, cell_m = air.distance_cm, air.origin_m, air.cell_m
    shape = air_cm.shape
    index = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1)
    p = origin_m + (index + 0.5) * cell_m
    over = (p[..., 2] > 0.0) & (np.abs(p[..., 0]) < 5.5) & (np.abs(p[..., 1]) < 3.5)
    gap = np.abs(p - [0.0, 0.0, 0.6]) - [1.0, 0.5, 0.6]
    to_block = np.linalg.norm(np.maximum(gap, 0.0), axis=-1)
    to_surface = np.minimum(to_block, np.abs(p[..., 2]))
    outside = over & (gap.max(axis=-1) > 0.0)
    near = outside & (to_surface < 0.34)
    assert np.abs(0.01 * air_cm[near] - to_surface[near]).max() < 0.006
    far = outside & (to_surface < 1.1)
    assert np.abs(0.01 * air_cm[far] - to_surface[far]).max() < 0.093  # half a voxel's diagonal, and rounding
    out_of_it = np.stack([1.0 - np.abs(p[..., 0]), 0.5 - np.abs(p[..., 1]), 1.2 - p[..., 2]], axis=-1)
    deep = out_of_it.min(axis=-1)  # not through its bottom: there is no free space below
    inside = over & (deep > 0.02)
    assert (air_cm[inside] < 0).all()
    assert np.abs(0.01 * air_cm[inside] + deep[inside]).max() < 0.06
    assert air_cm[inside].min() < -35
    assert (air_cm[(p[..., 2] < -0.02) & over_xy(p)] < 0).all()


def over_xy(p):
    return (np.abs(p[..., 0]) < 5.5) & (np.abs(p[..., 1]) < 3.5)


def test_a_straight_line_through_the_block_meets_negative_distances(boxed):
    air = air_truth(boxed)
    air_cm, origin_m, cell_m = air.distance_cm, air.origin_m, air.cell_m
    x = np.linspace(-3.0, 3.0, 121)
    line = np.column_stack([x, np.zeros_like(x), np.full_like(x, 0.5 + BELOW_M)])
    at = np.floor((line - origin_m) / cell_m).astype(int)
    values = air_cm[tuple(at.T)]
    assert (values[np.abs(x) < 0.85] < 0).all()
    assert (values[np.abs(x) > 1.15] > 0).all()
