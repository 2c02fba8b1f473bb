"""Fences: signed distances and height bands."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labr_autonomy.guard.fence import Zone, margin_m, signed_depth_m

SQUARE = ((0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (0.0, 2.0))
coordinate = st.floats(-10, 10, allow_nan=False)


def test_depth_inside_and_outside_a_polygon():
    zone = Zone(SQUARE, keep_in=True)
    assert signed_depth_m(zone, 2.0, 1.0) == pytest.approx(1.0)
    assert signed_depth_m(zone, 5.0, 1.0) == pytest.approx(-1.0)
    assert signed_depth_m(zone, 5.0, 3.0) == pytest.approx(-math.sqrt(2))


def test_a_circle_to_stay_out_of_binds_in_its_height_band_only():
    zone = Zone(((1.0, 1.0),), keep_in=False, z_low_m=0.0, z_high_m=1.0, radius_m=0.5)
    assert margin_m([zone], 1.0, 1.0, 0.5) == pytest.approx(-0.5)
    assert margin_m([zone], 1.0, 1.0, 1.6) == pytest.approx(0.6)
    assert margin_m([zone], 3.0, 1.0, 0.5) == pytest.approx(1.5)


def test_a_keep_in_zone_is_left_through_its_lid():
    zone = Zone(SQUARE, keep_in=True, z_low_m=-1.0, z_high_m=2.0)
    assert margin_m([zone], 2.0, 1.0, 2.5) == pytest.approx(-0.5)


def test_no_fence_means_no_limit():
    assert margin_m([], 1e6, 0.0, 0.0) == math.inf


@given(coordinate, coordinate, coordinate)
def test_the_narrowest_fence_decides(x, y, z):
    a, b = Zone(SQUARE, keep_in=True), Zone(((0.0, 0.0),), keep_in=False, radius_m=1.0)
    assert margin_m([a, b], x, y, z) == min(margin_m([a], x, y, z), margin_m([b], x, y, z))
