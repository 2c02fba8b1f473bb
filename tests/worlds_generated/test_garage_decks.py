"""Decks, ramps, ceilings and obstacles of the garage, against the figures they are drawn to."""

import numpy as np
import pytest

from sim.worlds.build import build_world
from sim.worlds.families.cars import SHAPES, car
from sim.worlds.families.draw import SIZES
from sim.worlds.families.garage_plan import CEILING_M, SLOPE_MAX, plan
from sim.worlds.surface import FLOOR_BAND_M, Surface
from sim.worlds.world import make_world

SEEDS = range(24)


def drawn_plan(seed, difficulty=0.5, size_m=SIZES["garage"]):
    return plan(np.random.default_rng([seed, *b"garage"]), size_m, difficulty)


def with_kind(kind):
    return next(seed for seed in SEEDS if drawn_plan(seed).kind == kind)


def test_half_of_the_seeds_or_more_have_a_second_floor():
    kinds = [drawn_plan(seed).kind for seed in SEEDS]
    assert set(kinds) == {"single", "two", "sunken"}
    assert sum(kind != "single" for kind in kinds) >= len(kinds) // 2


@pytest.mark.parametrize("size_m", [SIZES["garage"], (20.0, 18.0), (45.0, 33.0)])
def test_ceilings_beams_aisles_and_slopes_are_as_stated(size_m):
    for seed in SEEDS:
        drawn = drawn_plan(seed, 0.5, size_m)
        for deck in drawn.decks:
            assert CEILING_M[0] <= deck.ceiling_m - deck.floor_m <= CEILING_M[1]
            aisles = [s.high_m - s.low_m for s in deck.strips if s.kind == "A"]
            assert min(aisles) >= 4.9 or len(deck.strips) == 1
            assert deck.low_m - 1e-9 <= deck.strips[0].low_m
            assert deck.strips[-1].high_m <= deck.high_m + 1e-9
        assert 1.9 <= drawn.beam_m <= 2.2
        assert 0.3 <= drawn.pillar_m <= 0.6
        if drawn.ramp is not None:
            assert 0.08 <= drawn.ramp.slope <= SLOPE_MAX + 1e-9


def path_over_ramp(ramp, mirror):
    """Places (k, 2) from a landing over the ramp to the other landing, in steps of 2 cm."""
    x = np.arange(ramp.from_m - 1.5, ramp.to_m + 1.5, 0.02)
    y = np.full(len(x), 0.5 * (ramp.low_m + ramp.high_m))
    return np.column_stack([x, y]) * mirror


def mirror_of(surface, ramp):
    """The signs of x and y under which the middle of the ramp is found half-way up."""
    half_way = 0.5 * (ramp.bottom_m + ramp.top_m)
    middle = 0.5 * np.array([ramp.from_m + ramp.to_m, ramp.low_m + ramp.high_m])
    for x in (1.0, -1.0):
        for y in (1.0, -1.0):
            floor = surface.floor_below(*(middle * [x, y]), ramp.top_m + 0.5)
            foot = surface.floor_below((ramp.from_m + 1.0) * x, middle[1] * y, ramp.top_m + 0.5)
            if abs(floor - half_way) < 0.02 and foot < half_way:
                return np.array([x, y])
    raise AssertionError("no ramp where the plan has it")


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["two", "sunken"])
def test_a_ramp_without_steps_joins_the_decks_and_the_robot_fits_all_along(kind):
    seed = with_kind(kind)
    ramp = drawn_plan(seed).ramp
    path = path_over_ramp(ramp, mirror_of(Surface(build_world({"family": "garage"}, seed=seed)), ramp))
    keep = [(float(x), float(y), 0.0) for x, y in path[::40]]
    keep += [(x, y, ramp.top_m) for x, y, _ in keep]
    surface = Surface(build_world({"family": "garage"}, seed=seed, clear_m=keep))
    z, heights = ramp.bottom_m, []
    for x, y in path:
        z = surface.floor_below(x, y, z + 0.3)
        heights.append(z)
        assert surface.clearance(np.array([x, y, z + 0.125]), on_floor=True) > 0.0
    assert heights[0] == pytest.approx(ramp.bottom_m, abs=1e-3)
    assert heights[-1] == pytest.approx(ramp.top_m, abs=1e-3)
    assert np.abs(np.diff(heights)).max() < FLOOR_BAND_M


@pytest.mark.slow
def test_both_decks_of_two_are_floored_and_covered():
    seed = with_kind("two")
    lower, upper = drawn_plan(seed).decks
    world = build_world({"family": "garage", "difficulty": 0.0}, seed=seed)
    surface = Surface(world)
    assert world.region_m[1, 2] == pytest.approx(upper.ceiling_m - 0.3)
    for x in np.linspace(-13.0, 13.0, 14):
        floor = surface.floor_below(x, 0.3, upper.floor_m + 0.02)
        assert floor == pytest.approx(upper.floor_m, abs=2e-3)
        assert not surface.sees(np.array([x, 0.3, upper.floor_m + 1.0]), np.array([x, 0.3, 9.0]))
        assert surface.floor_below(x, 0.3, lower.floor_m + 0.02) == pytest.approx(0.0, abs=2e-3)


@pytest.mark.parametrize("kind", SHAPES)
def test_no_car_lets_the_robot_under_it_and_all_stand_on_their_wheels(kind):
    for seed in range(5):
        mesh, length, width = car(np.random.default_rng(seed), kind)
        low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
        assert low[2] == pytest.approx(0.0, abs=1e-9)
        assert high[0] - low[0] == pytest.approx(length, abs=0.02)
        assert high[1] - low[1] == pytest.approx(width + 0.3, abs=0.05)  # mirrors
        assert 1.4 <= high[2] <= 2.01
        body = mesh.vertices_m[: 8 * len(SHAPES[kind].body)]
        assert 0.15 <= body[:, 2].min() <= 0.20


@pytest.mark.parametrize("kind", SHAPES)
def test_a_place_within_a_car_is_known_to_be_inside(kind):
    mesh, length, width = car(np.random.default_rng(7), kind)
    surface = Surface(make_world(kind, *mesh, {}))
    for x in np.linspace(-0.4, 0.3, 6) * length:
        assert surface.inside(np.array([x, 0.02, 0.55]))
        assert not surface.inside(np.array([x, width, 0.55]))
        assert not surface.inside(np.array([x, 0.02, 0.08]))


@pytest.mark.slow
def test_a_place_within_the_ramp_is_known_to_be_inside_and_one_over_it_is_not():
    seed = with_kind("two")
    ramp = drawn_plan(seed).ramp
    surface = Surface(build_world({"family": "garage"}, seed=seed))
    mirror = mirror_of(surface, ramp)
    for share in (0.4, 0.6, 0.8):
        x = ramp.from_m + share * (ramp.to_m - ramp.from_m)
        place = np.array([*(np.array([x, 0.5 * (ramp.low_m + ramp.high_m)]) * mirror), 0.0])
        height = share * ramp.top_m
        assert surface.inside(place + np.array([0.0, 0.0, 0.5 * height]))
        assert not surface.inside(place + np.array([0.0, 0.0, height + 0.3]))
