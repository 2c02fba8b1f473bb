"""Where a robot can be, against closed forms and against the surface's exact answers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from analytic_worlds import (
    ROBOT,
    distance_to_blocks,
    free_space,
    low_wall,
    ramp_world,
    rim,
    rooms_of,
    sheet,
    standing_at,
    table_world,
    two_rooms,
    wall,
    world_of,
)
from test_mesh_worlds import SHARED

from sim.worlds.build import build_world
from sim.worlds.free_kernels import voxelise
from sim.worlds.free_layers import AIR_MARGIN_M, LAND_MARGIN_M
from sim.worlds.surface import Surface
from sim.worlds.world import make_world

SPHERE_M = math.hypot(ROBOT.body.radius_m, ROBOT.body.above_m)


@pytest.fixture(scope="module")
def rooms():
    blocks = two_rooms()
    return blocks, free_space(rooms_of(blocks))


def test_a_place_is_free_exactly_where_the_walls_are_far_enough(rooms):
    blocks, free = rooms
    land = free.land
    i, j = np.indices(land.shape)
    xy = land.origin_m + (np.stack([i, j], axis=-1).reshape(-1, 2) + 0.5) * land.cell_m
    gap = distance_to_blocks(xy, blocks) - ROBOT.body.radius_m - LAND_MARGIN_M
    inside = (np.abs(xy) < [6, 3]).all(axis=1)
    clear = np.abs(gap) > 1e-4
    stands = np.diff(land.starts) == 1
    ours = inside & clear
    assert ours.sum() > 6000
    assert (stands[ours] == (gap[ours] > 0)).all()
    assert set(np.diff(land.starts)[inside]) == {0, 1}  # nothing inside the walls, no second floor


def test_a_cell_is_free_exactly_where_the_sphere_fits(rooms):
    blocks, free = rooms
    air = free.air
    cells = np.argwhere(np.ones(air.free.shape, bool))
    centres = air.centres_m(cells)
    gap = np.minimum(distance_to_blocks(centres, blocks), np.abs(centres[:, 2])) - SPHERE_M - AIR_MARGIN_M
    low = (centres[:, 2] > 0.0) & (centres[:, 2] <= ROBOT.air.height_max_m)
    within = (np.abs(centres[:, :2]) < [6, 3]).all(axis=1)
    clear = np.abs(gap) > 1e-4
    ours = within & clear
    assert ours.sum() > 20000
    assert (air.free.ravel()[ours] == (low & (gap > 0))[ours]).all()
    assert np.unique(air.reach[air.free & within.reshape(air.free.shape)]).size == 1


def test_a_door_joins_two_rooms_and_a_narrow_one_does_not(rooms):
    _, free = rooms
    land = free.land
    left, right = (land.nearest(np.array([x, 0.0]), 0.0, 0.1) for x in (-3.0, 3.0))
    assert land.island[left] == land.island[right]
    narrow = free_space(rooms_of(two_rooms(door_m=0.55))).land
    left, right = (narrow.nearest(np.array([x, 0.0]), 0.0, 0.1) for x in (-3.0, 3.0))
    assert narrow.island[left] != narrow.island[right]


def test_a_low_wall_parts_the_land_and_not_the_air():
    land = free_space(rooms_of(low_wall())).land
    left, right = (land.nearest(np.array([x, 0.0]), 0.0, 0.1) for x in (-2.0, 2.0))
    assert land.island[left] != land.island[right]
    assert land.reach[left] == land.reach[right]


def test_a_wall_to_the_greatest_height_parts_both():
    blocks = [*rim(-4, -2, 4, 2), wall(-0.1, -2, 0.1, 2, 3.0)]
    land = free_space(rooms_of(blocks)).land
    left, right = (land.nearest(np.array([x, 0.0]), 0.0, 0.1) for x in (-2.0, 2.0))
    assert land.reach[left] != land.reach[right]


def test_decks_lie_over_one_another_and_a_ramp_joins_them():
    land = free_space(ramp_world()).land
    below, above = (land.nearest(np.array([13.0, 0.0]), z, 0.1) for z in (0.0, 1.0))
    assert below != above
    assert land.column[below] == land.column[above]
    assert land.floor_z_m[[below, above]] == pytest.approx([0.0, 1.0], abs=1e-6)
    assert land.island[below] == land.island[above]
    middle = land.nearest(np.array([5.0, 0.0]), 0.5, 0.1)
    assert land.floor_z_m[middle] == pytest.approx(0.1 * land.xy_m[middle, 0], abs=1e-6)
    # the rim of the deck: nothing to stand on beyond it
    assert land.nearest(np.array([13.0, 1.1]), 1.0, 0.05, dz_m=0.05) is None


def test_a_steeper_ramp_than_the_wheels_climb_joins_nothing():
    land = free_space(ramp_world(), slope_max=0.08).land
    below, above = (land.nearest(np.array([13.0, 0.0]), z, 0.1) for z in (0.0, 1.0))
    assert land.island[below] != land.island[above]


def test_under_a_table_it_drives_but_does_not_take_off():
    free = free_space(table_world())
    under = free.land.nearest(np.array([0.0, 0.0]), 0.0, 0.1)
    aside = free.land.nearest(np.array([-3.0, 0.0]), 0.0, 0.1)
    assert free.land.island[under] == free.land.island[aside]
    assert free.land.top_m[under] == pytest.approx(
        0.7 - ROBOT.body.above_m - ROBOT.clearance.landing_m, abs=1e-5
    )
    assert np.isinf(free.land.top_m[aside])


def test_nobody_stands_or_flies_inside_a_solid():
    big = np.array([[-2.0, -2.0, 0.0], [2.0, 2.0, 2.4]])
    free = free_space(rooms_of([*rim(-6, -3, 6, 3), big]))
    inside = (np.abs(free.land.xy_m) < 2.0).all(axis=1) & (free.land.floor_z_m < 2.0)
    assert not inside.any()
    cells = np.argwhere(free.air.free)
    centres = free.air.centres_m(cells)
    assert not ((np.abs(centres[:, :2]) < 2.0).all(axis=1) & (centres[:, 2] < 2.4)).any()


def test_walls_without_thickness_and_with_holes_still_part_rooms():
    across = sheet([[0, -3, 0], [0, 3, 0], [0, 3, 3.5], [0, -3, 3.5]])
    whole = world_of(rim(-6, -3, 6, 3), extra=[across])
    odd = np.arange(len(whole.faces))[:, None] % 2 == 1
    tops = (whole.triangles_m[:, :, 2] > 2.5).all(axis=1) & (whole.triangles_m[:, :, 2] < 3.0).all(axis=1)
    turned = np.where(odd, whole.faces[:, ::-1], whole.faces)[
        ~tops
    ]  # wound both ways, outer walls open above
    world = make_world("torn", whole.vertices_m, turned, {})
    edges = np.sort(np.concatenate([turned[:, [0, 1]], turned[:, [1, 2]], turned[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 1).sum() > 10
    land = free_space(world).land
    left, right = (land.nearest(np.array([x, 0.0]), 0.0, 0.1) for x in (-3.0, 3.0))
    assert land.reach[left] != land.reach[right]
    gap = np.abs(land.xy_m[:, 0])
    floor = land.floor_z_m < 0.1
    assert gap[floor].min() >= ROBOT.body.radius_m + LAND_MARGIN_M
    assert gap[floor].min() < ROBOT.body.radius_m + LAND_MARGIN_M + land.cell_m


def test_voxels_hold_every_point_of_the_surface_and_little_else():
    rng = np.random.default_rng(7)
    triangles = rng.uniform(0.0, 2.0, (30, 3, 3)).astype(np.float32)
    grid = np.zeros((22, 22, 22), bool)
    voxelise(triangles, np.full(3, -0.1), 0.1, grid)
    u, v = rng.random((2, 4000, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = triangles[rng.integers(0, 30, 4000)].astype(float).transpose(1, 0, 2)
    at = np.floor((a + u * (b - a) + v * (c - a) + 0.1) / 0.1).astype(int)
    assert grid[tuple(at.T)].all()
    marked = np.argwhere(grid)
    world = make_world("soup", triangles.reshape(-1, 3), np.arange(90).reshape(30, 3), {})
    near = ~Surface(world).away(-0.1 + (marked + 0.5) * 0.1, 0.05 * math.sqrt(3.0) + 1e-5)
    assert near.all()


def test_the_driving_field_tells_the_walls_and_a_drop(rooms):
    blocks, free = rooms
    field = free.land_field(standing_at(-2.0, 0.0))
    points = np.random.default_rng(1).uniform([-5.4, -2.9], [1.4, 2.9], (800, 2))
    truth = distance_to_blocks(points, blocks)
    seen = (truth > 0.1) & (
        truth < 3.4 - np.abs(points[:, 0] + 2.0)
    )  # what stands beyond the map is not in it
    assert np.abs(field.lookup(points) - truth)[seen].max() < 1.5 * field.cell_m
    assert (field.lookup(points)[truth == 0.0] <= 0.0).all()
    deck = free_space(ramp_world()).land_field(standing_at(13.0, 0.0, 1.0))
    assert float(deck.lookup(np.array([[13.0, 0.0]]))[0]) == pytest.approx(1.0, abs=0.06)  # to the edge
    assert float(deck.lookup(np.array([[13.0, 1.5]]))[0]) < 0.0


def test_a_wall_on_the_border_of_two_cells_is_in_one_of_them_at_least():
    free = free_space(world_of([wall(-1.0, -0.5, 1.0, 0.5)]))
    edge = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -0.5], [0.0, 0.5]])
    for x in np.arange(-4.475, -1.5, 0.05):  # rounding differs from origin to origin
        field = free.land_field(standing_at(x, 1.125), (6.0, 4.0))
        assert field.lookup(edge).max() <= 0.001
        assert field.lookup(np.zeros((1, 2)))[0] < -0.4  # closed all round: nobody gets in


def test_the_flying_field_is_the_distance_to_the_surface(rooms):
    blocks, free = rooms
    field = free.air_field(np.array([-2.0, 0.0, 1.0]))
    points = np.random.default_rng(2).uniform([-5.4, -2.9, 0.2], [1.4, 2.9, 2.2], (500, 3))
    truth = np.minimum(distance_to_blocks(points, blocks), points[:, 2])
    error = field.lookup(points) - truth
    assert error.max() < 0.5 * field.cell_m
    assert error[truth > 0.15].min() > -1.5 * field.cell_m


@pytest.mark.slow
@pytest.mark.timeout(90)  # the garage has a million floor points on eight decks
@pytest.mark.parametrize(
    "file",
    ["aws_small_house/small_house.npz", "ethz_forest/forest0.npz", "parking_garage/parking_garage.npz"],
)
def test_every_place_in_worlds_of_others_keeps_its_clearance(file):
    if not (SHARED / "data" / "worlds" / file).is_file():
        pytest.skip(f"third-party world {file} is not here")
    world = build_world({"mesh": file}, seed=0, worlds_dir=SHARED / "data" / "worlds")
    free = free_space(world)
    land, surface, rng = free.land, free.surface, np.random.default_rng(0)
    assert len(land.column) > 5000
    xy = land.xy_m
    for k in rng.integers(0, len(land.column), 40):
        body = standing_at(*xy[k], land.floor_z_m[k])
        assert surface.clearance(body, on_floor=True) >= LAND_MARGIN_M - 1e-6
        assert surface.floor_below(*body) == pytest.approx(land.floor_z_m[k], abs=0.045)
    cells = np.argwhere(free.air.free)
    for k in rng.integers(0, len(cells), 40):
        assert surface.clearance(free.air.centres_m(cells[k])) >= AIR_MARGIN_M - 1e-6
