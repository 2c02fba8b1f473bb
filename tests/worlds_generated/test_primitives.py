import math

import numpy as np
import pytest
from scipy.spatial import cKDTree

from sim.worlds.primitives import Scene, box, cylinder


def random_scene(seed: int) -> Scene:
    rng = np.random.default_rng(seed)
    rows = [
        box(rng.uniform(-3, 3, 3), rng.uniform(0.1, 1.0, 3), float(rng.uniform(0, math.pi))) for _ in range(4)
    ]
    rows += [cylinder(*rng.uniform(-3, 3, 2), float(rng.uniform(0.1, 0.5)), 0.0, 2.0) for _ in range(3)]
    return Scene(np.stack(rows))


def surface_samples(scene: Scene, per_face: int) -> tuple[np.ndarray, np.ndarray]:
    """Points on every triangle of the solids (the floor's triangles come first and are skipped)."""
    rng = np.random.default_rng(0)
    full = scene.world("t", {}, (4.0, 4.0))
    floor = Scene(np.zeros((0, 8))).world("f", {}, (4.0, 4.0))
    corners = full.triangles_m[len(floor.faces) :].astype(np.float64)
    weight = rng.dirichlet((1, 1, 1), (len(corners), per_face))
    return np.einsum("fki,fij->fkj", weight, corners).reshape(-1, 3), corners


@pytest.mark.parametrize("seed", range(4))
def test_sampled_triangles_lie_on_the_zero_level(seed):
    for row in random_scene(seed).rows:
        single = Scene(row[None])
        points, _ = surface_samples(single, 20)
        flat_error = row[4] * (1 - math.cos(math.pi / 32)) if row[0] else 0.0
        assert np.abs(single.distance(points)).max() <= flat_error + 1e-5


@pytest.mark.parametrize("seed", range(3))
def test_distance_outside_is_that_to_the_nearest_surface_sample(seed):
    scene = random_scene(seed)
    samples, _ = surface_samples(scene, 400)
    points = np.random.default_rng(seed + 50).uniform(-5, 5, (60, 3))
    exact = scene.distance(points)
    sampled = cKDTree(samples).query(points)[0]
    outside = exact > 0.3
    assert outside.sum() > 20
    # Samples can only overestimate, by their spacing; flats of a cylinder add half a centimetre.
    assert (sampled[outside] >= exact[outside] - 5e-3).all()
    assert (sampled[outside] <= exact[outside] + 0.06).all()


def test_inside_is_negative_with_the_depth_to_the_nearest_side():
    scene = Scene(np.stack([box([0, 0, 1], [1.0, 0.5, 1.0], math.pi / 2), cylinder(5, 0, 0.4, 0, 2)]))
    found = scene.distance(np.array([[0.2, 0.0, 1.0], [5.1, 0.0, 1.0], [5.0, 0.0, 1.9]]))
    np.testing.assert_allclose(found, [-0.3, -0.3, -0.1], atol=1e-12)


def test_footprint_ignores_solids_that_begin_high():
    scene = Scene(np.stack([box([0, 0, 2.0], [1, 1, 0.1]), box([4, 0, 0.5], [0.5, 0.5, 0.5])]))
    at = np.array([[0.0, 0.0]])
    assert scene.footprint_distance(at, 1.0)[0] == pytest.approx(3.5)
    assert scene.footprint_distance(at)[0] == pytest.approx(-1.0)


def test_an_empty_scene_is_infinitely_far():
    assert np.isinf(Scene(np.zeros((0, 8))).distance(np.zeros((2, 3)))).all()


def test_triangles_are_wound_outwards():
    for row in (box([1, 2, 3], [0.5, 0.4, 0.3], 0.7), cylinder(1, 2, 0.4, 0, 2)):
        _, corners = surface_samples(Scene(row[None]), 1)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (((corners.mean(axis=1) - row[1:4]) * normal).sum(axis=1) > 0).all()


def test_floor_covers_the_region_faces_up_and_has_tiles_of_two_metres_at_most():
    world = Scene(np.zeros((0, 8))).world("f", {}, (7.1, 5.0))
    t = world.triangles_m.astype(np.float64)
    normal = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    assert (normal[:, 2] > 0).all()
    assert normal[:, 2].sum() / 2 == pytest.approx(14.2 * 10.0, rel=1e-6)
    assert np.ptp(t[..., :2], axis=1).max() <= 2.0 + 1e-6
    assert np.abs(t[..., 2]).max() == 0.0
