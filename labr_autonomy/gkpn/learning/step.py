"""One step of training: which views and goals, spoiled how, and what the network's answer costs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from labr_autonomy.gkpn.learning.cost import Asked
from labr_autonomy.gkpn.learning.machine import Machine
from labr_autonomy.gkpn.learning.settings import Settings
from labr_autonomy.gkpn.learning.spoiled import spoiled
from labr_autonomy.gkpn.learning.views import Views

HOLE_SHARE = 0.02  # of patches of the image that are knocked out, besides the holes it has


@dataclass(frozen=True, slots=True)
class Batch:
    """Images with k goals each, in a row; half of them seen in a mirror."""

    images_m: Tensor  # (b, 1, h, w)
    maps: Tensor  # (b, SHOWN, SIDE, SIDE)
    asked: Asked  # of b * k goals, not mirrored
    floor_m: Tensor  # (b * k, 1) driving height, level frame
    mirror: Tensor  # (b * k, 3) signs that turn the goal into the mirrored one, and the answer back
    spoiled: Tensor  # (b * k,) 1 where the frame says nothing
    taught_m: Tensor | None  # (b * k, n, 3) key points of the teacher, NaN where it has none


@dataclass(frozen=True, slots=True)
class StepLosses:
    """The sum to descend on, and its parts for people."""

    total: Tensor
    parts: dict[str, Tensor]


def draw(
    views: Views, taught_m: NDArray[np.float32] | None, step: int, settings: Settings, machine: Machine
) -> Batch:
    """The batch of a step; it follows from seed, step and rank alone."""
    rng = np.random.default_rng([settings.seed, step, machine.rank])
    count, each = machine.share(settings.images), min(settings.goals, views.goals_m.shape[1])
    index = rng.integers(0, len(views), count)
    pick = rng.random((count, views.goals_m.shape[1])).argsort(axis=1)[:, :each]
    view = index.repeat(each)
    images, maps = views.images_m(index), views.local_maps(index)
    keep = torch.from_numpy((rng.random((count, 1, 9, 16)) > HOLE_SHARE).astype(np.float32))
    images = images * functional.interpolate(keep, size=images.shape[2:], mode="nearest")
    maps[torch.from_numpy(rng.random(count) < settings.unmapped)] = 0.0
    half = count // 2
    images[:half], maps[:half] = images[:half].flip(-1), maps[:half].flip(-1)
    spoil = rng.random(count) < settings.spoiled
    for i in np.flatnonzero(spoil):
        images[i] = spoiled(images[i], rng)
    mirror = torch.ones(len(view), 3)
    mirror[: half * each, 1] = -1.0
    taught = None if taught_m is None else torch.from_numpy(taught_m[index[:, None], pick].astype(np.float32))
    to = machine.device
    return Batch(
        images.to(to).contiguous(memory_format=machine.memory_format),
        maps.to(to).contiguous(memory_format=machine.memory_format),
        _asked(views, view, pick.reshape(-1), to),
        torch.from_numpy(views.floor_m[view, None]).to(to),
        mirror.to(to),
        torch.from_numpy(spoil.repeat(each).astype(np.float32)).to(to),
        None if taught is None else taught.flatten(0, 1).to(to),
    )


def asked(views: Views, view: NDArray[np.int64], goal: NDArray[np.int64]) -> Asked:
    """What some views (b,) were asked for by the goals (b,) of these numbers."""
    return _asked(views, view, goal, torch.device("cpu"))


def _asked(views: Views, view: NDArray[np.int64], goal: NDArray[np.int64], to: torch.device) -> Asked:
    goal_m = views.goals_m[view, goal]
    target_m = np.column_stack([goal_m[:, :2], views.target_z_m[view, goal]])
    return Asked(
        torch.from_numpy(view).to(to),
        torch.from_numpy(goal_m).to(to),
        torch.from_numpy(target_m.astype(np.float32)).to(to),
        torch.from_numpy(views.in_air[view, goal]).to(to),
        torch.from_numpy(views.poses[view]).to(to),
    )


def step_losses(
    net: nn.Module, batch: Batch, views: Views, settings: Settings, machine: Machine, teacher: float
) -> StepLosses:
    """Forward pass and loss.

    The hypothesis that costs least is the one that learns (winner takes all), the others a little, so that
    none is left behind; mu of each learns from what becomes of its own path.

    Args:
        net: What answers (images, maps, goals, floors) with key points (b, h, n, 3) as proposed and after
            each revision, and logits (b, h).
        batch: What it is asked.
        views: The data, which judge.
        settings: Weights.
        machine: Its precision.
        teacher: Weight of the imitation in this step.
    """
    goal = batch.asked.goal_m * batch.mirror
    with torch.autocast(machine.device.type, dtype=torch.bfloat16, enabled=machine.bfloat16):
        every, logit = net(batch.images_m, batch.maps, goal, batch.floor_m)
    every, logit = [points * batch.mirror[:, None, None] for points in every], logit.float()
    points = every[-1]
    b, h, n, _ = points.shape
    cost = settings.cost()
    each = Asked(*(getattr(batch.asked, name).repeat_interleave(h, dim=0) for name in Asked.__slots__))
    judged = cost.judge(points.reshape(b * h, n, 3), each, views)
    totals = cost.total(judged).reshape(b, h)
    best = totals.detach().argmin(dim=1, keepdim=True)
    sound = 1.0 - batch.spoiled
    count = sound.sum().clamp(min=1.0)
    won = (totals.gather(1, best)[:, 0] * sound).sum() / count
    rest = (totals.mean(dim=1) * sound).sum() / count if h > 1 else totals.new_zeros(())
    hits = torch.maximum(judged.collides.reshape(b, h), batch.spoiled[:, None])
    fear = functional.binary_cross_entropy_with_logits(logit, hits)
    total = won + settings.others * rest + settings.fear * fear
    here = torch.arange(b, device=best.device)
    for earlier in every[:-1]:
        price = cost.total(cost.judge(earlier[here, best[:, 0]], batch.asked, views))
        total = total + settings.early * (price * sound).sum() / count
    parts = {
        name: (t.reshape(b, h).gather(1, best)[:, 0] * sound).sum() / count
        for name, t in judged.terms.items()
    }
    parts |= {"fear": fear, "free": 1.0 - (hits.gather(1, best)[:, 0] * sound).sum() / count}
    if batch.taught_m is not None and teacher > 0.0:
        parts["teacher"] = _imitation(points, batch.taught_m, sound)
        total = total + teacher * parts["teacher"]
    return StepLosses(total, {"total": total, **parts})


def _imitation(points_m: Tensor, taught_m: Tensor, sound: Tensor) -> Tensor:
    """Mean distance [m] from the teacher's key points to those of the hypothesis that is nearest to them."""
    known = ~taught_m[:, 0, 0].isnan() & (sound > 0.5)
    if not bool(known.any()):
        return points_m.new_zeros(())
    away = torch.sqrt(((points_m[known] - taught_m[known][:, None]) ** 2).sum(-1) + 1e-6).mean(dim=2)
    return away.min(dim=1).values.mean()
