"""The training loop: imperative learning by the losses alone, with a teacher where there is one.

Deterministic by seed: each step draws from a generator seeded by run, step and rank, so a run that resumes
sees what it would have seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from labr_autonomy.gkpn.learning.checkpoint import State, load_best, save_best
from labr_autonomy.gkpn.learning.figures import judge_paths, network_planner, summary
from labr_autonomy.gkpn.learning.machine import Machine
from labr_autonomy.gkpn.learning.settings import Settings
from labr_autonomy.gkpn.learning.step import draw, step_losses
from labr_autonomy.gkpn.learning.views import Views
from labr_autonomy.gkpn.networks.planner import PlanningNetwork, build
from labr_autonomy.gkpn.networks.presets import find_network

MEAN_OF = 50  # steps that a figure shown to people is the mean of


class Listener(Protocol):
    """Who is told how a run goes."""

    def step(self, done: int, parts: dict[str, float], rate: float) -> None:
        """After each step, with the means of the last `MEAN_OF`."""
        ...

    def check(self, done: int, figures: dict[str, Any]) -> None:
        """After each look at unseen views."""
        ...

    def flown(self, done: int, share: float) -> None:
        """After each set of flights."""
        ...


@dataclass(frozen=True, slots=True)
class Lesson:
    """What a network learns from."""

    training: Views
    validation: Views
    taught_m: NDArray[np.float32] | None = None  # (v, k, n, 3) key points of the teacher, NaN where none


class Learner(nn.Module):  # type: ignore[misc]  # torch is untyped here
    """The network with encoding and planning in one call, as several processes need it."""

    def __init__(self, net: PlanningNetwork) -> None:
        super().__init__()
        self.net = net

    def forward(
        self, images_m: torch.Tensor, maps: torch.Tensor, goal_m: torch.Tensor, floor_m: torch.Tensor
    ) -> tuple[list[torch.Tensor], torch.Tensor]:
        """Images (b, 1, h, w), maps, goals (b*k, 3) and floors to key points of all stages and logits."""
        return self.net.stages(self.net.encode(images_m, maps), goal_m, floor_m)


def rate_at(step: int, settings: Settings) -> float:
    """One-cycle learning rate: linear rise to the peak, cosine fall to 1/1000 of it."""
    rise = max(1.0, settings.warm * settings.steps)
    if step < rise:
        return settings.rate * (step + 1) / rise
    share = (step - rise) / max(1.0, settings.steps - rise)
    return settings.rate * (0.001 + 0.999 * 0.5 * (1.0 + math.cos(math.pi * min(share, 1.0))))


def teacher_at(step: int, settings: Settings) -> float:
    """Weight of the imitation: falls linearly to nothing at `until`."""
    end = settings.teacher.until * settings.steps
    return settings.teacher.weight * max(0.0, 1.0 - step / end) if end > 0.0 else 0.0


def train(
    lesson: Lesson,
    settings: Settings,
    folder: Path,
    machine: Machine,
    listener: Listener,
    closed_loop: Callable[[PlanningNetwork], float] | None = None,
) -> PlanningNetwork:
    """Train, with checkpoints in `folder`, going on from the last one there.

    Args:
        lesson: The data.
        settings: Of the run.
        folder: For checkpoints.
        machine: Device and processes.
        listener: Is told how it goes, in the process that leads.
        closed_loop: Share of flights that a network reaches; chooses the best one.

    Returns:
        The running mean of the weights where it flew best; at the end where no flights choose.
    """
    torch.manual_seed(settings.seed)
    net: PlanningNetwork = build(find_network(settings.network))
    net.to(machine.device, memory_format=machine.memory_format)
    optimiser = torch.optim.AdamW(net.parameters(), lr=settings.rate, weight_decay=settings.decay)
    state = State(net, {k: v.clone() for k, v in net.state_dict().items()}, optimiser)
    said = settings.model_dump(mode="json")
    if machine.leads:
        folder.mkdir(parents=True, exist_ok=True)
    machine.wait()
    state.load(folder, said)
    learner = machine.spread(Learner(net))
    recent: list[dict[str, float]] = []
    while state.step < settings.steps:
        rate = rate_at(state.step, settings)
        for group in optimiser.param_groups:
            group["lr"] = rate
        batch = draw(lesson.training, lesson.taught_m, state.step, settings, machine)
        out = step_losses(
            learner.train(), batch, lesson.training, settings, machine, teacher_at(state.step, settings)
        )
        optimiser.zero_grad()
        out.total.backward()
        nn.utils.clip_grad_norm_(net.parameters(), settings.clip)
        optimiser.step()
        state.step += 1
        state.average(settings.average)
        if machine.leads:
            recent = [*recent[1 - MEAN_OF :], {name: float(t.detach()) for name, t in out.parts.items()}]
            listener.step(state.step, _means(recent), rate)
            _look_at(state, lesson, settings, folder, listener, closed_loop)
        machine.wait()
    net.load_state_dict(load_best(folder) or state.mean)
    net.eval()
    return net


def _means(rows: list[dict[str, float]]) -> dict[str, float]:
    return {name: sum(row.get(name, 0.0) for row in rows) / len(rows) for name in rows[-1]}


def _look_at(
    state: State,
    lesson: Lesson,
    settings: Settings,
    folder: Path,
    listener: Listener,
    closed_loop: Callable[[PlanningNetwork], float] | None,
) -> None:
    """Figures, flights and the checkpoint, when they are due."""
    done, last = state.step, state.step == settings.steps
    if done % settings.check_every == 0 or last:
        paths = judge_paths(
            network_planner(_mean_network(state, settings)), lesson.validation, land_only=settings.land_only
        )
        listener.check(done, summary(paths, lesson.validation.families))
    every = settings.closed_loop.every
    if closed_loop is not None and every and (done % every == 0 or last):
        share = closed_loop(_mean_network(state, settings))
        listener.flown(done, share)
        if share >= state.best:
            state.best, state.best_step = share, done
            save_best(folder, state.mean)
    if done % settings.save_every == 0 or last:
        state.save(folder, settings.model_dump(mode="json"))


def _mean_network(state: State, settings: Settings) -> PlanningNetwork:
    """A network of its own with the running mean of the weights, on the processor."""
    net = build(find_network(settings.network))
    net.load_state_dict(state.mean)
    net.eval()
    return net
