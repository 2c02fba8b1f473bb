"""mu of the network that ships, on frames unlike its training data: it goes up, not down."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from d435_recording import depth_images_m

from labr_autonomy.gkpn.infer import GkpnOnnx
from labr_autonomy.gkpn.package import packaged_dir
from labr_autonomy.types import Intrinsics

SHARED = Path(os.environ.get("LABR_SHARED") or Path(__file__).resolve().parents[2].parent / "shared")
RECORDING = SHARED / "data" / "camera" / "realsense_d435_bag" / "single_depth_color_640x480.bag"
RECORDED_WITH = Intrinsics(640, 480, 390.431, 390.431, 331.388, 242.187)  # SOURCE.md beside the recording
GOALS_M = [(3.0, 0.0, 0.0), (5.0, 1.5, 0.0), (5.0, -1.5, 0.0), (4.0, 0.0, 1.5), (6.0, 2.0, 1.0)]


@pytest.fixture(scope="module")
def said():
    return json.loads((packaged_dir() / "manifest.json").read_text())["metrics"]["mean_mu"]


@pytest.mark.parametrize("kind", ["empty", "saturated", "upside_down", "on_its_side", "torn", "noise"])
def test_a_spoiled_frame_is_feared_more_than_a_seen_one(said, kind):
    """Over unseen views, the maps as they were (figures taken when the weights were written)."""
    assert said[kind] > said["as_seen"] + 0.2


def test_a_real_cameras_frames_are_feared_more_than_simulated_ones(said):
    """A desk from a hand's breadth away, without a map: no place that this robot was trained in."""
    if not RECORDING.exists():
        pytest.skip("needs the D435 recording of the shared data")
    network = GkpnOnnx()
    mu = [
        network.predict(depth_m, RECORDED_WITH, np.array(goal))[1]
        for depth_m in depth_images_m(RECORDING)
        for goal in GOALS_M
    ]
    assert np.mean(mu) > said["as_seen"] + 0.1
