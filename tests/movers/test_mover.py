"""Where a mover is along its track, and how far the robot's outline is from it."""

import json
import math

import numpy as np
import pytest
from movers_rig import BODY, BOX, brute_gap, mover

from sim.movers.draw import PERSON
from sim.movers.mover import Mover, Placed
from sim.movers.shapes import corners_m


def test_a_track_goes_from_end_to_end_over_its_floor():
    who = mover(first=(1.0, 0.0), last=(1.0, 4.0), floor=(0.0, 0.2, 0.1))
    assert who.length_m == 4.0
    at = who.at(1.0)
    assert (at.x_m, at.y_m, at.floor_z_m) == pytest.approx((1.0, 1.0, 0.1))
    assert at.yaw_rad == pytest.approx(0.5 * math.pi)
    assert who.at(3.0).floor_z_m == pytest.approx(0.15)
    assert who.at(4.0).y_m == pytest.approx(4.0)


def test_a_mover_survives_json():
    who = mover(BOX, floor=(0.0, 0.1, 0.3))
    assert Mover.from_dict(json.loads(json.dumps(who.as_dict()))) == who


@pytest.mark.parametrize("shape", [PERSON, BOX])
def test_the_gap_is_that_of_the_solids(shape):
    rng = np.random.default_rng(1)
    seen = set()
    for _ in range(12):
        placed = Placed(shape, *rng.uniform(-0.5, 0.5, 3), rng.uniform(-3, 3))
        x, y = rng.uniform(-1.3, 1.3, 2)
        z = rng.uniform(0.1, 2.6)
        gap = placed.clearance_m(x, y, z, BODY)
        if gap > 0.0:
            assert gap == pytest.approx(brute_gap(placed, x, y, z), abs=0.012)
            seen.add(z > placed.floor_z_m + shape.height_m)
    assert len(seen) == 2  # beside and above


def test_where_they_meet_the_gap_is_minus_the_least_way_out():
    placed = Placed(PERSON, 0.0, 0.0, 0.0, 0.0)
    aside = 0.25 + BODY.radius_m
    assert placed.clearance_m(aside - 0.1, 0.0, 0.5, BODY) == pytest.approx(-0.1)
    assert placed.clearance_m(0.0, 0.0, 1.75 + BODY.below_m - 0.03, BODY) == pytest.approx(-0.03)
    box = Placed(BOX, 0.0, 0.0, 0.0, 0.0)
    assert box.clearance_m(0.1, 0.15, 0.3, BODY) == pytest.approx(-0.05 - BODY.radius_m)


def test_the_triangles_are_those_of_the_placed_shape():
    placed = Placed(BOX, 1.0, 2.0, 0.5, 0.5 * math.pi)
    corners = corners_m(placed).reshape(-1, 3)
    assert corners.min(axis=0) == pytest.approx([0.8, 1.6, 0.5], abs=1e-6)
    assert corners.max(axis=0) == pytest.approx([1.2, 2.4, 1.3], abs=1e-6)
