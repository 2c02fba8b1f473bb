"""The teacher: key points optimised on the true fields, by the network's own loss.

It knows what no camera sees, so it is the bound of what key points can do; the network imitates it at first
and then follows the loss alone.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from labr_autonomy.gkpn.learning.cost import Asked, Cost
from labr_autonomy.gkpn.learning.step import asked
from labr_autonomy.gkpn.learning.views import Views

KEY_POINTS = 5
STEPS = 80
RATE_M = 0.06  # of Adam: about this much a step
# Where the search begins: the straight line bowed to a side by these lengths, or lifted over what is there.
BOWS_M = (0.0, 0.9, -0.9, 1.8, -1.8)
HOP_M = 1.3
GOALS = 64  # at a time


def _starts(goal_m: Tensor, target_z_m: Tensor, floor_m: Tensor) -> Tensor:
    """Key points to begin with (b, s, n, 3)."""
    share = torch.arange(1, KEY_POINTS + 1) / KEY_POINTS
    line = goal_m[:, None, :2] * share[None, :, None]
    length = torch.sqrt((goal_m[:, :2] ** 2).sum(dim=1) + 1e-6)
    aside = torch.stack([-goal_m[:, 1], goal_m[:, 0]], dim=1) / length[:, None]
    bow = torch.sin(math.pi * share)[None, :, None] * aside[:, None, :]
    flat = [line + b * bow * (length / 5.0).clamp(0.3, 1.0)[:, None, None] for b in BOWS_M]
    low = floor_m[:, None] * torch.ones(KEY_POINTS)
    low[:, -1] = target_z_m
    high = floor_m[:, None] + HOP_M * torch.sin(math.pi * (share - 0.1))[None]
    high[:, -1] = target_z_m
    paths = [torch.cat([xy, low[..., None]], dim=-1) for xy in flat]
    paths.append(torch.cat([line, high[..., None]], dim=-1))
    return torch.stack(paths, dim=1)


def best_paths(
    views: Views, view: NDArray[np.int64], goal: NDArray[np.int64], cost: Cost
) -> tuple[Tensor, Tensor]:
    """The cheapest paths found for some goals.

    Returns:
        Key points (b, n, 3), level frame, and whether they keep clear of everything (b,).
    """
    what = asked(views, view, goal)
    floor = torch.from_numpy(views.floor_m[view])
    starts = _starts(what.goal_m, what.target_m[:, 2], floor)
    b, s = starts.shape[:2]
    each = Asked(*(getattr(what, name).repeat_interleave(s, dim=0) for name in Asked.__slots__))
    points = starts.reshape(b * s, KEY_POINTS, 3).clone().requires_grad_(True)
    optimiser = torch.optim.Adam([points], lr=RATE_M)
    for step in range(STEPS):
        optimiser.param_groups[0]["lr"] = RATE_M * (1.0 - step / STEPS) + 0.002
        optimiser.zero_grad()
        cost.total(cost.judge(points, each, views)).sum().backward()
        optimiser.step()
    with torch.no_grad():
        judged = cost.judge(points, each, views)
        total = cost.total(judged).reshape(b, s)
        best = total.argmin(dim=1)
        here = torch.arange(b)
        clear = judged.collides.reshape(b, s)[here, best] < 0.5
        return points.detach().reshape(b, s, KEY_POINTS, 3)[here, best], clear


def teach(views: Views, cost: Cost, on_goals: Callable[[int], None] = lambda _: None) -> NDArray[np.float32]:
    """Key points of the teacher for the goals whose straight line is blocked (v, k, n, 3), level frame.

    NaN where the line is free, where the loss alone teaches as well, and where the teacher finds no way.
    """
    out = np.full((*views.goals_m.shape[:2], KEY_POINTS, 3), np.nan, np.float32)
    view, goal = np.nonzero(views.hard)
    for start in range(0, len(view), GOALS):
        part = slice(start, start + GOALS)
        points, clear = best_paths(views, view[part], goal[part], cost)
        found = points.numpy()
        found[~clear.numpy()] = np.nan
        out[view[part], goal[part]] = found
        on_goals(len(found))
    return out


def taught(
    views: Views, cost: Cost, folder: Path, on_goals: Callable[[int], None] = lambda _: None
) -> NDArray[np.float32]:
    """The same, kept in a file of `folder` for the next time that these data are learnt from."""
    facts = [views.goals_m.tobytes(), views.land_cm[::37].tobytes(), repr(cost).encode()]
    key = hashlib.sha256(b"".join(facts)).hexdigest()[:16]
    path = folder / f"teacher-{key}.npz"
    if path.exists():
        with np.load(path) as file:
            return np.asarray(file["points_m"], np.float32)
    points = teach(views, cost, on_goals)
    fresh = path.with_suffix(".new.npz")
    np.savez_compressed(fresh, points_m=points.astype(np.float16))
    fresh.replace(path)
    return points.astype(np.float16).astype(np.float32)
