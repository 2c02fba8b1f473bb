"""iPlanner's own training loss on our fields (leggedrobotics/iPlanner @ 4a8d823): driving only.

L = 0.5 L_obs + L_height + 2 L_motion + 5 L_goal + BCE(fear), the first three as sums over the 51 points. Its
cost map is log(G(EDT) + 1.00001): the depth, in 5 cm cells, to which a place lies inside the obstacles
inflated by the robot, smoothed with a Gaussian of 2.5 cells. Here that depth comes from the field of driving,
and the smoothing of a straight edge in closed form: a ramp p smoothed by sigma is
p Phi(p / sigma) + sigma phi(p / sigma). Its inflation depends on how many points a surface has; a fixed
distance takes its place. Unknown places, which it counts as occupied, do not occur.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from labr_autonomy.gkpn.learning.cost import Asked, Judged, level_to_odom, motion, spline
from labr_autonomy.gkpn.learning.truth import look
from labr_autonomy.gkpn.learning.views import Views

_TINY = 1e-9


@dataclass(frozen=True, slots=True)
class IPlannerCost:
    """Weights (defaults of `CostofTraj`) and lengths of the loss."""

    obstacle: float = 0.5  # sum over the path's points
    height: float = 1.0  # sum over the path's points
    motion: float = 2.0  # sum over the path's segments
    goal: float = 5.0
    inflate_m: float = 0.40  # as for GKPN: the robot's radius 0.30 and what it strays
    cell_m: float = 0.05  # unit of the penetration
    smooth_m: float = 0.125  # 2.5 cells
    fear_cost: float = 0.5  # cost above which a point counts as a collision
    fear_ahead_m: float = 2.0  # way along the path over which the label looks

    def judge(self, points_m: Tensor, asked: Asked, views: Views) -> Judged:
        """Terms of paths through key points (b, n, 3), level frame, of robots on their wheels."""
        path = spline(points_m)
        distance, rise = look(level_to_odom(path, asked.pose), asked.view, views, drives=True)
        cost = self.cost(distance)
        steps = torch.sqrt(((path[:, 1:] - path[:, :-1]) ** 2).sum(dim=-1) + _TINY)
        away = torch.sqrt(((points_m[:, -1] - asked.goal_m) ** 2).sum(dim=-1) + _TINY)
        near = torch.cumsum(steps, dim=1) <= self.fear_ahead_m
        afraid = ((cost[:, 1:] > self.fear_cost) & near).any(dim=1).to(path.dtype)
        terms = {
            "obstacle": cost.sum(dim=1),
            "height": path[..., 2].abs().sum(dim=1),
            "motion": motion(path, asked.goal_m),
            "goal": torch.log1p(away),
        }
        return Judged(terms, path, distance, rise, afraid.detach())

    def cost(self, distance_m: Tensor) -> Tensor:
        """Cost at places that are this far from what hinders."""
        deep = (self.inflate_m - distance_m) / self.smooth_m
        bell = torch.exp(-0.5 * deep * deep) / math.sqrt(2.0 * math.pi)
        smooth = self.smooth_m * (deep * torch.special.ndtr(deep) + bell)
        return torch.log(smooth / self.cell_m + 1.00001)

    def total(self, judged: Judged) -> Tensor:
        """Weighted cost of each path (b,), without fear."""
        return torch.stack([float(getattr(self, name)) * term for name, term in judged.terms.items()]).sum(0)
