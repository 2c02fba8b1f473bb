"""The training loss: trajectory cost C = C^O + C^M + C^G + C^E and fear F (paper, section IV-C).

The paper writes means over the mn points, iPlanner's code sums them; a sum weighs 51 times as much. Here
obstacle and motion are sums over the 51 points, goal and energy means; all are averaged over the batch.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from labr_autonomy.gkpn.spline import spline_matrix

_TINY = 1e-9


@dataclass(frozen=True, slots=True)
class LossConfig:
    """Weights and lengths of the loss."""

    obstacle: float = 1.0  # alpha; sum over the path's points
    motion: float = 2.0  # beta; sum over the path's segments
    goal: float = 5.0  # gamma
    energy: float = 8.0  # delta; mean over the path's points
    fear: float = 1.0
    inflate_m: float = 0.40  # distance from solids below which the path pays; the robot's radius is 0.30
    collide_m: float = 0.30  # distance below which a point counts as a collision for the fear label
    soften_m: float = 0.05  # scale of penetration in the logarithm
    floor_slack_m: float = 0.02  # how far under the driving height costs nothing

    def losses(
        self, points_m: Tensor, logit: Tensor, goal_m: Tensor, pose: Tensor, solids: Tensor, floor_m: Tensor
    ) -> Losses:
        """All terms for a batch; see `losses`."""
        return losses(points_m, logit, goal_m, pose, solids, floor_m, self)


@dataclass(frozen=True, slots=True)
class Losses:
    """Terms averaged over the batch, and what they were computed from."""

    total: Tensor  # ()
    terms: dict[str, Tensor]  # name -> (), unweighted
    path_m: Tensor  # (b, 51, 3) level frame
    distance_m: Tensor  # (b, 51) to the nearest solid
    collides: Tensor  # (b, 1) fear labels


def level_to_odom(points_m: Tensor, pose: Tensor) -> Tensor:
    """Points (b, k, 3) of the level frame of poses (b, >=4: x, y, z, yaw) to odom."""
    c, s = torch.cos(pose[:, 3:4]), torch.sin(pose[:, 3:4])
    x, y = points_m[..., 0], points_m[..., 1]
    turned = torch.stack([c * x - s * y, s * x + c * y, points_m[..., 2]], dim=-1)
    return turned + pose[:, None, :3]


def _solid_distance(points_m: Tensor, rows: Tensor) -> Tensor:
    """Exact signed distance (b, k, n) of points (b, k, 1, 3) to rows (b, 1 or k, n, 8)."""
    d = points_m - rows[..., 1:4]
    c, s = torch.cos(rows[..., 7]), torch.sin(rows[..., 7])
    qx = (c * d[..., 0] + s * d[..., 1]).abs() - rows[..., 4]
    qy = (c * d[..., 1] - s * d[..., 0]).abs() - rows[..., 5]
    qz = d[..., 2].abs() - rows[..., 6]
    round_ = rows[..., 0] > 0.5
    radial = torch.sqrt(d[..., 0] ** 2 + d[..., 1] ** 2 + _TINY) - rows[..., 4]
    qx, qy = torch.where(round_, radial, qx), torch.where(round_, radial, qy)
    flat = torch.where(round_, qx.clamp(min=0.0) ** 2, qx.clamp(min=0.0) ** 2 + qy.clamp(min=0.0) ** 2)
    outside = torch.sqrt(flat + qz.clamp(min=0.0) ** 2 + _TINY)
    return outside + torch.maximum(torch.maximum(qx, qy), qz).clamp(max=0.0)


def scene_distance(points_m: Tensor, solids: Tensor) -> Tensor:
    """Signed distance (b, k) of points (b, k, 3) in odom to the nearest of solids (b, n, 8).

    The nearest solid is found without a gradient; only its distance is differentiated.
    """
    with torch.no_grad():
        nearest = _solid_distance(points_m[:, :, None], solids[:, None]).argmin(dim=-1)
    rows = torch.gather(solids, 1, nearest[..., None].expand(-1, -1, solids.shape[-1]))
    return _solid_distance(points_m[:, :, None], rows[:, :, None])[..., 0]


def goal_distance(last_m: Tensor, goal_m: Tensor, floor_m: Tensor) -> Tensor:
    """The paper's gloss: in x, y when the goal is no higher than h_R, else in x, y, z; (b,)."""
    error = last_m - goal_m
    in_air = (goal_m[:, 2] > floor_m).to(error.dtype)
    return torch.sqrt((error[:, :2] ** 2).sum(dim=1) + in_air * error[:, 2] ** 2 + _TINY)


def losses(
    points_m: Tensor,
    logit: Tensor,
    goal_m: Tensor,
    pose: Tensor,
    solids: Tensor,
    floor_m: Tensor,
    config: LossConfig,
) -> Losses:
    """All terms for a batch.

    Args:
        points_m: (b, 5, 3) key points, level frame.
        logit: (b, 1) logit of mu.
        goal_m: (b, 3) level frame.
        pose: (b, >=4) x, y, z, yaw of the body in odom.
        solids: (b, n, 8) rows of `Views.solids`.
        floor_m: (b,) h_R, the height at which the robot drives, relative to the body: 0 for a robot on its
            wheels, negative for one in the air. Energy and the conditional goal height use it for airborne
            robots too; with the current altitude in its place a flying robot would never be asked to land.
        config: Weights.
    """
    matrix = torch.as_tensor(spline_matrix(points_m.shape[1]).copy(), dtype=points_m.dtype)
    path = torch.einsum("pk,bkd->bpd", matrix, functional.pad(points_m, (0, 0, 1, 0)))
    distance = scene_distance(level_to_odom(path, pose), solids)
    rise = path[..., 2] - floor_m[:, None]
    inside = torch.log1p((config.inflate_m - distance).clamp(min=0.0) / config.soften_m)
    under = torch.log1p((-rise - config.floor_slack_m).clamp(min=0.0) / config.soften_m)
    steps = torch.sqrt(((path[:, 1:] - path[:, :-1]) ** 2).sum(dim=-1) + _TINY)
    even = torch.sqrt((goal_m**2).sum(dim=-1) + _TINY)[:, None] / steps.shape[1]
    collides = (distance[:, 1:] < config.collide_m).any(dim=1, keepdim=True).to(logit.dtype)
    terms = {
        "obstacle": (inside + under).sum(dim=1).mean(),
        "motion": (steps - even).abs().sum(dim=1).mean(),
        "goal": torch.log1p(goal_distance(points_m[:, -1], goal_m, floor_m)).mean(),
        "energy": rise.abs().mean(dim=1).mean(),
        "fear": functional.binary_cross_entropy_with_logits(logit, collides),
    }
    weights = {name: float(getattr(config, name)) for name in terms}
    total = torch.stack([weights[name] * term for name, term in terms.items()]).sum()
    return Losses(total, terms, path, distance, collides)
