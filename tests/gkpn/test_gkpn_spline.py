import numpy as np
import pytest

from labr_autonomy.gkpn.spline import path_points, spline_matrix


def test_matrix_has_the_papers_size_and_its_rows_sum_to_one():
    a = spline_matrix()
    assert a.shape == (51, 6)
    np.testing.assert_allclose(a.sum(axis=1), 1.0, atol=1e-12)


def test_path_passes_through_the_robot_and_every_key_point():
    np.testing.assert_allclose(spline_matrix()[::10], np.eye(6), atol=1e-12)


def test_a_straight_even_line_stays_straight_and_even():
    line = np.arange(1, 6)[:, None] * np.array([[1.0, -0.5, 0.2]])
    np.testing.assert_allclose(
        path_points(line), np.linspace(0, 5, 51)[:, None] * [[1.0, -0.5, 0.2]], atol=1e-12
    )


def test_slope_is_continuous_at_the_key_points():
    a = spline_matrix(5, 1000)
    before, after = a[1000:5000:1000] - a[999:4999:1000], a[1001:5001:1000] - a[1000:5000:1000]
    assert np.abs(before - after).max() < 1e-5
    assert np.abs(before).max() > 1e-4


def test_a_key_point_moves_only_the_two_segments_on_either_side():
    moved = np.flatnonzero(np.abs(spline_matrix()[:, 3]) > 0)
    assert moved.min() == 11
    assert moved.max() == 49


def test_the_shared_matrix_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        spline_matrix()[0, 0] = 2.0
