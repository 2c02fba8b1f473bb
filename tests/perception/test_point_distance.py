from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from labr_autonomy.perception.edt import distance_to
from labr_autonomy.perception.point_distance import SPOT, distance_to_points


@pytest.mark.parametrize("share", [0.002, 0.02])
def test_distances_are_those_of_the_points(share):
    rng = np.random.default_rng(5)
    source = rng.random((60, 45)) < share
    source[7, 9] = True
    spots = rng.integers(-100, 101, (60, 45, 2)).astype(np.int8)
    points = np.argwhere(source) + spots[source] / SPOT
    cells = np.argwhere(np.ones_like(source))
    true = cKDTree(points).query(cells)[0].reshape(source.shape)
    found = distance_to_points(source, spots)
    assert (found >= true - 1e-4).all()  # never nearer than a point is
    away = true > 4.0  # cells: where a robot's middle may be
    assert np.percentile((found - true)[away], 99) < 0.15
    assert (found - true)[away].mean() < 0.02


def test_points_in_the_middle_are_cells():
    source = np.zeros((20, 30), bool)
    source[4, 5] = source[15, 22] = True

    found = distance_to_points(source, np.zeros((20, 30, 2), np.int8))
    assert np.allclose(found, distance_to(source, True), atol=1e-5)
