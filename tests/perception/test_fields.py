from __future__ import annotations

import numpy as np
import pytest

from labr_autonomy.perception.edt import distance_to
from labr_autonomy.perception.fields import Field2, Field3

CELL = 0.1


def brute_force(occupied):
    """Signed distance of every cell centre by comparing all pairs."""
    cells = np.argwhere(np.ones_like(occupied)).astype(float)
    solid, free = np.argwhere(occupied), np.argwhere(~occupied)

    def nearest(others):
        return np.sqrt(((cells[:, None] - others[None]) ** 2).sum(-1)).min(1)

    signed = np.where(occupied.ravel(), 0.5 - nearest(free), nearest(solid) - 0.5)
    return (signed * CELL).reshape(occupied.shape)


@pytest.mark.parametrize(("kind", "shape"), [(Field2, (17, 23)), (Field3, (9, 11, 7))])
def test_distance_equals_brute_force(kind, shape):
    rng = np.random.default_rng(3)
    occupied = rng.random(shape) < 0.06
    field = kind.from_occupied(occupied, ~occupied, np.full(len(shape), -0.7), CELL)
    assert np.allclose(field.distance_m, brute_force(occupied), atol=1e-5)
    assert field.distance_m.dtype == np.float32


@pytest.mark.parametrize("kind", [Field2, Field3])
def test_interpolated_distance_to_a_wall_is_exact_and_crosses_zero_on_its_face(kind):
    d = 2 if kind is Field2 else 3
    occupied = np.zeros((20, 12, 10)[:d], bool)
    occupied[15:] = True  # solid from x = 1.5 m on
    field = kind.from_occupied(occupied, ~occupied, np.zeros(d), CELL)
    x = np.linspace(0.06, 1.9, 60)
    points = np.full((60, d), 0.5)
    points[:, 0] = x
    assert np.allclose(field.lookup(points), 1.5 - x, atol=1e-5)
    gradient = field.gradient(points[3:-3])
    assert np.allclose(gradient[:, 0], -1.0, atol=1e-4)
    assert np.allclose(gradient[:, 1:], 0.0, atol=1e-4)


def test_outside_the_grid_the_border_answers_and_nothing_is_known():
    occupied = np.zeros((10, 10), bool)
    occupied[0] = True
    field = Field2.from_occupied(occupied, np.ones_like(occupied), np.zeros(2), CELL)
    far, edge = np.array([[50.0, 0.5]]), np.array([[0.999, 0.5]])
    assert field.lookup(far) == pytest.approx(field.lookup(edge))
    assert not field.contains(far)[0]
    assert not field.is_known(far)[0]
    assert field.is_known(edge)[0]


def test_known_is_per_cell():
    known = np.zeros((10, 10), bool)
    known[3, 4] = True
    field = Field2.from_occupied(np.zeros_like(known), known, np.array([-1.0, 2.0]), CELL)
    points = np.array([[-0.65, 2.45], [-0.55, 2.45], [-0.65, 2.55]])
    assert field.is_known(points).tolist() == [True, False, False]


@pytest.mark.parametrize("kind", [Field2, Field3])
def test_empty_and_full_grids_have_finite_distances(kind):
    shape = (8, 9, 7)[: 2 if kind is Field2 else 3]
    for solid in (False, True):
        occupied = np.full(shape, solid)
        field = kind.from_occupied(occupied, ~occupied, np.zeros(len(shape)), CELL)
        assert np.isfinite(field.distance_m).all()
        assert ((field.distance_m < 0) == occupied).all()


def test_surface_points_are_the_skin_of_a_block():
    occupied = np.zeros((9, 9, 9), bool)
    occupied[2:7, 2:7, 2:7] = True
    field = Field3.from_occupied(occupied, ~occupied, np.zeros(3), CELL)
    points = field.surface_points()
    assert len(points) == 5**3 - 3**3
    assert np.allclose(field.lookup(points), -0.5 * CELL, atol=1e-6)


def test_surface_points_do_not_wrap_round_the_border():
    occupied = np.zeros((6, 6), bool)
    occupied[0] = True
    field = Field2.from_occupied(occupied, ~occupied, np.zeros(2), CELL)
    assert len(field.surface_points()) == 6


@pytest.mark.parametrize("seed", range(8))
def test_distances_are_correctly_rounded_so_that_every_run_gets_the_same(seed):
    rng = np.random.default_rng(seed)
    occupied = rng.random((70, 61)) < 0.02
    far = np.argwhere(occupied)
    cells = np.stack(np.meshgrid(np.arange(70), np.arange(61), indexing="ij"), axis=-1)
    squared = ((cells[:, :, None] - far) ** 2).sum(axis=-1).min(axis=-1)
    exact = np.sqrt(squared.astype(np.float32))
    found = distance_to(occupied, True)
    assert found.dtype == np.float32
    assert np.array_equal(found, exact)
