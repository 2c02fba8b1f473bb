"""Figures of a network on unseen views, and of the straight line in the same places.

A path collides where it comes within 0.30 m of what hinders or sinks under the floor. Collision-free alone
misleads: a path that stops short is free as well, so it is always given together with goal reached.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from labr_autonomy.gkpn.choice import chosen
from labr_autonomy.gkpn.learning.calibration import auc, calibration_error
from labr_autonomy.gkpn.learning.cost import Cost
from labr_autonomy.gkpn.learning.spoiled import KINDS
from labr_autonomy.gkpn.learning.step import asked
from labr_autonomy.gkpn.learning.views import Views

REACHED_M = 0.5  # paper, table 1
NEAR_M = 2.0  # how far the robot gets before it plans anew, generously
LIFTED_M = 0.25  # rise above the driving height that counts as flying
SUNK_M = 0.12  # under the driving height: in the floor
FAR_M = 4.0  # air goals farther than this show when the path lifts
SPOILED_VIEWS = 200  # at most that are spoiled to see what mu says
TRUSTED_MU = 0.5  # paper, section IV-C

Figures = dict[str, Any]
Paths = dict[str, NDArray[Any]]
Planner = Callable[[Tensor, Tensor, Tensor, Tensor], tuple[Tensor, Tensor]]


def straight_line(images_m: Tensor, maps: Tensor, goal_m: Tensor, floor_m: Tensor) -> tuple[Tensor, Tensor]:
    """The baseline: five points on the line to the goal, and no opinion about collisions."""
    share = torch.arange(1, 6)[None, None, :, None] / 5.0
    return goal_m[:, None, None, :] * share, torch.zeros(len(goal_m), 1)


def network_planner(net: nn.Module) -> Planner:
    """A network as a planner; k goals in a row per image."""

    def plan(images_m: Tensor, maps: Tensor, goal_m: Tensor, floor_m: Tensor) -> tuple[Tensor, Tensor]:
        points, logit = net.plan(net.encode(images_m, maps), goal_m, floor_m)
        return points, logit

    return plan


def judge_paths(plan: Planner, views: Views, *, land_only: bool = False, batch: int = 64) -> Paths:
    """What becomes of the chosen path to every goal of every view.

    Args:
        plan: Images (b, 1, h, w), maps, goals (b*k, 3) and floors (b*k, 1) to key points
            (b*k, hypotheses, n, 3) and logits.
        views: Unseen data.
        land_only: Leave out goals in the air and views from it.
        batch: Views at a time.

    Returns:
        Arrays with one entry per path, by name.
    """
    rows: dict[str, list[NDArray[Any]]] = {}
    with torch.no_grad():
        for index in _batches(len(views), batch):
            for name, values in _judge(plan, views, index).items():
                rows.setdefault(name, []).append(values)
    paths = {name: np.concatenate(values) for name, values in rows.items()}
    if land_only:
        kept = ~paths["air"] & ~paths["airborne"]
        paths = {name: values[kept] for name, values in paths.items()}
    return paths


def _batches(count: int, batch: int) -> Iterator[NDArray[np.int64]]:
    for start in range(0, count, batch):
        yield np.arange(start, min(start + batch, count))


def _judge(plan: Planner, views: Views, index: NDArray[np.int64]) -> Paths:
    k = views.goals_m.shape[1]
    view, goal = index.repeat(k), np.tile(np.arange(k), len(index))
    what = asked(views, view, goal)
    floor = views.floor_m[view]
    told = torch.from_numpy(floor[:, None])
    points, logit = plan(views.images_m(index), views.local_maps(index), what.goal_m, told)
    mu = torch.sigmoid(logit)
    pick = torch.from_numpy(chosen(points.numpy(), mu.numpy(), floor))
    here = torch.arange(len(pick))
    cost = Cost()
    judged = cost.judge(points[here, pick], what, views)
    rise, distance = judged.rise_m.numpy(), judged.distance_m.numpy()
    hit = (distance < cost.collide_m) | (rise < -SUNK_M)
    path = judged.path_m.numpy()
    run = np.cumsum(np.linalg.norm(np.diff(path, axis=1), axis=-1), axis=1)
    along = np.cumsum(np.linalg.norm(np.diff(path[..., :2], axis=1, prepend=0.0), axis=-1), axis=1)
    lifted = rise > LIFTED_M
    first = np.where(lifted.any(axis=1), lifted.argmax(axis=1), rise.shape[1] - 1)
    lift_at_m = along[np.arange(len(first)), first]
    return {
        "hit": hit.any(axis=1),
        "hit_near": (hit[:, 1:] & (run < NEAR_M)).any(axis=1),
        "fear": judged.collides.numpy() > 0.5,
        "error_m": torch.expm1(judged.terms["goal"]).numpy(),
        "cost": cost.total(judged).numpy(),
        "mu": mu[here, pick].numpy(),
        "logit": logit[here, pick].numpy(),
        "air": what.in_air.numpy(),
        "airborne": floor < -0.2,
        "hard": views.hard[view, goal],
        "range_m": np.linalg.norm(what.goal_m[:, :2].numpy(), axis=1),
        "lifted": lifted.any(axis=1),
        "lift_share": lift_at_m / np.maximum(along[:, -1], 1e-6),
        "lift_before_m": along[:, -1] - lift_at_m,
        "key_rise_m": rise[:, 10::10],
        "scene": views.scene[view],
    }


def summary(paths: Paths, families: tuple[str, ...]) -> Figures:
    """Shares and medians of judged paths, by family as well."""
    everything = np.ones(len(paths["hit"]), bool)
    free, error = ~paths["hit"], paths["error_m"]
    reached = free & (error < REACHED_M)
    air, flying, range_m = paths["air"], paths["airborne"], paths["range_m"]
    far = air & ~flying & (range_m > FAR_M)
    trusted = paths["mu"] < TRUSTED_MU

    def share(what: NDArray[np.bool_], where: NDArray[np.bool_]) -> float | None:
        return round(float(what[where].mean()), 4) if where.any() else None

    def median(what: NDArray[Any], where: NDArray[np.bool_]) -> float | None:
        return round(float(np.median(what[where])), 4) if where.any() else None

    up = far & paths["lifted"]
    of_scene = np.array(families)[paths["scene"]]
    return {
        "paths": len(everything),
        "cost": round(float(paths["cost"].mean()), 4),
        "collision_free": share(free, everything),
        "collision_free_first_2m": share(~paths["hit_near"], everything),
        "reached": share(reached, everything),
        "reached_land": share(reached, ~air),
        "reached_air": share(reached, air),
        "collision_free_hard": share(free, paths["hard"]),
        "collision_free_from_air": share(free, flying),
        "collision_free_below_3m": share(free, range_m < 3.0),
        "collision_free_beyond_5m": share(free, range_m > 5.0),
        "goal_error_median_m": median(error, everything),
        "goal_error_mean_m": round(float(error.mean()), 4),
        "mu_auc": auc(paths["mu"], paths["fear"]),
        "mu_calibration_error": calibration_error(paths["mu"], paths["fear"]),
        "mu_below_half": share(trusted, everything),
        "collision_free_mu_below_half": share(free, trusted),
        "land_goals_flown_to": share(paths["lifted"], ~air & ~flying),
        "far_air_goals_lifted": share(paths["lifted"], far),
        "far_air_driven_share_median": median(paths["lift_share"], up),
        "far_air_lift_before_goal_median_m": median(paths["lift_before_m"], up),
        "far_air_key_point_rise_m": [round(float(v), 3) for v in paths["key_rise_m"][far].mean(axis=0)]
        if far.any()
        else None,
        "collision_free_by_family": {
            family: share(free, of_scene == family) for family in sorted(set(of_scene.tolist()))
        },
    }


def mu_when_spoiled(plan: Planner, views: Views) -> dict[str, float]:
    """Mean mu of a planner on images as they were seen, and on the same ones spoiled in each way.

    The map stays as it was: a camera that fails does so in the middle of a drive.
    """
    rng = np.random.default_rng(5)
    index = rng.permutation(len(views))[:SPOILED_VIEWS]
    maps, floor = views.local_maps(index), torch.from_numpy(views.floor_m[index, None])
    goals = torch.from_numpy(views.goals_m[index, 0])
    seen = views.images_m(index)
    images = {"as_seen": seen}
    images |= {name: torch.stack([spoil(one, rng) for one in seen]) for name, spoil in KINDS.items()}
    out = {}
    with torch.no_grad():
        for name, image in images.items():
            _, logit = plan(image, maps, goals, floor)
            out[name] = round(float(torch.sigmoid(logit).min(dim=1).values.mean()), 4)
    return out
