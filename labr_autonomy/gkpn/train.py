"""Training GKPN (`python -m labr_autonomy.gkpn.train`): imperative learning by the losses alone, no labels.

The loop trains any network and loss of `labr_autonomy.gkpn.learner`, the benchmark's iPlanner among them.

Deterministic by seed (each step draws from a generator seeded by run seed and step), so a run that resumes
from its checkpoint sees the data it would have seen.
"""

from __future__ import annotations

import argparse
import json
import logging
import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from labr_autonomy.clock import SystemClock
from labr_autonomy.gkpn import dataset
from labr_autonomy.gkpn.dataset import Views
from labr_autonomy.gkpn.evaluate import evaluate, network_planner, straight_line
from labr_autonomy.gkpn.learner import Loss, NetworkSpec
from labr_autonomy.gkpn.losses import LossConfig, Losses
from labr_autonomy.gkpn.network import NetworkConfig

CHECKPOINT = "checkpoint.pt"  # network, optimiser, step, and the settings of every stretch of the run
log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class TrainConfig:
    """One run."""

    steps: int = 4000
    batch: int = 32  # images of a step
    goals: int = 8  # goals of an image in a step; they share its features, the costly part
    rate: float = 1.2e-3  # peak of the one-cycle schedule
    warm: float = 0.1  # share of the steps before the peak
    decay: float = 1e-3  # weight decay of AdamW
    clip: float = 10.0  # gradient norm
    seed: int = 0
    threads: int = 2
    bfloat16: bool = True  # of the convolutions; False where the processor only emulates it
    save_every: int = 250
    check_every: int = 1000
    network: NetworkSpec = field(default_factory=NetworkConfig)
    loss: Loss = field(default_factory=LossConfig)


def rate_at(step: int, config: TrainConfig) -> float:
    """One-cycle learning rate: linear rise to the peak, cosine fall to 1/1000 of it."""
    rise = max(1.0, config.warm * config.steps)
    if step < rise:
        return config.rate * (step + 1) / rise
    share = (step - rise) / max(1.0, config.steps - rise)
    return config.rate * (0.001 + 0.999 * 0.5 * (1.0 + math.cos(math.pi * min(share, 1.0))))


def memory_format(config: TrainConfig) -> torch.memory_format:
    """Channels last is quicker, but in float32 oneDNN's gradients of 1x1 strides crash on some processors."""
    return torch.channels_last if config.bfloat16 else torch.contiguous_format


def step_losses(net: nn.Module, views: Views, step: int, config: TrainConfig) -> Losses:
    """Forward pass of one step: random views and goals, half of them mirrored left to right."""
    draw = torch.Generator().manual_seed(config.seed * 10_000_019 + step)
    index = torch.randint(0, len(views), (config.batch,), generator=draw)
    order = torch.rand(config.batch, views.goals_m.shape[1], generator=draw).argsort(dim=1)
    goal = views.goals_m[index[:, None], order[:, : config.goals]].reshape(-1, 3)
    each = index.repeat_interleave(config.goals)
    image = _holes(views.images_m[index].float()[:, None], draw)
    half = config.batch // 2
    image[:half] = image[:half].flip(-1)
    mirror = torch.ones(len(each), 3)
    mirror[: half * config.goals, 1] = -1.0
    with torch.autocast("cpu", dtype=torch.bfloat16, enabled=config.bfloat16):
        features = net.encode(image.contiguous(memory_format=memory_format(config)))
        points, logit = net.plan(features, goal * mirror)
    points = points.float() * mirror[:, None]
    solids = views.solids[views.scene[each]]
    return config.loss.losses(points, logit.float(), goal, views.poses[each], solids, views.floor_m(each))


def _holes(image: Tensor, draw: torch.Generator) -> Tensor:
    """Knock out random patches, besides the holes the data already has."""
    keep = torch.rand(len(image), 1, 9, 16, generator=draw) > 0.02
    return image * functional.interpolate(keep.float(), size=image.shape[2:], mode="nearest")


def train(training: Views, validation: Views, run_dir: Path, config: TrainConfig) -> nn.Module:
    """Train, with checkpoints in `run_dir`, resuming from the last one there; returns the network."""
    torch.set_num_threads(config.threads)
    torch.manual_seed(config.seed)
    run_dir.mkdir(parents=True, exist_ok=True)
    net = config.network.build().to(memory_format=memory_format(config))
    optimiser = torch.optim.AdamW(net.parameters(), lr=config.rate, weight_decay=config.decay)
    checkpoint, first, history = run_dir / CHECKPOINT, 0, list[dict[str, Any]]()
    if checkpoint.exists():
        state = torch.load(checkpoint, weights_only=True)
        net.load_state_dict(state["net"])
        optimiser.load_state_dict(state["optimiser"])
        first, history = int(state["step"]), state["history"]
    if first < config.steps:
        history.append({"from_step": first, **asdict(config)})
    log.info("straight line %s", json.dumps(evaluate(straight_line, validation, LossConfig())))
    clock = SystemClock()
    began_s, sums = clock.now_s(), dict[str, float]()
    for step in range(first, config.steps):
        for group in optimiser.param_groups:
            group["lr"] = rate_at(step, config)
        out = step_losses(net.train(), training, step, config)
        optimiser.zero_grad()
        out.total.backward()
        torch.nn.utils.clip_grad_norm_(net.parameters(), config.clip)
        optimiser.step()
        for name, value in {"total": out.total, **out.terms}.items():
            sums[name] = sums.get(name, 0.0) + float(value.detach())
        done = step + 1
        if done % config.save_every == 0 or done == config.steps:
            means = {name: round(value / config.save_every, 4) for name, value in sums.items()}
            log.info("step %d %.0f s %s", done, clock.now_s() - began_s, json.dumps(means))
            sums.clear()
            _save(checkpoint, net, optimiser, done, history)
        if done % config.check_every == 0 or done == config.steps:
            figures = evaluate(network_planner(net.eval()), validation, LossConfig())
            log.info("validation %s", json.dumps(figures))
    net.eval()
    return net


def _save(
    path: Path, net: nn.Module, optimiser: torch.optim.Optimizer, step: int, history: list[dict[str, Any]]
) -> None:
    """Write the checkpoint in one move, so that a stopped run leaves a whole one."""
    fresh = path.with_suffix(".new")
    state = {"net": net.state_dict(), "optimiser": optimiser.state_dict(), "step": step, "history": history}
    torch.save(state, fresh)
    fresh.replace(path)


def run_facts(run_dir: Path, config: TrainConfig, training: Views, validation: Views) -> dict[str, Any]:
    """What a manifest says of a run: its settings, every stretch of it, and its data."""
    return {
        "config": asdict(config),
        "history": torch.load(run_dir / CHECKPOINT, weights_only=True)["history"],
        "data": training.facts(),
        "validation": validation.facts(),
    }


def main() -> None:
    """Train from files and write the weights."""
    standard = TrainConfig()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, nargs="+", required=True, help="training sets (.npz)")
    parser.add_argument("--validation", type=Path, required=True, help="set of unseen scenes (.npz)")
    parser.add_argument("--run", type=Path, required=True, help="folder for checkpoints")
    parser.add_argument("--weights", type=Path, help="folder to export to when done")
    parser.add_argument("--steps", type=int, default=standard.steps)
    parser.add_argument("--seed", type=int, default=standard.seed)
    parser.add_argument("--threads", type=int, default=standard.threads)
    parser.add_argument("--energy", type=float, default=LossConfig().energy)
    a = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    loss = LossConfig(energy=a.energy)
    config = TrainConfig(steps=a.steps, seed=a.seed, threads=a.threads, loss=loss)
    training, validation = dataset.load(*a.data), dataset.load(a.validation)
    net = train(training, validation, a.run, config)
    if a.weights:
        from labr_autonomy.gkpn.export import export

        export(net, a.weights, validation, loss, run_facts(a.run, config, training, validation))


if __name__ == "__main__":
    main()
