"""From features O_t and a goal to key points and the logit of mu: iPlanner's decoder, or LAPN.

LAPN (paper, section IV-B): O_weight = Softmax(Linear(p_G)), O_atten = Linear(O_t) x O_weight place by place,
K_t = Linear(relu(Conv([O_atten, p_G]))); linear in the number of places M.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from labr_autonomy.gkpn.networks.config import AttentionConfig, ConcatConfig

FIRST_PX, SECOND_PX, LAST_PX = 5, 3, 3


class Concat(nn.Module):  # type: ignore[misc]  # torch is untyped here
    """iPlanner's: the goal broadcast over the places beside the features, and two convolutions.

    Args:
        config: Widths.
        channels: Of the features.
        places: Rows and columns of the features.
        goal: Numbers that describe a goal.
    """

    def __init__(self, config: ConcatConfig, channels: int, places: tuple[int, int], goal: int) -> None:
        super().__init__()
        self.goal = nn.Linear(goal, config.goal)
        self.first = nn.Conv2d(channels + config.goal, config.tail[0], FIRST_PX, 1, 1)
        self.second = nn.Conv2d(config.tail[0], config.tail[1], SECOND_PX)
        h, w = (side - (FIRST_PX - 3) - (SECOND_PX - 1) for side in places)
        self.outputs = config.tail[1] * h * w

    def forward(self, features: Tensor, goal: Tensor) -> Tensor:
        """O_t (b, C, h, w) and goals (b*k, g), k of each image in a row, to (b*k, outputs).

        The features' part of the first convolution is taken once for all goals of an image.
        """
        channels, (h, w) = features.shape[1], features.shape[2:]
        each = goal.shape[0] // features.shape[0]
        embedded = self.goal(goal)[:, :, None, None].expand(-1, -1, h, w)
        if each == 1:
            x = self.first(torch.cat([features, embedded], dim=1))
        else:
            weight = self.first.weight
            once = functional.conv2d(features, weight[:, :channels], self.first.bias, 1, 1)
            x = once.repeat_interleave(each, dim=0)
            x = x + functional.conv2d(embedded, weight[:, channels:], None, 1, 1)
        return functional.relu(self.second(functional.relu(x))).flatten(1)


class Attention(nn.Module):  # type: ignore[misc]  # torch is untyped here
    """LAPN up to its convolution; arguments as of `Concat`."""

    def __init__(self, config: AttentionConfig, channels: int, places: tuple[int, int], goal: int) -> None:
        super().__init__()
        h, w = places
        self.embed, self.shape = config.embed, places
        self.goal = nn.Linear(goal, config.embed * h * w)
        self.weight = nn.Linear(config.embed, config.embed)
        self.adjust = nn.Conv2d(channels, config.embed, 1)
        self.conv = nn.Conv2d(2 * config.embed, config.tail, LAST_PX)
        self.outputs = config.tail * (h - LAST_PX + 1) * (w - LAST_PX + 1)

    def forward(self, features: Tensor, goal: Tensor) -> Tensor:
        """O_t (b, C, h, w) and goals (b*k, g), k of each image in a row, to (b*k, outputs)."""
        h, w = self.shape
        each = goal.shape[0] // features.shape[0]
        adjusted = self.adjust(features)  # (b, C1, h, w)
        if each > 1:
            adjusted = adjusted.repeat_interleave(each, dim=0)
        embedded = self.goal(goal).reshape(-1, h * w, self.embed)  # p_G, C1 numbers at each of M places
        weight = functional.softmax(self.weight(embedded), dim=1) * float(h * w)
        attended = adjusted * weight.transpose(1, 2).reshape(-1, self.embed, h, w)
        goal_map = embedded.transpose(1, 2).reshape(-1, self.embed, h, w)
        return functional.relu(self.conv(torch.cat([attended, goal_map], dim=1))).flatten(1)


def planning(
    config: ConcatConfig | AttentionConfig, channels: int, places: tuple[int, int], goal: int
) -> Concat | Attention:
    """The part that a configuration asks for."""
    if isinstance(config, ConcatConfig):
        return Concat(config, channels, places, goal)
    return Attention(config, channels, places, goal)


class Heads(nn.Module):  # type: ignore[misc]  # torch is untyped here
    """Key points from one shared feature, and the layers of mu (`fear`) where it is judged from that alone.

    Args:
        inputs: Numbers that come in.
        hidden: Of the shared feature, and of the layer before the key points.
        fear: Of the layer before mu; None where a revision judges it.
        hypotheses: Paths proposed.
        key_points: Of each.
        quiet: Start with key points near zero: near the straight line, where they are offsets from it.
    """

    def __init__(
        self,
        inputs: int,
        hidden: tuple[int, int],
        fear: int | None,
        hypotheses: int,
        key_points: int,
        quiet: bool,
    ) -> None:
        super().__init__()
        self.shape = (hypotheses, key_points, 3)
        self.shared = nn.Linear(inputs, hidden[0])
        self.path = nn.Sequential(
            nn.Linear(hidden[0], hidden[1]), nn.ReLU(), nn.Linear(hidden[1], hypotheses * key_points * 3)
        )
        self.fear: Any = None
        if fear is not None:
            self.fear = nn.Sequential(nn.Linear(hidden[0], fear), nn.ReLU(), nn.Linear(fear, hypotheses))
        if quiet:
            with torch.no_grad():
                self.path[2].weight.mul_(0.1)
                if hypotheses == 1:
                    self.path[2].bias.zero_()

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """(b, inputs) to the shared feature (b, hidden) and key points (b, hypotheses, n, 3)."""
        shared = functional.relu(self.shared(x))
        return shared, self.path(shared).reshape(-1, *self.shape)
