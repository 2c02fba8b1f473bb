"""Networks by configuration: sizes beside the paper's Table 2, shapes, goals of one image, ONNX."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import numpy as np
import pytest
from click.testing import CliRunner

torch = pytest.importorskip("torch", reason="training needs the train extra (torch)")
pytest.importorskip("onnx", reason="exporting needs the train extra (onnx)")
from labr_autonomy import cli  # noqa: E402
from labr_autonomy.gkpn.local_map import SHOWN, SIDE  # noqa: E402
from labr_autonomy.gkpn.networks.config import (  # noqa: E402
    AttentionConfig,
    ConcatConfig,
    MapConfig,
    NetworkConfig,
    PerceptionConfig,
    RevisionConfig,
)
from labr_autonomy.gkpn.networks.planner import build, examples, from_values  # noqa: E402
from labr_autonomy.gkpn.networks.presets import NETWORKS  # noqa: E402
from labr_autonomy.gkpn.networks.presets import PAPER as PAPER_NETWORKS  # noqa: E402
from labr_autonomy.gkpn.onnx_file import onnx_bytes  # noqa: E402
from labr_autonomy.gkpn.runtime import start  # noqa: E402

TINY = PerceptionConfig(stem=4, stages=(8, 8, 8, 8), blocks=(1, 1, 1, 1))
ATTENTION = AttentionConfig(embed=8, tail=8, hidden=(16, 16), fear=8)
CONCAT = ConcatConfig(goal=4, tail=(8, 8), hidden=(16, 16), fear=8)
TINY_MAP = PerceptionConfig(edges=False, stem=4, stages=(8, 8, 8), blocks=(1, 1, 1), strides=(1, 2, 2))
SMALL_MAP = MapConfig(TINY_MAP, 8, 8)
TINY_NETWORKS = [
    NetworkConfig(perception=TINY, planning=ATTENTION),
    NetworkConfig(perception=replace(TINY, edges=False), planning=CONCAT, from_line=False, unit_m=1.0),
    NetworkConfig(perception=TINY, planning=ATTENTION, map=SMALL_MAP, hypotheses=3),
    NetworkConfig(perception=TINY, planning=ATTENTION, map=SMALL_MAP, revision=RevisionConfig(2, 5, 4, 4, 8)),
]


def test_table_2_gives_sizes_within_two_percent_of_the_papers(tmp_path):
    done = CliRunner().invoke(
        cli.main, ["bench", "table2", "--rounds", "0", "--json", "--out", str(tmp_path)]
    )
    assert done.exit_code == 0, done.output
    rows = {row["method"]: row for row in json.loads(done.stdout)["rows"]}
    assert list(rows) == [*PAPER_NETWORKS, "shipped"]
    for name in PAPER_NETWORKS:
        for key, stated in rows[name]["paper"].items():
            assert rows[name][key] == pytest.approx(stated, rel=0.02), (name, key)
    assert rows["shipped"]["params_m"] <= 3.0
    assert rows["shipped"]["flops_g"] <= 1.0
    assert "SPN + LAPN" in (tmp_path / "results.md").read_text()


def _inputs(config, batch=2):
    draw = torch.Generator().manual_seed(5)
    depth = torch.rand(batch, 1, config.height, config.width, generator=draw) * 9.0
    maps = [torch.rand(batch, SHOWN, SIDE, SIDE, generator=draw)] if config.map else []
    return depth, maps


def _floor(config, goals):
    return [torch.linspace(-1.5, 0.0, len(goals))[:, None]] if config.revision else []


@pytest.mark.parametrize("config", TINY_NETWORKS)
def test_many_goals_of_an_image_plan_as_each_alone(config):
    net = build(config).eval()
    depth, maps = _inputs(config)
    goals = torch.tensor([[3.0, 0.5, 0.0], [2.0, -1.0, 1.2], [5.0, 2.0, 0.0], [1.0, 0.0, 0.9]])
    with torch.no_grad():
        floor = _floor(config, goals)
        together, logit = net.plan(net.encode(depth, *maps), goals, *floor)
        for k, goal in enumerate(goals):
            i = k // 2
            alone, mu = net(
                depth[i : i + 1], goal[None], *[m[i : i + 1] for m in maps], *[f[k : k + 1] for f in floor]
            )
            assert torch.allclose(together[k], alone[0], atol=1e-5)
            assert torch.allclose(torch.sigmoid(logit[k]), mu[0], atol=1e-5)
    assert together.shape == (4, config.hypotheses, 5, 3)


@pytest.mark.parametrize("config", TINY_NETWORKS)
def test_a_configuration_survives_json(config):
    assert from_values(json.loads(json.dumps(asdict(config)))) == config


def test_every_preset_survives_json():
    for config in NETWORKS.values():
        assert from_values(json.loads(json.dumps(asdict(config)))) == config


@pytest.mark.parametrize("config", TINY_NETWORKS)
def test_onnx_gives_what_torch_gives(config):
    net = build(config).eval()
    depth, maps = _inputs(config, batch=1)
    goal = torch.tensor([[4.0, 1.0, 0.8]])
    floor = _floor(config, goal)
    model = onnx_bytes(net, *examples(config))
    feed = {"depth": depth.numpy(), "goal": goal.numpy()}
    feed |= {"map": maps[0].numpy()} if maps else {}
    feed |= {"floor": floor[0].numpy()} if floor else {}
    points, mu = start(model, 1).run(feed)
    with torch.no_grad():
        expected, chance = net(depth, goal, *maps, *floor)
    assert np.abs(points - expected.numpy()).max() < 1e-4
    assert np.abs(mu - chance.numpy()).max() < 1e-4


def test_a_depth_of_several_metres_moves_the_edges_but_not_flat_walls():
    """The Sobel branch sees a step in depth and nothing on a wall straight ahead."""
    from labr_autonomy.gkpn.networks.perception import Sobel

    wall = torch.full((1, 1, 9, 16), 4.0)
    step = wall.clone()
    step[..., 8:] = 6.0
    assert not Sobel()(wall).any()
    assert Sobel()(step)[0, 0, 4, 7:9].tolist() == pytest.approx([1.0, 1.0])


def test_a_look_finds_on_the_map_what_lies_on_the_path():
    """The places that are sampled are those of `local_map`: a wall 2 m ahead is met there, not elsewhere."""
    from labr_autonomy.gkpn.local_map import BEHIND_M, CELL_M
    from labr_autonomy.gkpn.networks.revision import Look

    look = Look(RevisionConfig(point=1, every=1), 1, 1, 5)
    look.point.weight.data.zero_()
    look.point.weight.data[0, 0] = 1.0  # the map's only channel, on the path itself
    look.point.bias.data.zero_()
    stack = torch.zeros(1, 1, SIDE, SIDE)
    row, column = int((2.0 + BEHIND_M) / CELL_M), int((1.0 / CELL_M) + 0.5 * SIDE)
    stack[0, 0, row - 1 : row + 2, column - 1 : column + 2] = 1.0
    nothing = torch.zeros(1, 1, 8, 8)

    def seen(left_m):
        path = (
            torch.tensor([[0.8, left_m, 0.0]]) * torch.tensor([1.0, 0.0, 1.0]) * torch.arange(1, 6)[:, None]
        )
        path[:, 1] = left_m
        with torch.no_grad():
            return look(path[None, None], torch.zeros(1, 1), stack, nothing)[0, 0]

    hit = seen(1.0)
    places = (hit > 0.5).nonzero()[:, 0] * 0.8 * 5 / 50  # evenly spaced key points: even steps
    assert len(places) > 1
    assert places.min() >= 2.0 - 2 * CELL_M
    assert places.max() <= 2.0 + 2 * CELL_M
    assert not seen(-1.0).any()


def test_a_revision_starts_as_next_to_nothing_and_its_mu_moves_no_path():
    config = TINY_NETWORKS[-1]
    net = build(config).eval()
    depth, maps = _inputs(config, batch=1)
    every, logit = net.stages(net.encode(depth, *maps), torch.tensor([[3.0, 0.5, 0.0]]), torch.zeros(1, 1))
    assert len(every) == config.revision.steps + 1
    assert (every[-1] - every[0]).abs().max() < 0.5
    logit.sum().backward()
    assert all(step[2].weight.grad is None for step in net.revision.steps)
