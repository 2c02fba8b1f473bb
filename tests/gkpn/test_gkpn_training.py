from dataclasses import replace

import numpy as np
import pytest

from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput
from labr_autonomy.gkpn.infer import GkpnOnnx
from labr_autonomy.gkpn.package import packaged_dir
from labr_autonomy.types import Intrinsics
from sim.dataset import DataConfig, build

torch = pytest.importorskip("torch", reason="training needs the train extra (torch)")
pytest.importorskip(
    "safetensors", reason="reading the weights into torch needs the train extra (safetensors)"
)
from labr_autonomy.gkpn import dataset, train  # noqa: E402
from labr_autonomy.gkpn.evaluate import auc, evaluate, straight_line  # noqa: E402
from labr_autonomy.gkpn.export import load_network  # noqa: E402
from labr_autonomy.gkpn.losses import LossConfig, losses  # noqa: E402
from labr_autonomy.gkpn.network import HEIGHT, WIDTH, Gkpn, NetworkConfig  # noqa: E402
from labr_autonomy.gkpn.onnx_file import onnx_bytes  # noqa: E402

torch.set_num_threads(1)  # small tensors: a second thread only waits
NETWORK_CAMERA = Intrinsics(160, 90, 80.0, 79.5, 80.0, 45.0)
TINY = NetworkConfig(
    stem=4, stages=(8, 8, 8, 8), blocks=(1, 1, 1, 1), embed=8, tail=8, hidden=(16, 16), fear_hidden=8
)


@pytest.fixture(scope="module")
def views(tmp_path_factory):
    path = tmp_path_factory.mktemp("views") / "views.npz"
    np.savez(path, **build(DataConfig(scenes=4, views=8, seed=77), RobotConfig()))
    return dataset.load(path, path)


@pytest.fixture(scope="module")
def few(views):
    """Eight of the views, enough where only the machinery counts."""
    names = ("images_m", "poses", "goals_m", "scene")
    return replace(views, **{name: getattr(views, name)[:8] for name in names})


def random_inputs(count):
    draw = torch.Generator().manual_seed(3)
    depth = torch.rand(count, 1, 90, 160, generator=draw) * 10.0
    return depth, torch.randn(count, 3, generator=draw) * torch.tensor([4.0, 2.0, 1.0])


def test_onnx_file_equals_the_torch_network():
    import onnxruntime

    net = load_network(packaged_dir())
    session = onnxruntime.InferenceSession((packaged_dir() / "gkpn.onnx").read_bytes())
    depth, goal = random_inputs(4)
    for i in range(4):
        with torch.no_grad():
            points, mu = net(depth[i : i + 1], goal[i : i + 1])
        found = session.run(
            ["points", "mu"], {"depth": depth[i : i + 1].numpy(), "goal": goal[i : i + 1].numpy()}
        )
        np.testing.assert_allclose(found[0], points.numpy(), atol=1e-4)
        np.testing.assert_allclose(found[1], mu.numpy(), atol=1e-4)


@pytest.mark.slow
def test_a_freshly_exported_network_is_one_file_with_the_named_inputs():
    import onnx

    model = onnx.load_from_string(onnx_bytes(Gkpn(TINY), torch.ones(1, 1, HEIGHT, WIDTH), torch.ones(1, 3)))
    onnx.checker.check_model(model)
    assert [i.name for i in model.graph.input] == ["depth", "goal"]
    assert [o.name for o in model.graph.output] == ["points", "mu"]
    assert model.opset_import[0].version >= 17


@pytest.mark.slow
def test_several_goals_of_one_image_give_what_single_goals_give():
    net = Gkpn(TINY).eval()
    depth, goal = random_inputs(6)
    with torch.no_grad():
        together, _ = net.plan(net.encode(depth[:2]), goal)
        single = torch.cat([net(depth[i // 3 : i // 3 + 1], goal[i : i + 1])[0] for i in range(6)])
    torch.testing.assert_close(together, single, atol=1e-5, rtol=1e-4)


def test_two_files_become_one_set_with_scenes_of_their_own(views):
    assert len(views) == 64
    assert views.scene.max() == 7
    assert views.seeds == (77, 77)
    assert views.facts()["views"] == 64
    torch.testing.assert_close(views.solids[0], views.solids[4])


def test_a_missing_and_a_wrong_data_file_are_refused(tmp_path):
    with pytest.raises(BadInput, match="no data set"):
        dataset.load(tmp_path / "no.npz")
    np.savez(tmp_path / "other.npz", a=np.zeros(2))
    with pytest.raises(BadInput, match="is no GKPN data set"):
        dataset.load(tmp_path / "other.npz")


@pytest.mark.slow
def test_training_repeats_by_seed_also_across_a_resume(few, tmp_path):
    config = train.TrainConfig(
        steps=4, batch=4, goals=2, network=TINY, threads=1, save_every=2, check_every=100, seed=4
    )
    whole = train.train(few, few, tmp_path / "a", config).state_dict()
    # The same run, stopped after its second step and taken up again from the checkpoint.
    original = train.step_losses

    def stops(net, views, step, config):
        if step == 2:
            raise KeyboardInterrupt
        return original(net, views, step, config)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(train, "step_losses", stops)
        with pytest.raises(KeyboardInterrupt):
            train.train(few, few, tmp_path / "b", config)
    resumed = train.train(few, few, tmp_path / "b", config).state_dict()
    for name, value in whole.items():
        torch.testing.assert_close(resumed[name], value, atol=1e-6, rtol=1e-5)


@pytest.mark.slow
def test_a_few_steps_lower_the_loss(few, tmp_path):
    config = train.TrainConfig(steps=15, batch=8, goals=4, rate=3e-3, network=TINY, threads=1)
    torch.manual_seed(0)
    before = float(train.step_losses(Gkpn(TINY).train(), few, 0, config).total.detach())
    net = train.train(few, few, tmp_path, config)
    after = float(train.step_losses(net.train(), few, 0, config).total.detach())
    assert after < 0.95 * before


def test_learning_rate_rises_and_falls_once():
    config = train.TrainConfig(steps=100)
    rates = [train.rate_at(i, config) for i in range(100)]
    top = int(np.argmax(rates))
    assert 5 <= top <= 15
    assert max(rates) == pytest.approx(config.rate)
    assert (np.diff(rates[top:]) <= 0).all()
    assert rates[-1] < 0.01 * config.rate


def test_mirroring_a_step_changes_nothing_for_the_straight_line(views):
    """The base is symmetric: without offsets the loss is the same mirrored or not."""
    net = Gkpn(TINY).train()
    with torch.no_grad():
        net.lapn.points[2].weight.zero_()
    config = train.TrainConfig(batch=8, goals=2, network=TINY)
    out = train.step_losses(net, views, 1, config)
    draw = torch.Generator().manual_seed(config.seed * 10_000_019 + 1)
    index = torch.randint(0, len(views), (8,), generator=draw)
    order = torch.rand(8, views.goals_m.shape[1], generator=draw).argsort(dim=1)[:, :2]
    goal, each = views.goals_m[index[:, None], order].reshape(-1, 3), index.repeat_interleave(2)
    plain = losses(
        goal[:, None] * net.line,
        torch.zeros(16, 1),
        goal,
        views.poses[each],
        views.solids[views.scene[each]],
        views.floor_m(each),
        config.loss,
    )
    torch.testing.assert_close(out.terms["obstacle"], plain.terms["obstacle"], atol=0.05, rtol=0.02)


def test_auc_of_known_cases():
    label = np.array([0.0, 0.0, 1.0, 1.0])
    assert auc(np.array([0.1, 0.2, 0.3, 0.4]), label) == 1.0
    assert auc(np.array([0.4, 0.3, 0.2, 0.1]), label) == 0.0
    assert auc(np.array([0.1, 0.3, 0.2, 0.4]), label) == 0.75
    assert auc(np.array([0.1, 0.3]), np.ones(2)) is None
    assert auc(np.zeros(4), label) is None


def test_figures_of_the_straight_line_are_consistent(views):
    figures = evaluate(straight_line, views, LossConfig())
    assert figures["paths"] == 4 * len(views)
    assert 0.2 < figures["collision_free"] < 0.95
    assert figures["reached"] == figures["collision_free"]  # it always ends on the goal
    assert figures["collision_free_first_2m"] >= figures["collision_free"]
    assert figures["fear_auc"] is None


@pytest.mark.slow
def test_energy_loss_alone_makes_the_best_path_drive_first_and_climb_at_the_end():
    """The optimum of the losses in an empty place, found by descent from a straight climb."""
    goal = torch.tensor([[6.0, 0.0, 1.5]])
    points = (goal[:, None] * (torch.arange(1, 6) / 5.0)[None, :, None]).requires_grad_()
    far = torch.zeros(1, 1, 8)
    far[..., 1:4], far[..., 4:7] = 1e3, 0.1
    optimiser = torch.optim.Adam([points], 0.05)
    for i in range(120):
        optimiser.param_groups[0]["lr"] = 0.05 if i < 90 else 0.01
        pose = torch.tensor([[0.0, 0.0, 0.12, 0.0]])
        out = losses(points, torch.zeros(1, 1), goal, pose, far, torch.zeros(1), LossConfig())
        optimiser.zero_grad()
        out.total.backward()
        optimiser.step()
    height = points.detach()[0, :, 2].numpy()
    assert np.abs(height[:3]).max() < 0.15
    assert height[4] == pytest.approx(1.5, abs=0.1)


@pytest.mark.slow
def test_shipped_network_lifts_late_on_views_it_never_saw(views):
    net = GkpnOnnx()
    heights = []
    for i in range(32):
        on_wheels = abs(float(views.poses[i, 2]) - 0.12) < 1e-3
        for goal in views.goals_m[i].double().numpy():
            if on_wheels and goal[2] > 0.3 and np.hypot(*goal[:2]) > 4.0:
                image = views.images_m[i].float().numpy()
                heights.append(net.predict(image, NETWORK_CAMERA, goal)[0][:, 2] / goal[2])
    heights = np.array(heights)
    assert len(heights) >= 20
    assert np.median(heights[:, 1]) < 0.15  # two fifths of the way: on the floor
    assert np.median(heights[:, 4]) > 0.85  # arrives at the goal's height
