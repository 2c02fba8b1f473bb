"""Calibration of mu, and the weights' folder that a run leaves."""

import json

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("onnx")

from learning_rig import shard  # noqa: E402

from labr_autonomy.gkpn.choice import chosen  # noqa: E402
from labr_autonomy.gkpn.infer import GkpnOnnx  # noqa: E402
from labr_autonomy.gkpn.learning.calibration import auc, calibration_error, platt, reliability  # noqa: E402
from labr_autonomy.gkpn.learning.export import export, load_network  # noqa: E402
from labr_autonomy.gkpn.learning.figures import judge_paths, straight_line, summary  # noqa: E402
from labr_autonomy.gkpn.learning.settings import Settings  # noqa: E402
from labr_autonomy.gkpn.learning.spoiled import KINDS  # noqa: E402
from labr_autonomy.gkpn.learning.views import join  # noqa: E402
from labr_autonomy.gkpn.local_map import CHANNELS  # noqa: E402
from labr_autonomy.gkpn.networks.planner import build  # noqa: E402
from labr_autonomy.gkpn.networks.presets import find_network  # noqa: E402
from labr_autonomy.gkpn.package import ONNX_NAME  # noqa: E402
from labr_autonomy.gkpn.runtime import start  # noqa: E402
from labr_autonomy.types import Intrinsics  # noqa: E402


@pytest.fixture(scope="module")
def views():
    return join([shard(seed=s, views=12) for s in range(4)])


def test_auc_is_the_share_of_pairs_in_order():
    rng = np.random.default_rng(0)
    score, label = np.round(rng.random(60), 1), rng.random(60) < 0.4
    pairs = [1.0 if a > b else 0.5 if a == b else 0.0 for a in score[label] for b in score[~label]]
    assert auc(score, label) == pytest.approx(sum(pairs) / len(pairs), abs=1e-4)
    assert auc(score, np.zeros(60, bool)) is None


def test_calibration_error_is_zero_for_honest_and_large_for_sure_and_wrong():
    rng = np.random.default_rng(1)
    mu = rng.random(200_000)
    honest = rng.random(len(mu)) < mu
    assert calibration_error(mu, honest) < 0.01
    assert calibration_error(np.full(1000, 0.99), np.zeros(1000, bool)) == pytest.approx(0.99, abs=1e-3)
    rows = reliability(mu, honest)
    assert sum(row["paths"] for row in rows) == len(mu)


def test_platt_mends_a_mu_that_is_too_sure():
    rng = np.random.default_rng(2)
    truth = rng.normal(0.0, 1.5, 20_000)
    hit = rng.random(len(truth)) < 1.0 / (1.0 + np.exp(-truth))
    scale, shift = platt(3.0 * truth + 1.0, hit)
    assert scale == pytest.approx(1.0 / 3.0, rel=0.05)
    assert shift == pytest.approx(-1.0 / 3.0, abs=0.05)
    assert platt(truth, np.ones(len(truth), bool)) == (1.0, 0.0)


def test_the_straight_line_is_free_where_it_is_not_blocked(views):
    paths = judge_paths(straight_line, views)
    driven = ~paths["air"] & ~paths["airborne"]
    agree = paths["hit"][driven] == paths["hard"][driven]
    assert agree.mean() > 0.95
    figures = summary(paths, views.families)
    assert figures["goal_error_median_m"] < 0.01
    assert figures["mu_auc"] is None
    assert figures["collision_free_by_family"].keys() == {"hall"}


def test_the_cheapest_of_the_safe_paths_is_taken():
    line = np.arange(1, 6)[:, None] * np.array([1.0, 0.0, 0.0])
    detour = line + np.array([0.0, 1.0, 0.0])
    hop = line + np.array([0.0, 0.0, 1.0])
    points = np.stack([hop, detour, line])[None]
    assert chosen(points, np.array([[0.1, 0.1, 0.11]]), 0.0)[0] == 2
    assert chosen(points, np.array([[0.1, 0.1, 0.9]]), 0.0)[0] == 1
    assert chosen(points, np.array([[0.1, 0.9, 0.9]]), 0.0)[0] == 0


@pytest.mark.parametrize("name", ["labr", "iplanner-160"])
def test_what_is_written_computes_what_was_trained(views, tmp_path, name):
    torch.manual_seed(0)
    net = build(find_network(name))
    settings = Settings(name="t", network=name)
    metrics = export(net, tmp_path, settings, {"seed": 0, "loss": 1.0, "steps": 1}, views)
    assert metrics["calibration"]["figures"]["mu_calibration_error"] < 0.2
    assert set(metrics["mean_mu"]) == {"as_seen", *KINDS}
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert manifest["name"] == name
    again = load_network(tmp_path)
    onnx = start((tmp_path / ONNX_NAME).read_bytes())
    for view in range(6):
        index = np.array([view])
        image, seen = views.images_m(index), views.local_maps(index)
        goal = torch.from_numpy(views.goals_m[view, :1])
        feed = {"depth": image.numpy(), "goal": goal.numpy()}
        floor = torch.from_numpy(views.floor_m[index, None])
        if again.config.map is not None:
            feed |= {"map": seen.numpy(), "floor": floor.numpy()}
        with torch.no_grad():
            for one in (net, again):
                points, mu = one(image, goal, seen, floor)
                found = onnx.run(feed)
                np.testing.assert_allclose(found[0], points.numpy(), atol=1e-4)
                np.testing.assert_allclose(found[1], mu.numpy(), atol=1e-4)
    flown = GkpnOnnx(tmp_path)
    assert flown.takes_map == (name == "labr")
    assert flown.range_m == 7.0
    camera = Intrinsics(160, 90, 80.0, 79.5, 80.0, 45.0)
    seen = views.local_maps(np.array([0]))[0, :CHANNELS].numpy().astype(np.uint8) if flown.takes_map else None
    keys, mu, _ = flown.predict(
        views.images_m(np.array([0]))[0, 0].numpy(), camera, views.goals_m[0, 0], seen
    )
    assert keys.shape == (5, 3)
    assert 0.0 < mu < 1.0
