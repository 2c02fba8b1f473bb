"""The training loss: trajectory cost C = C^O + C^M + C^G + C^E and fear F (paper, section IV-C).

The paper writes means over the mn points, iPlanner's code sums them; a sum weighs 51 times as much. Here
obstacle and motion are sums over the 51 points, goal and energy means. h_R is the driving height of the floor
below each point: with a flying robot's own altitude in its place it would never be asked to land.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from labr_autonomy.gkpn.learning.truth import look
from labr_autonomy.gkpn.learning.views import Views
from labr_autonomy.gkpn.spline import spline_matrix

_TINY = 1e-9


@dataclass(frozen=True, slots=True)
class Asked:
    """What a batch of paths was asked for."""

    view: Tensor  # (b,) index of the views
    goal_m: Tensor  # (b, 3) as the network is told, level frame
    target_m: Tensor  # (b, 3) the same with its height followed (see `truth`)
    in_air: Tensor  # (b,) bool
    pose: Tensor  # (b, 6) x, y, z, yaw, ... of the body, odom


@dataclass(frozen=True, slots=True)
class Judged:
    """Terms of each path, unweighted, and what they were computed from."""

    terms: dict[str, Tensor]  # name -> (b,)
    path_m: Tensor  # (b, 51, 3) level frame
    distance_m: Tensor  # (b, 51) to what hinders
    rise_m: Tensor  # (b, 51) above the driving height
    collides: Tensor  # (b,) fear labels, 0 or 1


@dataclass(frozen=True, slots=True)
class Cost:
    """Weights and lengths of the loss."""

    obstacle: float = 1.0  # alpha; sum over the path's points
    motion: float = 2.0  # beta; sum over the path's segments
    goal: float = 5.0  # gamma
    energy: float = 8.0  # delta; mean over the path's points
    inflate_m: float = 0.40  # distance below which the path pays; the robot's radius is 0.30
    collide_m: float = 0.30  # distance below which a point counts as a collision for the fear label
    soften_m: float = 0.05  # scale of penetration in the logarithm
    floor_slack_m: float = 0.02  # how far under the driving height costs nothing

    def judge(self, points_m: Tensor, asked: Asked, views: Views) -> Judged:
        """Terms of paths through key points (b, n, 3), level frame."""
        path = spline(points_m)
        distance, rise = look(level_to_odom(path, asked.pose), asked.view, views)
        inside = torch.log1p((self.inflate_m - distance).clamp(min=0.0) / self.soften_m)
        under = torch.log1p((-rise - self.floor_slack_m).clamp(min=0.0) / self.soften_m)
        error = goal_error(points_m[:, -1], asked)
        terms = {
            "obstacle": (inside + under).sum(dim=1),
            "motion": motion(path, asked.goal_m),
            "goal": torch.log1p(error),
            "energy": rise.abs().mean(dim=1),
        }
        collides = (distance[:, 1:] < self.collide_m).any(dim=1).to(path.dtype)
        return Judged(terms, path, distance, rise, collides.detach())

    def total(self, judged: Judged) -> Tensor:
        """Weighted trajectory cost C of each path (b,), without fear."""
        return torch.stack([float(getattr(self, name)) * term for name, term in judged.terms.items()]).sum(0)


def spline(points_m: Tensor) -> Tensor:
    """Points (b, 51, 3) of the paths from the origin through key points (b, n, 3)."""
    matrix = torch.as_tensor(spline_matrix(points_m.shape[1]).copy()).to(points_m)
    return torch.einsum("pk,bkd->bpd", matrix, functional.pad(points_m, (0, 0, 1, 0)))


def level_to_odom(points_m: Tensor, pose: Tensor) -> Tensor:
    """Points (b, k, 3) of the level frame of poses (b, >=4: x, y, z, yaw) to odom."""
    c, s = torch.cos(pose[:, 3:4]), torch.sin(pose[:, 3:4])
    x, y = points_m[..., 0], points_m[..., 1]
    turned = torch.stack([c * x - s * y, s * x + c * y, points_m[..., 2]], dim=-1)
    return turned + pose[:, None, :3]


def goal_error(last_m: Tensor, asked: Asked) -> Tensor:
    """The paper's gloss (b,) [m]: in x, y for a goal on the floor, else in x, y, z."""
    error = last_m - asked.target_m
    high = asked.in_air.to(error.dtype)
    return torch.sqrt((error[:, :2] ** 2).sum(dim=1) + high * error[:, 2] ** 2 + _TINY)


def motion(path_m: Tensor, goal_m: Tensor) -> Tensor:
    """C^M (b,): how unlike the straight line's even steps the path's are, summed."""
    steps = torch.sqrt(((path_m[:, 1:] - path_m[:, :-1]) ** 2).sum(dim=-1) + _TINY)
    even = torch.sqrt((goal_m**2).sum(dim=-1) + _TINY)[:, None] / steps.shape[1]
    return (steps - even).abs().sum(dim=1)
