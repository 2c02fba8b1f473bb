"""iPlanner's network (Yang et al., RSS 2023), the baseline of the benchmark, at any width and image size.

Layers as in leggedrobotics/iPlanner @ 4a8d823 (`planner_net.py`, `percept_net.py`): a ResNet-18 skeleton with
no norm inside its blocks, batch norm only on the 1x1 short cuts, a goal broadcast over the places, and two
heads on one shared feature. `published()` is the authors' size; the default is what the benchmark ships.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

KERNEL_STEM, KERNEL_FIRST, KERNEL_SECOND = 7, 5, 3


@dataclass(frozen=True, slots=True)
class IPlannerConfig:
    """Widths of the layers. The default: a quarter of the published widths, half the image's sides."""

    height: int = 180  # of the image
    width: int = 320
    stages: tuple[int, ...] = (16, 32, 64, 128)  # the stem is as wide as the first
    goal: int = 16  # channels of the broadcast goal, as published
    tail: tuple[int, int] = (128, 64)  # the decoder's convolutions
    hidden: tuple[int, int] = (256, 128)
    fear_hidden: int = 32
    key_points: int = 5
    unit_m: float = 1.0  # depth and goal are divided by it, key points multiplied; 1 as published

    def build(self) -> IPlanner:
        """A fresh network."""
        return IPlanner(self)


def published() -> IPlannerConfig:
    """The size of the authors' `training_config.json`: 53.33 M parameters at 640x360."""
    return IPlannerConfig(360, 640, (64, 128, 256, 512), 16, (512, 256), (1024, 512), 128)


class _Block(nn.Module):  # type: ignore[misc]  # torch is untyped here
    """Two 3x3 convolutions without norm or bias, and a short cut with batch norm where the size changes."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
        self.second = nn.Conv2d(outputs, outputs, 3, 1, 1, bias=False)
        self.short: nn.Module = nn.Identity()
        if stride != 1 or inputs != outputs:
            self.short = nn.Sequential(
                nn.Conv2d(inputs, outputs, 1, stride, bias=False), nn.BatchNorm2d(outputs)
            )

    def forward(self, x: Tensor) -> Tensor:
        """(b, inputs, h, w) to (b, outputs, h / stride, w / stride)."""
        return functional.relu(self.second(functional.relu(self.first(x))) + self.short(x))


class Encoder(nn.Module):  # type: ignore[misc]  # torch is untyped here
    """PerceptNet: one depth channel, repeated to three, to features at 1/32 of the image's size."""

    def __init__(self, config: IPlannerConfig) -> None:
        super().__init__()
        channels = config.stages[0]
        self.stem = nn.Conv2d(3, channels, KERNEL_STEM, 2, KERNEL_STEM // 2, bias=False)
        layers = []
        for stage, width in enumerate(config.stages):
            layers += [_Block(channels, width, 1 if stage == 0 else 2), _Block(width, width, 1)]
            channels = width
        self.layers = nn.Sequential(*layers)
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def forward(self, depth: Tensor) -> Tensor:
        """(b, 1, h, w) to (b, C, ceil(h / 32), ceil(w / 32))."""
        weight = self.stem.weight.sum(dim=1, keepdim=True)  # the three channels are the same image
        x = functional.relu(functional.conv2d(depth, weight, None, 2, KERNEL_STEM // 2))
        return self.layers(functional.max_pool2d(x, 3, 2, 1))


class Decoder(nn.Module):  # type: ignore[misc]  # torch is untyped here
    """Key points and the fear logit from features and the goal."""

    def __init__(self, config: IPlannerConfig, places: tuple[int, int]) -> None:
        super().__init__()
        self.key_points = config.key_points
        self.goal = nn.Linear(3, config.goal)
        self.conv1 = nn.Conv2d(config.stages[-1] + config.goal, config.tail[0], KERNEL_FIRST, 1, 1)
        self.conv2 = nn.Conv2d(config.tail[0], config.tail[1], KERNEL_SECOND)
        h, w = (side - (KERNEL_FIRST - 3) - (KERNEL_SECOND - 1) for side in places)
        self.fc1 = nn.Linear(config.tail[1] * h * w, config.hidden[0])
        self.fc2 = nn.Linear(config.hidden[0], config.hidden[1])
        self.fc3 = nn.Linear(config.hidden[1], 3 * config.key_points)
        self.frc1 = nn.Linear(config.hidden[0], config.fear_hidden)
        self.frc2 = nn.Linear(config.fear_hidden, 1)

    def forward(self, features: Tensor, goal: Tensor) -> tuple[Tensor, Tensor]:
        """Features (b, C, h, w) and goals (b, 3) to key points (b, n, 3) and logits (b, 1)."""
        h, w = features.shape[2:]
        goal_map = self.goal(goal)[:, :, None, None].expand(-1, -1, h, w)
        return self.heads(self.conv1(torch.cat([features, goal_map], dim=1)))

    def several(self, features: Tensor, goal: Tensor) -> tuple[Tensor, Tensor]:
        """The same for goals (b*k, 3), k of each image in a row, whose features are convolved only once."""
        channels, (h, w) = features.shape[1], features.shape[2:]
        weight = self.conv1.weight
        once = functional.conv2d(features, weight[:, :channels], self.conv1.bias, 1, 1)
        goal_map = self.goal(goal)[:, :, None, None].expand(-1, -1, h, w)
        each = functional.conv2d(goal_map, weight[:, channels:], None, 1, 1)
        return self.heads(once.repeat_interleave(len(goal) // len(features), dim=0) + each)

    def heads(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """What follows the first convolution."""
        x = functional.relu(self.conv2(functional.relu(x)))
        with torch.autocast("cpu", enabled=False):  # metres as they are need the full mantissa
            shared = functional.relu(self.fc1(x.float().flatten(1)))
            points = self.fc3(functional.relu(self.fc2(shared)))
            fear = self.frc2(functional.relu(self.frc1(shared)))
        return points.reshape(-1, self.key_points, 3), fear


class IPlanner(nn.Module):  # type: ignore[misc]  # torch is untyped here
    """Depth [m] and goal [m, level frame] to key points [m, level frame] and the logit of fear."""

    def __init__(self, config: IPlannerConfig | None = None) -> None:
        super().__init__()
        self.config = config or IPlannerConfig()
        self.encoder = Encoder(self.config)
        self.decoder = Decoder(self.config, (-(-self.config.height // 32), -(-self.config.width // 32)))

    def encode(self, depth_m: Tensor) -> Tensor:
        """Features of images (b, 1, h, w) [m], 0 = invalid."""
        return self.encoder(depth_m / self.config.unit_m)

    def plan(self, features: Tensor, goal_m: Tensor) -> tuple[Tensor, Tensor]:
        """Key points (b*k, n, 3) [m] and logits (b*k, 1) for goals (b*k, 3), k goals per image in a row."""
        points, logit = self.decoder.several(features, goal_m / self.config.unit_m)
        return points * self.config.unit_m, logit

    def forward(self, depth_m: Tensor, goal_m: Tensor) -> tuple[Tensor, Tensor]:
        """Key points (b, n, 3) and fear (b, 1) in 0..1; what the ONNX file computes."""
        unit_m = self.config.unit_m
        points, logit = self.decoder(self.encode(depth_m), goal_m / unit_m)
        return points * unit_m, torch.sigmoid(logit)
