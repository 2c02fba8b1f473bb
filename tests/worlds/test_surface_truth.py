from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import pytest

from labr_autonomy.clock import SystemClock
from labr_autonomy.config import Body
from sim.worlds.build import build_world
from sim.worlds.surface import FLOOR_BAND_M, REACH_M, Surface
from sim.worlds.world import make_world

SHARED = Path(os.environ.get("LABR_SHARED") or Path(__file__).resolve().parents[2].parent / "shared")
HOUSE = SHARED / "data" / "worlds" / "aws_small_house" / "small_house.npz"
BODY = Body()
Z = BODY.below_m  # body origin when it stands on z = 0

_CUBE = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
_FACES = np.array(
    [
        0,
        2,
        1,
        1,
        2,
        3,
        4,
        5,
        6,
        5,
        7,
        6,
        0,
        1,
        4,
        1,
        5,
        4,
        2,
        6,
        3,
        3,
        6,
        7,
        0,
        4,
        2,
        2,
        4,
        6,
        1,
        3,
        5,
        3,
        7,
        5,
    ]
).reshape(-1, 3)


def boxes(*corners):
    """World of a 10 m floor and boxes given as (lower, upper)."""
    vertices = [np.array([[-5, -5, 0], [5, -5, 0], [5, 5, 0], [-5, 5, 0]], float)]
    faces = [np.array([[0, 1, 2], [0, 2, 3]])]
    for i, (low, high) in enumerate(corners):
        vertices.append(np.array(low) + _CUBE * (np.array(high, float) - low))
        faces.append(_FACES + 4 + 8 * i)
    return make_world("boxes", np.concatenate(vertices), np.concatenate(faces), {})


@pytest.fixture(scope="module")
def room():
    return Surface(
        boxes(((1, -1, 0), (2, 1, 0.5)), ((-3, -1, 1.0), (-2, 1, 1.2)), ((-0.5, 2, 0), (0.5, 3, 0.03)))
    )


def at(x, y, z=Z):
    return np.array([x, y, z])


@pytest.mark.slow  # compiles
def test_a_wall_beside_a_driving_robot(room):
    assert room.clearance(at(0, 0), on_floor=True) == pytest.approx(1.0 - BODY.radius_m, abs=1e-4)
    assert room.clearance(at(0.5, 0), on_floor=True) == pytest.approx(0.5 - BODY.radius_m, abs=1e-4)
    corner = math.hypot(0.5, 0.5) - BODY.radius_m
    assert room.clearance(at(0.5, -1.5), on_floor=True) == pytest.approx(corner, abs=1e-4)


def test_contact_is_zero_or_below_and_says_how_deep(room):
    assert room.clearance(at(0.7, 0), on_floor=True) == pytest.approx(0.0, abs=1e-6)
    assert room.clearance(at(0.8, 0), on_floor=True) == pytest.approx(-0.1, abs=1e-6)


def test_the_floor_counts_in_flight_only(room):
    assert room.clearance(at(-1, -3), on_floor=True) == REACH_M
    assert room.clearance(at(-1, -3)) == pytest.approx(0.0, abs=1e-6)
    assert room.clearance(at(-1, -3, Z + 0.25)) == pytest.approx(0.25, abs=1e-4)


def test_a_threshold_is_driven_over_but_not_flown_through(room):
    assert room.clearance(at(0, 2.5, Z), on_floor=True) > 1.0
    assert room.clearance(at(0, 2.5, Z)) < 0.0
    # Raised wheels: on top of the threshold nothing is in contact either way.
    assert room.clearance(at(0, 2.5, Z + 0.05)) == pytest.approx(0.02, abs=1e-4)


def test_above_and_below_a_board(room):
    top = BODY.above_m
    assert room.clearance(at(-2.5, 0, 0.7), on_floor=True) == pytest.approx(0.3 - top, abs=1e-4)
    assert room.clearance(at(-2.5, 0, 1.2 + Z + 0.07)) == pytest.approx(0.07, abs=1e-4)
    # Beside the edge and below it: the way from the upper rim.
    rim = math.hypot(0.5 - BODY.radius_m, 0.3 - top)
    assert room.clearance(at(-1.5, 0, 0.7), on_floor=True) == pytest.approx(rim, abs=1e-3)


def test_reach_and_places_far_outside(room):
    assert room.clearance(at(0, 0), on_floor=True, reach_m=0.3) == 0.3
    assert room.clearance(at(80, 80), on_floor=True) == REACH_M
    assert room.clearance(at(0, 0), on_floor=True, radius_m=0.9) == pytest.approx(0.1, abs=1e-4)


def test_the_kernel_agrees_with_points_strewn_over_triangles():
    rng = np.random.default_rng(5)
    centres = rng.uniform(-2, 2, (40, 1, 3)) + np.array([0, 0, 1])
    triangles = centres + rng.uniform(-0.6, 0.6, (40, 3, 3))
    surface = Surface(make_world("shards", triangles.reshape(-1, 3), np.arange(120).reshape(-1, 3), {}))
    k = 80
    a, b = (
        g[np.add.outer(np.arange(k + 1), np.arange(k + 1)) <= k] / k for g in np.mgrid[0 : k + 1, 0 : k + 1]
    )
    weights = np.stack([1 - a - b, a, b], axis=1)
    points = np.einsum("pc,tcx->tpx", weights, triangles).reshape(-1, 3)
    contacts = 0
    for _ in range(60):
        p = rng.uniform([-2, -2, 0], [2, 2, 2])
        for on_floor in (False, True):
            low = p[2] - BODY.below_m + (FLOOR_BAND_M if on_floor else 0.0)
            near = points[points[:, 2] > low] if on_floor else points
            side = np.maximum(np.hypot(near[:, 0] - p[0], near[:, 1] - p[1]) - BODY.radius_m, 0.0)
            updown = np.maximum(np.maximum(near[:, 2] - p[2] - BODY.above_m, low - near[:, 2]), 0.0)
            strewn = min(float(np.hypot(side, updown).min(initial=REACH_M)), REACH_M)
            exact = surface.clearance(p, on_floor=on_floor)
            contacts += exact <= 0.0
            assert max(exact, 0.0) == pytest.approx(strewn, abs=0.01)
            assert exact <= strewn + 1e-3
    assert 3 < contacts < 100


def test_floor_below(room):
    assert room.floor_below(0, 0, 1.0) == pytest.approx(0.0, abs=1e-4)
    assert room.floor_below(1.5, 0, 1.0) == pytest.approx(0.5, abs=1e-4)
    assert room.floor_below(1.5, 0, 0.5) == pytest.approx(0.5, abs=1e-4)
    assert room.floor_below(-2.5, 0, 2.0) == pytest.approx(1.2, abs=1e-4)
    assert room.floor_below(-2.5, 0, 0.9) == pytest.approx(0.0, abs=1e-4)
    assert room.floor_below(9, 9, 1.0) == -math.inf
    # Along the seam of the floor's two triangles no ray slips through.
    assert all(
        room.floor_below(x, x, 1.0) == pytest.approx(0.0, abs=1e-4) for x in np.linspace(-4.9, -3.1, 50)
    )


def test_no_ray_falls_through_the_seam_of_two_slabs():
    """Of a parking deck: single precision leaves a gap of a millimetre between triangles of 30 m."""
    deck = build_world({"family": "garage", "size_m": [30.0, 24.0], "difficulty": 0.5}, seed=0)
    slabs, ys = Surface(deck), -8.6 + np.arange(-0.004, 0.004, 1e-4)
    floors = slabs.floors_below(np.column_stack([np.full(len(ys), -11.5), ys]), 2.7)
    assert floors == pytest.approx(2.602, abs=1e-3)


def test_inside_a_solid(room):
    assert room.inside(at(1.5, 0, 0.25))
    assert not room.inside(at(0, 0, 0.25))
    assert not room.inside(at(1.5, 0, 0.8))
    assert not room.inside(at(-2.5, 0, 0.5))  # under the board
    assert room.free_place(at(1.5, 0, 0.25), on_floor=True) == -1.0
    assert room.free_place(at(0, 0), on_floor=True) == pytest.approx(0.7, abs=1e-4)


def test_a_solid_without_bottom_and_a_room_of_sheets():
    open_box = boxes(((1, -1, 0), (4, 1, 2)))
    holed = make_world("holed", open_box.vertices_m, np.delete(open_box.faces, [2, 3], axis=0), {})
    assert Surface(holed).inside(at(2.5, 0, 1))
    sheets = make_world("sheets", _CUBE * [4, 4, 3] - [2, 2, 0], _FACES[:, ::-1], {})  # wound inwards: a room
    assert not Surface(sheets).inside(at(0, 0, 1))


def test_who_sees_whom(room):
    assert room.sees(at(0, 0, 0.2), at(0.9, 0, 0.2))
    assert not room.sees(at(0, 0, 0.2), at(2.5, 0, 0.2))
    assert room.sees(at(0, 0, 0.8), at(2.5, 0, 0.8))
    assert room.sees(at(0, 0, 0.8), at(0, 0, 0.8))


@pytest.mark.slow
@pytest.mark.skipif(not HOUSE.exists(), reason="the small house is not beside the checkout")
def test_the_small_house_is_asked_quickly():
    world = build_world({"mesh": "aws_small_house/small_house.npz"}, seed=0, worlds_dir=HOUSE.parents[1])
    surface, clock = Surface(world), SystemClock()
    surface.clearance(at(0, 0))
    assert surface.free_place(at(2.0, 0.6), on_floor=True) > 0.5
    assert surface.free_place(at(0.0, -2.5), on_floor=True) <= 0.0  # on the sofa
    rng = np.random.default_rng(1)
    places = rng.uniform(world.lower_m, world.upper_m, (300, 3))
    begin_s = clock.now_s()
    for p in places:
        surface.clearance(p)
    assert (clock.now_s() - begin_s) / len(places) < 0.003
