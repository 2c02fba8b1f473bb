import math
from dataclasses import replace

import numpy as np
import pytest

from labr_autonomy.config import RobotConfig
from sim.dataset import DataConfig, build, land_only
from sim.worlds.primitives import Scene, box, cylinder

torch = pytest.importorskip("torch", reason="training needs the train extra (torch)")
pytest.importorskip("onnx", reason="writing the weights needs the train extra (onnx)")
torch.set_num_threads(1)  # small tensors: a second thread only waits
import onnxruntime  # noqa: E402

from labr_autonomy.gkpn import dataset, train  # noqa: E402
from labr_autonomy.gkpn.evaluate import evaluate, straight_line  # noqa: E402
from labr_autonomy.gkpn.iplanner import IPlannerConfig, published  # noqa: E402
from labr_autonomy.gkpn.iplanner_loss import IPlannerLoss  # noqa: E402
from labr_autonomy.gkpn.losses import LossConfig  # noqa: E402
from sim.bench.iplanner.export import export, load_network  # noqa: E402
from sim.bench.iplanner.weights import IPlannerOnnx, packaged_dir  # noqa: E402

TINY = IPlannerConfig(160, 288, (8, 8, 8, 8), 2, (8, 8), (16, 8), 4, unit_m=10.0)


def count(module):
    return sum(p.numel() for p in module.parameters())


# ---------------------------------------------------------------- network
@pytest.mark.slow
def test_published_size_has_the_authors_parameters_layer_by_layer():
    with torch.device("meta"):
        net = published().build()
    assert count(net) == 53_326_864
    assert count(net.encoder) == 11_168_704
    assert count(net.decoder) == 42_158_160
    layers = net.encoder.layers
    assert [count(layers[i : i + 2]) for i in (0, 2, 4, 6)] == [147_456, 524_544, 2_097_664, 8_389_632]
    decoder = {name: count(child) for name, child in net.decoder.named_children()}
    assert decoder == {
        "goal": 64,
        "conv1": 6_758_912,
        "conv2": 1_179_904,
        "fc1": 33_555_456,
        "fc2": 524_800,
        "fc3": 7_695,
        "frc1": 131_200,
        "frc2": 129,
    }
    depth, goal = torch.empty(2, 1, 360, 640, device="meta"), torch.empty(2, 3, device="meta")
    features = net.encode(depth)
    assert features.shape == (2, 512, 12, 20)
    points, fear = net(depth, goal)
    assert points.shape == (2, 5, 3)
    assert fear.shape == (2, 1)


def test_batch_norm_stands_only_on_the_three_short_cuts():
    found = [n for n, m in TINY.build().named_modules() if isinstance(m, torch.nn.BatchNorm2d)]
    assert found == [f"encoder.layers.{i}.short.1" for i in (2, 4, 6)]


def test_stem_sees_the_depth_in_all_three_channels():
    net, depth = TINY.build().eval().double(), torch.rand(1, 1, 160, 288).double()  # else rounding shows
    three = torch.relu(net.encoder.stem(depth.expand(-1, 3, -1, -1)))
    expected = net.encoder.layers(torch.nn.functional.max_pool2d(three, 3, 2, 1))
    torch.testing.assert_close(net.encoder(depth), expected, atol=1e-5, rtol=1e-4)


def test_several_goals_of_one_image_give_what_single_goals_give():
    net = TINY.build().eval()
    draw = torch.Generator().manual_seed(3)
    depth, goal = torch.rand(2, 1, 160, 288, generator=draw) * 8, torch.randn(6, 3, generator=draw) * 4
    with torch.no_grad():
        points, logit = net.plan(net.encode(depth), goal)
        single, fear = net(depth.repeat_interleave(3, dim=0), goal)
    torch.testing.assert_close(points, single, atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(torch.sigmoid(logit), fear, atol=1e-5, rtol=1e-4)


# ---------------------------------------------------------------- losses
AWAY = np.array([cylinder(500.0, 0.0, 0.1, 0.0, 2.0)])


def judged(points, goal, rows=AWAY, logit=0.0, config=None):
    pose = torch.tensor([[1.0, 2.0, 0.12, math.pi / 2]], dtype=torch.float64)  # looks along odom's y
    return (config or IPlannerLoss()).losses(
        torch.as_tensor(points, dtype=torch.float64)[None],
        torch.tensor([[logit]], dtype=torch.float64),
        torch.as_tensor(goal, dtype=torch.float64)[None],
        pose,
        torch.as_tensor(np.asarray(rows))[None],
        torch.zeros(1, dtype=torch.float64),
    )


def even(goal):
    return np.linspace(0.2, 1.0, 5)[:, None] * np.asarray(goal)


def test_terms_of_an_even_straight_path_in_the_open_are_nothing():
    out = judged(even([5.0, 0.0, 0.0]), [5.0, 0.0, 0.0])
    for name in ("height", "motion", "goal"):
        assert float(out.terms[name]) == pytest.approx(0.0, abs=2e-3)
    assert float(out.terms["obstacle"]) == pytest.approx(51 * math.log(1.00001), abs=1e-9)
    assert float(out.collides) == 0.0


def test_height_is_summed_over_the_51_points_and_the_goal_counts_in_all_three():
    points = even([5.0, 0.0, 0.0]) + np.array([0.0, 0.0, 0.1])
    out = judged(points, [5.0, 0.0, 0.0])
    # 41 points from the first key point on lie at 0.1; below them the spline rises from 0 through ten points
    t = np.arange(10) / 10
    first = 0.1 * ((t**3 - 2 * t**2 + t) + (3 * t**2 - 2 * t**3) + 0.5 * (t**3 - t**2))
    second = 0.1 + 0.1 * 0.5 * (t**3 - 2 * t**2 + t)  # the first key point's tangent still rises
    assert float(out.terms["height"]) == pytest.approx(first.sum() + second.sum() + 31 * 0.1, abs=1e-6)
    assert float(out.terms["goal"]) == pytest.approx(math.log(1.1), abs=1e-6)


def test_motion_is_the_sum_of_the_differences_from_even_steps():
    out = judged(1.5 * even([4.0, 0.0, 0.0]), [4.0, 0.0, 0.0])
    assert float(out.terms["motion"]) == pytest.approx(2.0, abs=1e-3)
    assert float(out.terms["goal"]) == pytest.approx(math.log(3.0), abs=1e-6)


def test_cost_is_the_logarithm_of_the_smoothed_depth_in_cells():
    loss = IPlannerLoss()
    at = torch.tensor([loss.inflate_m, loss.inflate_m - 1.0, loss.inflate_m + 1.0], dtype=torch.float64)
    edge, deep, open_ = (float(v) for v in loss.cost(at))
    assert edge == pytest.approx(math.log(0.125 / math.sqrt(2 * math.pi) / 0.05 + 1.00001))
    assert deep == pytest.approx(math.log(1.0 / 0.05 + 1.00001), abs=1e-6)
    assert open_ == pytest.approx(math.log(1.00001), abs=1e-9)
    # the closed form is what a Gaussian of 2.5 cells makes of the depth behind a straight edge
    s, u = 0.03, np.linspace(-1.5, 1.5, 30001)
    bell = np.exp(-0.5 * (u / 0.125) ** 2) / (0.125 * math.sqrt(2 * math.pi))
    smooth = float((np.maximum(s - u, 0.0) * bell).sum() * (u[1] - u[0]))
    found = float(loss.cost(torch.tensor(loss.inflate_m - s, dtype=torch.float64)))
    assert found == pytest.approx(math.log(smooth / 0.05 + 1.00001), abs=1e-4)


@pytest.mark.parametrize(
    ("bottom", "top", "counts"), [(0.0, 1.0, True), (0.3, 1.0, True), (0.4, 1.0, False), (0.0, 0.03, False)]
)
def test_obstacle_is_what_stands_between_floor_and_the_robots_top(bottom, top, counts):
    half = (top - bottom) / 2
    # three metres ahead of the robot, which stands at (1, 2) and looks along y
    rows = [box([1.0, 5.0, bottom + half], [0.5, 0.2, half], 0.0)]
    out = judged(even([6.0, 0.0, 0.0]), [6.0, 0.0, 0.0], rows)
    cost = float(out.terms["obstacle"])
    assert (cost > 1.0) is counts
    if counts:
        y = 2.0 + np.linspace(0.0, 6.0, 51)
        distance = Scene(np.array(rows)).footprint_distance(np.stack([np.full(51, 1.0), y], axis=1))
        assert cost == pytest.approx(float(IPlannerLoss().cost(torch.tensor(distance)).sum()), rel=1e-3)


@pytest.mark.parametrize(("ahead", "afraid"), [(1.5, 1.0), (3.5, 0.0)])
def test_fear_looks_two_metres_along_the_path(ahead, afraid):
    rows = [box([1.0, 2.0 + ahead + 0.2, 0.5], [0.5, 0.2, 0.5])]
    out = judged(even([6.0, 0.0, 0.0]), [6.0, 0.0, 0.0], rows, logit=2.0)
    assert float(out.collides) == afraid
    said = 1.0 / (1.0 + math.exp(-2.0))
    assert float(out.terms["fear"]) == pytest.approx(-math.log(said if afraid else 1.0 - said), abs=1e-9)


def test_total_is_the_weighted_sum():
    rows = [box([1.0, 4.0, 0.5], [0.5, 0.2, 0.5])]
    out = judged(even([4.0, 1.0, 0.0]) + 0.05, [5.0, 0.0, 0.0], rows)
    weights = {"obstacle": 0.5, "height": 1.0, "motion": 2.0, "goal": 5.0, "fear": 1.0}
    assert set(out.terms) == set(weights)
    expected = sum(weights[name] * float(term) for name, term in out.terms.items())
    assert float(out.total) == pytest.approx(expected, rel=1e-12)


# ---------------------------------------------------------------- data and training
@pytest.fixture(scope="module")
def views(tmp_path_factory):
    path = tmp_path_factory.mktemp("iplanner") / "views.npz"
    config = land_only(DataConfig(scenes=2, views=6, goals=6, seed=78, width=288, height=160))
    np.savez(path, **build(config, RobotConfig()))
    return dataset.load(path)


def test_land_data_has_views_and_goals_on_the_floor_only(views):
    assert views.images_m.shape == (12, 160, 288)
    assert float((views.poses[:, 2] - 0.12).abs().max()) < 1e-6
    assert -0.0501 < float(views.goals_m[..., 2].min()) <= float(views.goals_m[..., 2].max()) <= 1e-6


def test_figures_of_land_data_leave_out_the_air(views):
    figures = evaluate(straight_line, views, LossConfig())
    assert figures["reached"] == figures["reached_land"] == figures["collision_free"]
    assert figures["reached_air"] is None
    assert figures["far_air_key_point_rise_m"] is None


def tiny_run(**changes):
    standard = train.TrainConfig(
        steps=4,
        batch=4,
        goals=2,
        threads=1,
        bfloat16=False,
        save_every=2,
        check_every=100,
        network=TINY,
        loss=IPlannerLoss(),
    )
    return replace(standard, **changes)


@pytest.mark.slow
def test_a_resumed_run_ends_where_the_whole_one_does_and_another_seed_elsewhere(views, tmp_path, monkeypatch):
    whole = train.train(views, views, tmp_path / "a", tiny_run()).state_dict()
    original = train.step_losses

    def stops(net, data, step, config):
        if step == 2:
            raise KeyboardInterrupt
        return original(net, data, step, config)

    with monkeypatch.context() as patch:
        patch.setattr(train, "step_losses", stops)
        with pytest.raises(KeyboardInterrupt):
            train.train(views, views, tmp_path / "b", tiny_run())
    resumed = train.train(views, views, tmp_path / "b", tiny_run()).state_dict()
    for name, value in whole.items():
        assert torch.equal(resumed[name], value), name
    other = train.train(views, views, tmp_path / "c", tiny_run(seed=5)).state_dict()
    assert not torch.allclose(other["decoder.fc3.weight"], whole["decoder.fc3.weight"])


@pytest.mark.slow
def test_a_few_steps_lower_the_loss(views, tmp_path):
    config = tiny_run(steps=20, rate=3e-3)
    torch.manual_seed(0)
    before = float(train.step_losses(TINY.build().train(), views, 0, config).total.detach())
    net = train.train(views, views, tmp_path, config)
    assert float(train.step_losses(net.train(), views, 0, config).total.detach()) < 0.9 * before


# ---------------------------------------------------------------- model file
@pytest.mark.slow
def test_exported_file_stores_half_precision_and_computes_what_torch_does(views, tmp_path):
    export(TINY.build(), tmp_path, views, {"config": {}})
    net, session = load_network(tmp_path), IPlannerOnnx(tmp_path)
    assert (tmp_path / "iplanner.onnx").stat().st_size < 2.2 * count(net) + 20_000
    assert session.manifest["network"]["unit_m"] == 10.0
    depth, goal = views.images_m[0].float(), np.array([3.0, 1.0, 0.0])
    with torch.no_grad():
        points, fear = net(depth[None, None], torch.tensor(goal, dtype=torch.float32)[None])
    camera = RobotConfig().camera.intrinsics  # the image is the camera's view, resized
    found, mu, _ = session.predict(depth.numpy(), camera, goal)
    np.testing.assert_allclose(found, points[0].numpy(), atol=1e-4)
    assert mu == pytest.approx(float(fear), abs=1e-4)


def test_shipped_onnx_file_equals_the_torch_network():
    net = load_network(packaged_dir())
    session = onnxruntime.InferenceSession((packaged_dir() / "iplanner.onnx").read_bytes())
    draw = torch.Generator().manual_seed(4)
    size = (net.config.height, net.config.width)
    for _ in range(2):
        depth = torch.rand(1, 1, *size, generator=draw) * 10.0
        goal = torch.randn(1, 3, generator=draw) * torch.tensor([4.0, 2.0, 0.02])
        with torch.no_grad():
            points, fear = net(depth, goal)
        found = session.run(["points", "mu"], {"depth": depth.numpy(), "goal": goal.numpy()})
        np.testing.assert_allclose(found[0], points.numpy(), atol=1e-4)
        np.testing.assert_allclose(found[1], fear.numpy(), atol=1e-4)
