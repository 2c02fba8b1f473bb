"""Ground and trees of the forest, against the figures they are drawn to."""

import numpy as np
import pytest

from sim.worlds.families import trees, undergrowth
from sim.worlds.families.draw import SIZES, family_of
from sim.worlds.families.forest import STEEPEST
from sim.worlds.families.terrain import Ground, hilly
from sim.worlds.surface import Surface
from sim.worlds.world import make_world

DIFFICULTIES = (0.0, 0.5, 1.0)


def ground(seed, difficulty):
    return hilly(np.random.default_rng(seed), (17.5, 17.5), float(np.interp(difficulty, *STEEPEST)))


def test_slopes_grow_with_difficulty_as_stated():
    slopes = [np.array([ground(seed, d).slopes() for seed in range(8)]) for d in DIFFICULTIES]
    assert slopes[0].max() < 0.02
    assert slopes[1].max() <= 0.12
    assert np.mean(slopes[1] < 0.08) > 0.8
    assert 0.2 < slopes[2].max() <= 0.25
    assert slopes[0].mean() < slopes[1].mean() < slopes[2].mean()


def test_a_tilted_plane_has_its_slope_and_height_everywhere():
    x, y = np.linspace(-2.0, 2.0, 9), np.linspace(-1.0, 1.0, 5)
    plane = Ground(x, y, 0.3 * x[:, None] - 0.4 * y[None, :])
    assert plane.slopes() == pytest.approx(0.5)
    at = np.array([[0.13, -0.71], [-1.99, 0.99], [2.0, 1.0]])
    assert plane.height_m(at) == pytest.approx(at @ [0.3, -0.4])


def test_heights_are_those_of_the_triangles_and_zero_in_the_origin():
    made = ground(4, 1.0)
    block = made.block()
    surface = Surface(make_world("ground", block.vertices_m, block.faces, {}))
    places = np.random.default_rng(0).uniform(-17.0, 17.0, (200, 2))
    found = [surface.floor_below(x, y, 20.0) for x, y in places]
    assert made.height_m(places) == pytest.approx(found, abs=2e-3)
    assert made.height_m(np.zeros((1, 2)))[0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow
def test_trees_per_area_follow_the_difficulty():
    for difficulty, low, high in ((0.0, 4.0, 6.5), (0.5, 8.5, 11.5), (1.0, 12.0, 16.5)):
        counts = []
        for seed in range(5):
            rng = np.random.default_rng([seed, *b"forest"])
            drawn = family_of("forest")(rng, SIZES["forest"], difficulty)
            tall = [t for t in drawn.furnishings if np.ptp(t.vertices_m[:, 2]) > 2.3]
            counts.append(100.0 * len(tall) / 33.0**2)
        assert low < np.mean(counts) < high


def test_trunks_taper_lean_and_are_flared_at_the_root():
    rng = np.random.default_rng(1)
    for diameter in trees.TRUNK_M:
        stem = trees.trunk(rng, diameter, 6.0, 0.08)
        assert (np.diff(stem.radii_m) <= 0.0).all()
        assert stem.at(np.array([1.3]))[1][0] == pytest.approx(0.5 * diameter)
        assert stem.at(np.array([0.0]))[1][0] > 0.6 * diameter
        top, _ = stem.at(np.array([6.0]))
        assert 0.05 < np.hypot(*top[0, :2]) < 0.8


def test_leaf_masses_of_broadleaf_trees_begin_above_the_robots_head():
    for seed in range(10):
        rng = np.random.default_rng(seed)
        tree = trees.broadleaf(rng, 0.3, 0.05, 0)
        low = tree.vertices_m[tree.vertices_m[:, 2] < 1.9]
        assert np.hypot(*low[:, :2].T).max() < 0.5  # nothing but the trunk below the first branches


def test_undergrowth_stands_on_the_slope_and_keeps_its_heights():
    made = ground(2, 1.0)
    for seed in range(10):
        rng = np.random.default_rng(seed)
        x, y = rng.uniform(-14.0, 14.0, 2)
        for kind, lowest, highest in (
            (undergrowth.bush, 0.15, 1.3),
            (undergrowth.log, 0.12, 1.2),
            (undergrowth.stump, 0.2, 0.61),
            (undergrowth.rock, 0.05, 0.8),
            (undergrowth.ledge, 0.08, 0.45),
        ):
            mesh = kind(rng, made, x, y)
            above = mesh.vertices_m[:, 2] - made.height_m(mesh.vertices_m[:, :2])
            assert above.min() < 0.0
            assert lowest < above.max() < highest
