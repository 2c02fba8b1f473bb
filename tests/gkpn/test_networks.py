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
from labr_autonomy.gkpn.infer import session  # noqa: E402
from labr_autonomy.gkpn.local_map import CHANNELS, SIDE  # noqa: E402
from labr_autonomy.gkpn.networks.config import (  # noqa: E402
    AttentionConfig,
    ConcatConfig,
    MapConfig,
    NetworkConfig,
    PerceptionConfig,
)
from labr_autonomy.gkpn.networks.planner import build, from_values  # noqa: E402
from labr_autonomy.gkpn.networks.presets import NETWORKS  # noqa: E402
from labr_autonomy.gkpn.networks.presets import PAPER as PAPER_NETWORKS  # noqa: E402
from labr_autonomy.gkpn.onnx_file import onnx_bytes  # noqa: E402

TINY = PerceptionConfig(stem=4, stages=(8, 8, 8, 8), blocks=(1, 1, 1, 1))
ATTENTION = AttentionConfig(embed=8, tail=8, hidden=(16, 16), fear=8)
CONCAT = ConcatConfig(goal=4, tail=(8, 8), hidden=(16, 16), fear=8)
TINY_MAP = PerceptionConfig(edges=False, stem=4, stages=(8, 8, 8), blocks=(1, 1, 1), strides=(1, 2, 2))
SMALL_MAP = MapConfig(TINY_MAP, 8, 8)
TINY_NETWORKS = [
    NetworkConfig(perception=TINY, planning=ATTENTION),
    NetworkConfig(perception=replace(TINY, edges=False), planning=CONCAT, from_line=False, unit_m=1.0),
    NetworkConfig(perception=TINY, planning=ATTENTION, map=SMALL_MAP, hypotheses=3),
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
    maps = [torch.rand(batch, CHANNELS, SIDE, SIDE, generator=draw)] if config.map else []
    return depth, maps


@pytest.mark.parametrize("config", TINY_NETWORKS)
def test_many_goals_of_an_image_plan_as_each_alone(config):
    net = build(config).eval()
    depth, maps = _inputs(config)
    goals = torch.tensor([[3.0, 0.5, 0.0], [2.0, -1.0, 1.2], [5.0, 2.0, 0.0], [1.0, 0.0, 0.9]])
    with torch.no_grad():
        together, logit = net.plan(net.encode(depth, *maps), goals)
        for k, goal in enumerate(goals):
            i = k // 2
            alone, mu = net(depth[i : i + 1], goal[None], *[m[i : i + 1] for m in maps])
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
    model = onnx_bytes(net, *maps, height=config.height, width=config.width)
    feed = {"depth": depth.numpy(), "goal": goal.numpy()}
    feed |= {"map": maps[0].numpy()} if maps else {}
    points, mu = session(model, 1).run(["points", "mu"], feed)
    with torch.no_grad():
        expected, chance = net(depth, goal, *maps)
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
