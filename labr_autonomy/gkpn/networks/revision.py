"""Key points looked at on the map and moved: a few learned steps of descent, beyond the paper.

A path proposed from features alone cannot be told to pass 0.1 m farther left. So the map is sampled along the
spline through the key points, on it and beside it, and two linear maps answer with a correction; mu is judged
from what the last look finds, so that it speaks of the very path that leaves the network.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from labr_autonomy.gkpn.local_map import BEHIND_M, CELL_M, SIDE
from labr_autonomy.gkpn.networks.config import RevisionConfig
from labr_autonomy.gkpn.networks.perception import exactly
from labr_autonomy.gkpn.spline import spline_matrix

ASIDE_M = 0.3  # how far beside the path is looked: about the robot's radius
PLACES = 5  # on the path and on four sides of it


class Look(nn.Module):  # type: ignore[misc]  # torch is untyped here
    """What the map holds along paths, as numbers for a linear map.

    Args:
        config: Widths.
        channels: Of the map.
        coarse: Channels of its features.
        key_points: Of a path.
    """

    matrix: Tensor
    aside: Tensor

    def __init__(self, config: RevisionConfig, channels: int, coarse: int, key_points: int) -> None:
        super().__init__()
        rows = torch.tensor(spline_matrix(key_points)[:: config.every, 1:].copy(), dtype=torch.float32)
        self.register_buffer("matrix", rows)
        sides = torch.tensor([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        self.register_buffer("aside", ASIDE_M * sides)
        self.point = nn.Linear(PLACES * channels + coarse + 2, config.point)
        self.outputs = config.point * len(rows)

    def forward(self, points_m: Tensor, floor_m: Tensor, stack: Tensor, features: Tensor) -> Tensor:
        """Look along paths.

        Args:
            points_m: (b*k, h, n, 3) key points, level frame; k goals of each map in a row.
            floor_m: (b*k, 1) driving height, level frame.
            stack: (b, channels, SIDE, SIDE) the map.
            features: (b, coarse, s, s) of it.

        Returns:
            (b*k, h, outputs)
        """
        count, hypotheses = points_m.shape[:2]
        with exactly(points_m):  # places need the full mantissa
            path = self.matrix @ points_m  # (b*k, h, p, 3)
            maps, places = stack.shape[0], path.shape[2]
            at = path[..., :2].reshape(maps, -1, 1, 2)
            fine = functional.grid_sample(stack, _grid(at + self.aside), align_corners=False)
            wide = functional.grid_sample(features, _grid(at), align_corners=False, padding_mode="border")
        fine = fine.permute(0, 2, 3, 1).reshape(count, hypotheses, places, -1)
        wide = wide.permute(0, 2, 3, 1).reshape(count, hypotheses, places, -1)
        rise = path[..., 2:] - floor_m[:, :, None, None]
        along = torch.cat([fine, wide, rise, rise.clamp(0.0, 0.5)], dim=-1)
        return functional.relu(self.point(along)).flatten(2)


def _grid(xy_m: Tensor) -> Tensor:
    """Places (..., 2) of the level frame in the units of `grid_sample`, whose x runs along the columns."""
    half = 0.5 * SIDE * CELL_M
    return torch.stack([xy_m[..., 1] / half, (xy_m[..., 0] + BEHIND_M) / half - 1.0], dim=-1)


class Revision(nn.Module):  # type: ignore[misc]  # torch is untyped here
    """The steps, and the opinion on what they end with.

    Args:
        config: How many, how wide.
        channels: Of the map.
        coarse: Channels of its features.
        shared: Numbers that the heads know about image, map and goal.
        key_points: Of a path.
    """

    def __init__(
        self, config: RevisionConfig, channels: int, coarse: int, shared: int, key_points: int
    ) -> None:
        super().__init__()
        self.narrow = nn.Conv2d(coarse, config.context, 1)

        def look() -> Look:
            return Look(config, channels, config.context, key_points)

        self.looks = nn.ModuleList([look() for _ in range(config.steps + 1)])
        inputs = self.looks[0].outputs + shared + 3 * key_points
        self.steps = nn.ModuleList(
            nn.Sequential(
                nn.Linear(inputs, config.hidden), nn.ReLU(), nn.Linear(config.hidden, 3 * key_points)
            )
            for _ in range(config.steps)
        )
        self.fear = nn.Sequential(nn.Linear(inputs, config.hidden), nn.ReLU(), nn.Linear(config.hidden, 1))
        with torch.no_grad():
            for step in self.steps:
                step[2].weight.mul_(0.1)
                step[2].bias.zero_()

    def forward(
        self, points_m: Tensor, floor_m: Tensor, stack: Tensor, features: Tensor, shared: Tensor
    ) -> tuple[list[Tensor], Tensor]:
        """Paths (b*k, h, n, 3) after each step, the proposed ones first, and logits of mu (b*k, h)."""
        near = functional.relu(self.narrow(features)).float()
        every = [points_m]
        same = shared[:, None].expand(-1, points_m.shape[1], -1)
        for look, step in zip(self.looks[:-1], self.steps, strict=True):
            now = every[-1]
            seen = look(now, floor_m, stack, near)
            move = step(torch.cat([seen, same, now.flatten(2)], dim=-1)).float()
            every.append(now + move.reshape(now.shape))
        # mu must not move the path, only judge it
        last = every[-1].detach()
        seen = self.looks[-1](last, floor_m, stack, near)
        return every, self.fear(torch.cat([seen, same, last.flatten(2)], dim=-1))[..., 0].float()
