"""iPlanner's training loss on the exact outlines of our scenes (leggedrobotics/iPlanner @ 4a8d823).

L = 0.5 L_obs + L_height + 2 L_motion + 5 L_goal + BCE(fear), the first three as sums over the 51 points.

Its cost map is log(G(EDT) + 1.00001): the depth, in 5 cm cells, to which a place lies inside the obstacles
inflated by the robot, smoothed with a Gaussian of 2.5 cells. Here the depth comes from the exact distance to
the outlines of what stands on the floor, and the smoothing of a straight edge in closed form: a ramp p
smoothed by sigma is p Phi(p / sigma) + sigma phi(p / sigma). Its inflation depends on how many points a
surface has (a blurred hit count above 0.3 of its largest value: up to 0.47 m for a wall, less for a post); a
fixed distance takes its place. Unknown places, which it counts as occupied, do not occur.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from labr_autonomy.gkpn.losses import Losses, level_to_odom, scene_distance
from labr_autonomy.gkpn.spline import spline_matrix

_TINY = 1e-9
_AWAY_M = 1e3  # where solids that are no obstacle are put


@dataclass(frozen=True, slots=True)
class IPlannerLoss:
    """Weights (defaults of `CostofTraj`) and lengths of the loss."""

    obstacle: float = 0.5  # sum over the path's points
    height: float = 1.0  # sum over the path's points
    motion: float = 2.0  # sum over the path's segments
    goal: float = 5.0
    fear: float = 1.0
    inflate_m: float = 0.40  # as for GKPN: the robot's radius 0.30 and what it strays
    cell_m: float = 0.05  # unit of the penetration
    smooth_m: float = 0.125  # 2.5 cells
    low_m: float = 0.04  # what ends below this height is floor
    high_m: float = 0.35  # what begins above this height is driven under
    fear_cost: float = 0.5  # cost above which a point counts as a collision
    fear_ahead_m: float = 2.0  # way along the path over which the label looks

    def losses(
        self, points_m: Tensor, logit: Tensor, goal_m: Tensor, pose: Tensor, solids: Tensor, floor_m: Tensor
    ) -> Losses:
        """All terms for a batch of robots on their wheels; arguments as of `gkpn.losses.losses`."""
        matrix = torch.as_tensor(spline_matrix(points_m.shape[1]).copy(), dtype=points_m.dtype)
        path = torch.einsum("pk,bkd->bpd", matrix, functional.pad(points_m, (0, 0, 1, 0)))
        flat = level_to_odom(path, pose) * path.new_tensor([1.0, 1.0, 0.0])
        distance = scene_distance(flat, self.outlines(solids))
        cost = self.cost(distance)
        steps = torch.sqrt(((path[:, 1:] - path[:, :-1]) ** 2).sum(dim=-1) + _TINY)
        even = torch.sqrt((goal_m**2).sum(dim=-1) + _TINY)[:, None] / steps.shape[1]
        away = torch.sqrt(((points_m[:, -1] - goal_m) ** 2).sum(dim=-1) + _TINY)
        near = torch.cumsum(steps, dim=1) <= self.fear_ahead_m
        afraid = ((cost[:, 1:] > self.fear_cost) & near).any(dim=1, keepdim=True).to(logit.dtype)
        terms = {
            "obstacle": cost.sum(dim=1).mean(),
            "height": path[..., 2].abs().sum(dim=1).mean(),
            "motion": (steps - even).abs().sum(dim=1).mean(),
            "goal": torch.log1p(away).mean(),
            "fear": functional.binary_cross_entropy_with_logits(logit, afraid),
        }
        total = torch.stack([float(getattr(self, name)) * term for name, term in terms.items()]).sum()
        return Losses(total, terms, path, distance, afraid)

    def cost(self, distance_m: Tensor) -> Tensor:
        """Cost at places whose centre is this far from the nearest outline."""
        deep = (self.inflate_m - distance_m) / self.smooth_m
        bell = torch.exp(-0.5 * deep * deep) / math.sqrt(2.0 * math.pi)
        smooth = self.smooth_m * (deep * torch.special.ndtr(deep) + bell)
        return torch.log(smooth / self.cell_m + 1.00001)

    def outlines(self, solids: Tensor) -> Tensor:
        """Rows (b, n, 8) of upright solids without end for what stands in the way on a floor at z = 0."""
        bottom, top = solids[..., 3] - solids[..., 6], solids[..., 3] + solids[..., 6]
        blocks = (bottom < self.high_m) & (top > self.low_m)
        rows = solids.clone()
        rows[..., 1] = torch.where(blocks, rows[..., 1], torch.full_like(rows[..., 1], _AWAY_M))
        rows[..., 3], rows[..., 6] = 0.0, _AWAY_M
        return rows
