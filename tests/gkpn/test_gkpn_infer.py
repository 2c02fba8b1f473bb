import json
import shutil
import subprocess
import sys

import numpy as np
import pytest

from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput
from labr_autonomy.gkpn.infer import GkpnOnnx, drawn_in
from labr_autonomy.gkpn.package import packaged_dir
from labr_autonomy.gkpn.resample import network_image
from labr_autonomy.types import Intrinsics

CAMERA = RobotConfig().camera.intrinsics


@pytest.fixture(scope="module")
def net():
    return GkpnOnnx()


def floor_view(height_m=0.18, intrinsics=CAMERA):
    """Depth of an endless flat floor."""
    below = (np.arange(intrinsics.height) + 0.5 - intrinsics.cy) / intrinsics.fy
    depth = np.where(below > 0, height_m / np.maximum(below, 1e-6), 0.0)
    depth[depth > 10.0] = 0.0
    return np.repeat(depth[:, None], intrinsics.width, axis=1).astype(np.float32)


def corridor_view(half_width_m=1.2):
    """Depth of a floor between two endless walls."""
    side = np.abs((np.arange(CAMERA.width) + 0.5 - CAMERA.cx) / CAMERA.fx)
    wall = half_width_m / np.maximum(side, 1e-6)
    wall[wall > 10.0] = 0.0
    floor, wall = floor_view(), np.repeat(wall[None], CAMERA.height, axis=0).astype(np.float32)
    both = np.where((floor > 0) & (wall > 0), np.minimum(floor, wall), np.maximum(floor, wall))
    return both.astype(np.float32)


@pytest.mark.parametrize("goal", [[5.0, 0.0, 0.0], [3.0, 0.0, 0.0], [7.0, 0.0, 0.0]])
def test_a_free_corridor_gives_a_nearly_straight_path_on_the_floor(net, goal):
    points, mu, latency_s = net.predict(corridor_view(), CAMERA, np.array(goal))
    assert points.shape == (5, 3)
    assert points.dtype == np.float64
    assert np.abs(points[:, 1]).max() < 0.35
    assert np.abs(points[:, 2]).max() < 0.15
    assert (np.diff(points[:, 0], prepend=0.0) > 0.3).all()
    assert np.linalg.norm(points[-1, :2] - goal[:2]) < 0.25
    assert mu < 0.5
    assert latency_s > 0.0


def test_an_air_goal_is_driven_to_first_and_climbed_to_near_the_end(net):
    points, _, _ = net.predict(floor_view(), CAMERA, np.array([6.0, 0.5, 1.5]))
    assert np.abs(points[:3, 2]).max() < 0.2
    assert points[-1] == pytest.approx([6.0, 0.5, 1.5], abs=0.3)


def test_a_wall_across_the_way_raises_the_collision_probability(net):
    wall = floor_view()
    wall[(wall > 1.2) | (wall == 0.0)] = 1.2
    goal = np.array([5.0, 0.0, 0.0])
    assert net.predict(wall, CAMERA, goal)[1] > 0.5 > net.predict(floor_view(), CAMERA, goal)[1]


def test_a_frame_without_any_valid_depth_still_gives_finite_points(net):
    for depth in (np.zeros((240, 424)), np.full((240, 424), np.nan), np.full((240, 424), 60.0)):
        points, mu, _ = net.predict(depth.astype(np.float32), CAMERA, np.array([4.0, 1.0, 0.0]))
        assert np.isfinite(points).all()
        assert 0.0 <= mu <= 1.0


def test_a_goal_that_is_no_place_is_refused(net):
    for goal in ([1.0, np.nan, 0.0], [1.0, 2.0]):
        with pytest.raises(BadInput, match="not three finite numbers"):
            net.predict(floor_view(), CAMERA, np.array(goal))


def test_far_goals_are_drawn_in_along_their_bearing_and_keep_their_height():
    np.testing.assert_allclose(drawn_in(np.array([18.0, 24.0, 1.5]), 9.0), [5.4, 7.2, 1.5])
    near = np.array([3.0, -4.0, 2.0])
    assert drawn_in(near, 9.0) is near


def test_the_same_view_from_another_camera_gives_nearly_the_same_network_image():
    wide = Intrinsics(848, 480, 424.0, 424.0, 424.0, 240.0)
    a = network_image(floor_view(), CAMERA)
    b = network_image(floor_view(intrinsics=wide), wide)
    both = (a > 0) & (b > 0)
    assert both.mean() > 0.4
    assert (np.abs(a - b)[both] / a[both]).max() < 0.06


def test_what_a_narrow_camera_does_not_see_is_invalid():
    narrow = Intrinsics(640, 480, 600.0, 600.0, 320.0, 240.0)
    image = network_image(np.full((480, 640), 2.0, np.float32), narrow)
    seen = image > 0
    assert seen[45, 80]
    assert not seen[:, :30].any()
    assert not seen[:, -30:].any()
    np.testing.assert_allclose(image[seen], 2.0, rtol=1e-5)


def test_invalid_pixels_take_no_part_in_the_mean():
    depth = np.full((240, 424), 3.0, np.float32)
    depth[::2] = 0.0
    np.testing.assert_allclose(network_image(depth, CAMERA), 3.0, rtol=1e-5)


def test_a_scaled_image_is_the_same_view():
    depth = np.tile(np.linspace(1.0, 4.0, 424, dtype=np.float32), (240, 1))
    half = depth[::2].reshape(120, 212, 2).mean(axis=2)
    np.testing.assert_allclose(network_image(half, CAMERA), network_image(depth, CAMERA), atol=0.01)


def copy_weights(folder):
    for file in packaged_dir().iterdir():
        shutil.copyfile(file, folder / file.name)


def test_damaged_weights_are_refused_in_one_sentence(tmp_path):
    copy_weights(tmp_path)
    content = bytearray((tmp_path / "gkpn.onnx").read_bytes())
    content[len(content) // 2] ^= 1
    (tmp_path / "gkpn.onnx").write_bytes(content)
    with pytest.raises(BadInput, match=r"gkpn\.onnx are damaged: sha256 \w{12}, not \w{12} as listed"):
        GkpnOnnx(tmp_path)


@pytest.mark.parametrize(
    ("break_it", "says"),
    [
        (lambda d: (d / "gkpn.onnx").unlink(), r"gkpn\.onnx cannot be read"),
        (lambda d: (d / "manifest.json").unlink(), r"manifest\.json cannot be read"),
        (lambda d: (d / "manifest.json").write_text("{"), r"is not JSON"),
        (lambda d: (d / "manifest.json").write_text('{"format": 99}'), r"not of format 1"),
        (lambda d: (d / "manifest.json").write_text('{"format": 1}'), r"does not list gkpn\.onnx"),
    ],
)
def test_incomplete_weights_are_refused(tmp_path, break_it, says):
    copy_weights(tmp_path)
    break_it(tmp_path)
    with pytest.raises(BadInput, match=says):
        GkpnOnnx(tmp_path)


def test_manifest_names_both_files_the_training_and_the_figures_with_their_baseline():
    manifest = json.loads((packaged_dir() / "manifest.json").read_text())
    assert set(manifest["files"]) == {"gkpn.onnx", "gkpn.safetensors"}
    assert sum(file["bytes"] for file in manifest["files"].values()) < 11e6
    assert manifest["parameters"] <= 3.0e6
    training = manifest["training"]
    assert training["settings"]["weights"]["energy"] > 0
    assert training["data"]["seeds"][1] < training["validation"]["seeds"][0]
    network, line = manifest["metrics"]["network"], manifest["metrics"]["straight_line"]
    for key in ("collision_free", "reached", "collision_free_first_2m"):
        assert network[key] > line[key] + 0.1
    assert network["goal_error_median_m"] < 0.2
    assert network["mu_auc"] > 0.85
    assert network["mu_calibration_error"] < 0.05


def test_shipped_network_drives_first_and_climbs_near_the_goal():
    """On the validation views' far air goals (figures taken when the weights were written)."""
    network = json.loads((packaged_dir() / "manifest.json").read_text())["metrics"]["network"]
    assert network["far_air_goals_lifted"] > 0.95
    assert network["far_air_driven_share_median"] > 0.6
    assert network["far_air_lift_before_goal_median_m"] < 3.0
    assert network["far_air_key_point_rise_m"][1] < 0.2
    assert network["land_goals_flown_to"] < 0.1


def test_the_shipped_files_say_the_same():
    """What flies (ONNX) and what can be trained on (safetensors) give the same key points and mu."""
    torch = pytest.importorskip("torch", reason="training needs the train extra (torch)")
    from labr_autonomy.gkpn.learning.export import load_network
    from labr_autonomy.gkpn.networks.planner import examples
    from labr_autonomy.gkpn.package import ONNX_NAME, read_verified
    from labr_autonomy.gkpn.runtime import start

    net, flown = load_network(packaged_dir()), start(read_verified(packaged_dir(), ONNX_NAME))
    draw = torch.Generator().manual_seed(1)
    for _ in range(5):
        inputs = [torch.rand(one.shape, generator=draw) for one in examples(net.config)]
        inputs[0] *= 9.0
        inputs[1] *= 5.0
        found = flown.run(dict(zip(flown.inputs, [one.numpy() for one in inputs], strict=True)))
        with torch.no_grad():
            for expected, value in zip(net(*inputs), found, strict=True):
                assert np.abs(expected.numpy() - value).max() < 1e-4


def test_inference_does_not_import_torch():
    code = "import sys, labr_autonomy.gkpn.infer; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=15, check=False).returncode == 0
