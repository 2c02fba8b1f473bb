"""Figures of a network on unseen scenes, and of the straight line in the same places.

A path collides where it comes within `collide_m` of a solid or sinks under the floor. Collision-free alone
misleads: a path that stops short is free as well, so it is always given together with goal reached.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor, nn

from labr_autonomy.gkpn.dataset import FLOOR_HEIGHT_M, Views
from labr_autonomy.gkpn.losses import LossConfig, goal_distance, losses

REACHED_M = 0.5  # paper, table 1
NEAR_M = 2.0  # how far the robot gets before it plans anew, generously
LIFTED_M = 0.25  # rise above the driving height that counts as flying
FAR_M = 4.0  # air goals farther than this show when the path lifts

Figures = dict[str, float | list[float] | None]
Planner = Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]


def straight_line(depth_m: Tensor, goal_m: Tensor) -> tuple[Tensor, Tensor]:
    """The baseline: five points on the line to the goal, and no opinion about collisions."""
    share = torch.arange(1, 6)[None, :, None] / 5.0
    return goal_m[:, None, :] * share, torch.zeros(len(goal_m), 1)


def network_planner(net: nn.Module) -> Planner:
    """A network as a planner; k goals in a row per image."""

    def plan(depth_m: Tensor, goal_m: Tensor) -> tuple[Tensor, Tensor]:
        points, logit = net.plan(net.encode(depth_m), goal_m)
        return points, logit

    return plan


def evaluate(plan: Planner, views: Views, config: LossConfig, batch: int = 96) -> Figures:
    """Figures over four goals of each view, two of each half; every other one lies behind something."""
    g = views.goals_m.shape[1]
    pick = torch.tensor([0, 1, g // 2, g // 2 + 1])
    rows: dict[str, list[Tensor]] = {}
    with torch.no_grad():
        for start in range(0, len(views), batch):
            index = torch.arange(start, min(start + batch, len(views)))
            for name, value in _judge(plan, views, index, pick, config).items():
                rows.setdefault(name, []).append(value)
    return _summarise({name: torch.cat(values).numpy() for name, values in rows.items()})


def _judge(plan: Planner, views: Views, index: Tensor, pick: Tensor, config: LossConfig) -> dict[str, Tensor]:
    """What happens on each path of some views."""
    each = index.repeat_interleave(len(pick))
    goal = views.goals_m[index][:, pick].reshape(-1, 3)
    floor = views.floor_m(each)
    points, logit = plan(views.images_m[index].float()[:, None], goal)
    out = losses(points, logit, goal, views.poses[each], views.solids[views.scene[each]], floor, config)
    rise = out.path_m[..., 2] - floor[:, None]
    hit = (out.distance_m < config.collide_m) | (rise < -FLOOR_HEIGHT_M)
    flat = (out.path_m[:, 1:, :2] - out.path_m[:, :-1, :2]).norm(dim=-1)
    run = torch.cumsum((out.path_m[:, 1:] - out.path_m[:, :-1]).norm(dim=-1), dim=1)
    hit_near = (hit[:, 1:] & (run < NEAR_M)).any(dim=1)
    lifted = (rise > LIFTED_M).float()
    first = torch.where(lifted.any(dim=1), lifted.argmax(dim=1), torch.tensor(rise.shape[1] - 1))
    along = torch.cumsum(torch.nn.functional.pad(flat, (1, 0)), dim=1)
    return {
        "free": (~hit.any(dim=1)).float(),
        "free_near": (~hit_near).float(),
        "error": goal_distance(points[:, -1], goal, floor + 0.2),
        "mu": torch.sigmoid(logit[:, 0]),
        "hit": out.collides[:, 0],
        "hit_near": hit_near.float(),
        "air": (goal[:, 2] > floor + 0.2).float(),
        "airborne": (floor < -0.2).float(),
        "range": goal[:, :2].norm(dim=1),
        "lifted": lifted.any(dim=1).float(),
        "lift_at": along.gather(1, first[:, None])[:, 0] / along[:, -1].clamp(min=1e-6),
        "key_rise": rise[:, 10::10],
        "family": views.scene[each].float(),
    }


def auc(score: np.ndarray, label: np.ndarray) -> float | None:
    """Area under the ROC curve by ranks; None if it is undefined (one class, or one score for all)."""
    positive = int(label.sum())
    negative = len(label) - positive
    if not positive or not negative or np.ptp(score) == 0.0:
        return None
    rank = np.empty(len(score))
    rank[np.argsort(score, kind="stable")] = np.arange(1, len(score) + 1)
    area = float((rank[label > 0.5].sum() - positive * (positive + 1) / 2) / (positive * negative))
    return round(area, 4)


def _summarise(r: dict[str, np.ndarray]) -> Figures:
    """Shares and medians of the judged paths."""
    everything = np.ones(len(r["free"]), dtype=bool)
    reached = r["free"] * (r["error"] < REACHED_M)
    air, flying = r["air"] > 0.5, r["airborne"] > 0.5
    far = air & ~flying & (r["range"] > FAR_M)
    trusted = r["mu"] < 0.5
    rise = [round(float(v), 3) for v in r["key_rise"][far].mean(axis=0)] if far.any() else None

    def mean(name: str, where: np.ndarray) -> float | None:
        values = (reached if name == "reached" else r[name])[where]
        return round(float(values.mean()), 4) if len(values) else None

    def median(name: str, where: np.ndarray) -> float | None:
        values = r[name][where]
        return round(float(np.median(values)), 4) if len(values) else None

    return {
        "paths": len(everything),
        "collision_free": mean("free", everything),
        "collision_free_first_2m": mean("free_near", everything),
        "reached": mean("reached", everything),
        "reached_land": mean("reached", ~air),
        "reached_air": mean("reached", air),
        "collision_free_from_floor": mean("free", ~flying),
        "collision_free_from_air": mean("free", flying),
        "collision_free_1_3m": mean("free", r["range"] < 3.0),
        "collision_free_7_9m": mean("free", r["range"] > 7.0),
        "goal_error_land_median_m": median("error", ~air),
        "goal_error_air_median_m": median("error", air),
        "fear_auc": auc(r["mu"], r["hit"]),
        "fear_auc_first_2m": auc(r["mu"], r["hit_near"]),
        "accepted_mu_below_half": round(float(trusted.mean()), 4),
        "collision_free_accepted": mean("free", trusted),
        "land_goals_flown_to": mean("lifted", ~air & ~flying),
        "far_air_goals_lifted": mean("lifted", far),
        "far_air_lift_at_share_of_way": median("lift_at", far),
        "far_air_key_point_rise_m": rise,
    }
