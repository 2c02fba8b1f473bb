from __future__ import annotations

import numpy as np
import pytest

from labr_autonomy.config import Camera
from sim.camera.noise import D435i, flawed_depth

INTRINSICS = Camera().intrinsics
FB = 424.0 * 0.05  # [px m] at 848 columns


def flat(depth_m):
    return np.full((240, 424), depth_m, np.float32)


@pytest.mark.parametrize("depth_m", [0.8, 1.8, 3.0, 5.0])
def test_the_spread_grows_with_the_square_of_the_distance(depth_m):
    measured = flawed_depth(flat(depth_m), INTRINSICS, 1)
    errors = measured[measured > 0] - depth_m
    sigma = 0.1 * depth_m**2 / FB
    assert errors.std() == pytest.approx(sigma, rel=0.08)  # steps and millimetres beat
    assert abs(errors.mean()) < 0.2 * sigma
    # As recorded with a real D435: 0.07 to 0.13 px of disparity.
    assert 0.07 < (FB / measured[measured > 0]).std() < 0.13


def test_distances_come_in_millimetres_and_disparity_steps():
    measured = flawed_depth(flat(8.0), INTRINSICS, 1).astype(float)
    assert np.abs(measured * 1000 - np.rint(measured * 1000)).max() < 1e-3
    steps = 32 * FB / measured[measured > 0]
    assert np.abs(steps - np.rint(steps)).max() < 0.02


@pytest.mark.parametrize("depth_m", [0.5, 1.0, 2.5])
def test_the_left_band_is_dead_as_wide_as_the_disparity(depth_m):
    dead = (flawed_depth(flat(depth_m), INTRINSICS, 1) == 0).all(axis=0)
    assert dead.sum() == pytest.approx(FB / depth_m / 2, abs=1)
    assert dead[: dead.sum()].all()


def test_background_left_of_a_near_object_is_hidden():
    depth = flat(4.0)
    depth[:, 200:300] = 1.0
    hidden = flawed_depth(depth, INTRINSICS, 1) == 0
    shadow = (FB / 1.0 - FB / 4.0) / 2
    assert hidden[:, 200 - int(shadow) + 1 : 200].all()
    assert hidden[:, 320:].mean() < 0.01
    assert 0.3 < hidden[:, 298:302].mean() < 0.9  # about the other edge holes, no shadow
    assert hidden[:, 210:290].mean() < 0.01


def test_outside_the_range_is_invalid():
    for depth_m in (0.0, 0.2, 40.0):
        assert not flawed_depth(flat(depth_m), INTRINSICS, 1).any()
    assert not flawed_depth(flat(3.0), INTRINSICS, 1, D435i(range_max_m=2.0)).any()


def test_a_seed_is_a_frame():
    a, b, c = (flawed_depth(flat(2.0), INTRINSICS, seed) for seed in (1, 1, 2))
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)
    alike = np.corrcoef((a - c)[:, 40:].ravel(), a[:, 40:].ravel())[0, 1]
    assert alike == pytest.approx(np.sqrt(0.5), abs=0.02)  # two frames are independent


def test_the_share_of_invalid_pixels_is_as_recorded():
    """Real D435: 4 to 14 % in furnished rooms. Boxes before a wall at 3 m, floor below."""
    depth = flat(3.0)
    v = np.arange(240)[:, None]
    depth[121:] = np.minimum(3.0, 212 * 0.3 / (v[121:] - 120))
    depth[90:180, 60:130] = 1.5
    depth[100:170, 250:280] = 1.0
    depth[60:150, 330:400] = 2.0
    for u in (150, 165, 195, 210, 225):  # legs of chairs
        depth[80:150, u : u + 4] = 2.0
    measured = flawed_depth(depth.astype(np.float32), INTRINSICS, 1)
    assert 0.04 < (measured == 0).mean() < 0.14
