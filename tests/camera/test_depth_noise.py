from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from d435_recording import depth_images_m

from labr_autonomy.config import Camera
from sim.camera.noise import D435i, flawed_depth

INTRINSICS = Camera().intrinsics
SHARED = Path(os.environ.get("LABR_SHARED") or Path(__file__).resolve().parents[2].parent / "shared")
RECORDING = SHARED / "data" / "camera" / "realsense_d435_bag" / "single_depth_color_640x480.bag"
FB = 424.0 * 0.05  # [px m] at 848 columns


def flat(depth_m):
    return np.full((240, 424), depth_m, np.float32)


@pytest.mark.parametrize(
    ("depth_m", "least_px", "most_px"),
    [(0.5, 0.07, 0.09), (1.0, 0.09, 0.11), (1.8, 0.12, 0.135), (2.3, 0.19, 0.21), (5.0, 0.19, 0.21)],
)
def test_the_spread_is_as_recorded_with_a_real_d435(depth_m, least_px, most_px):
    """0.07 to 0.13 px of disparity up to 1.8 m, 0.2 px at 2.3 m, hence sigma_z = sigma z^2 / (f B)."""
    measured = flawed_depth(flat(depth_m), INTRINSICS, 1)
    seen = measured[measured > 0]
    assert least_px < (FB / seen).std() < most_px
    assert (seen - depth_m).std() == pytest.approx((FB / seen).std() * depth_m**2 / FB, rel=0.08)
    assert abs((seen - depth_m).mean()) < 0.2 * (seen - depth_m).std()


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


@pytest.mark.slow
@pytest.mark.skipif(not RECORDING.exists(), reason="the recording of a D435 is not beside the checkout")
def test_a_real_recording_has_these_flaws():
    """Two pictures from a camera at rest: what differs between them is noise."""
    first, second = depth_images_m(RECORDING)
    fb = 390.431 * 0.05017  # [px m] of the recording; 640 columns
    both = (first > 0) & (second > 0)
    step_px = np.where(both, fb / np.maximum(first, 0.1) - fb / np.maximum(second, 0.1), 0.0)
    for near_m, far_m in ((0.4, 0.8), (0.8, 1.2), (1.2, 1.8), (2.1, 2.6)):
        band = both & (first >= near_m) & (first < far_m)
        recorded_px = np.subtract(*np.percentile(step_px[band], [84, 16])) / 2 / np.sqrt(2)
        recorded_px *= 424.0 / 390.431  # at the focal length of 848 columns
        drawn = flawed_depth(flat(np.median(first[band])), INTRINSICS, 1)
        assert 0.75 < (FB / drawn[drawn > 0]).std() / recorded_px < 1.3
    assert 0.04 < (first == 0).mean() < 0.14
    dead = (first == 0).mean(axis=0) > 0.95
    assert 15 <= np.argmin(dead) <= 30  # as wide as the disparity of what stands at the left
