"""GKPN: Sobel Perception Network (SPN) and Lightweight Attention Planning Network (LAPN), in PyTorch.

Equation names follow the paper's section IV-B. A small network of the paper's structure: 160x90 input,
about 1.6 M parameters, batch norm in place of iPlanner's norm-free blocks.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

DEPTH_SCALE_M = 10.0  # input depth and goal are divided by this
HEIGHT, WIDTH = 90, 160  # input image


@dataclass(frozen=True, slots=True)
class NetworkConfig:
    """Widths of the layers."""

    stem: int = 16  # channels of each of the two branches
    stages: tuple[int, ...] = (32, 64, 128, 160)
    blocks: tuple[int, ...] = (1, 2, 2, 1)
    strides: tuple[int, ...] = (1, 2, 2, 1)
    embed: int = 96  # C1
    tail: int = 48  # channels of the planning convolution
    hidden: tuple[int, int] = (256, 128)
    fear_hidden: int = 64
    key_points: int = 5  # n

    def build(self) -> Gkpn:
        """A fresh network."""
        return Gkpn(self)


def _conv(inputs: int, outputs: int, size: int, stride: int = 1) -> nn.Sequential:
    """Convolution with batch norm."""
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, size, stride, size // 2, bias=False), nn.BatchNorm2d(outputs)
    )


class Residual(nn.Module):  # type: ignore[misc]  # torch is untyped here
    """RB: two 3x3 convolutions and a short cut."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.first = _conv(inputs, outputs, 3, stride)
        self.second = _conv(outputs, outputs, 3)
        same = inputs == outputs and stride == 1
        self.short = nn.Identity() if same else _conv(inputs, outputs, 1, stride)

    def forward(self, x: Tensor) -> Tensor:
        """(b, inputs, h, w) to (b, outputs, h / stride, w / stride)."""
        return functional.relu(self.second(functional.relu(self.first(x))) + self.short(x))


class Spn(nn.Module):  # type: ignore[misc]  # torch is untyped here
    """O_t = RB([Convpool(D_t), SConvpool(D_t)]), the paper's first equation of section IV-B."""

    sobel: Tensor

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        kernel = torch.tensor([[-1.0, 0.0, 1.0], [-2.0, 0.0, 2.0], [-1.0, 0.0, 1.0]]) / 8.0
        self.register_buffer("sobel", torch.stack([kernel, kernel.T])[:, None].contiguous())
        self.depth_branch = nn.Sequential(_conv(1, config.stem, 7, 2), nn.ReLU(), nn.MaxPool2d(3, 2, 1))
        self.edge_branch = nn.Sequential(_conv(2, config.stem, 7, 2), nn.ReLU(), nn.MaxPool2d(3, 2, 1))
        channels, layers = 2 * config.stem, []
        for width, count, stride in zip(config.stages, config.blocks, config.strides, strict=True):
            for i in range(count):
                layers.append(Residual(channels, width, stride if i == 0 else 1))
                channels = width
        self.blocks = nn.Sequential(*layers)

    def forward(self, depth: Tensor) -> Tensor:
        """(b, 1, 90, 160) scaled depth to O_t (b, C, h, w) with M = h*w places."""
        with torch.autocast("cpu", enabled=False):  # differences of depths need the full mantissa
            padded = functional.pad(depth, (1, 1, 1, 1), mode="replicate")
            edges = functional.conv2d(padded, self.sobel)
        return self.blocks(torch.cat([self.depth_branch(depth), self.edge_branch(edges)], dim=1))


class Lapn(nn.Module):  # type: ignore[misc]  # torch is untyped here
    """Key points and mu from O_t and the goal; linear in the number of places M.

    O_weight = Softmax(Linear(p_G)) over the M places, times M so that its mean is one;
    O_atten = Linear(O_t) * O_weight, place by place; K_t = Linear(relu(Conv([O_atten, p_G]))).
    """

    def __init__(self, config: NetworkConfig, channels: int, places: tuple[int, int]) -> None:
        super().__init__()
        h, w = places
        self.places = h * w
        self.key_points = config.key_points
        self.goal = nn.Linear(7, config.embed)
        self.weight = nn.Linear(config.embed, self.places)
        self.adjust = nn.Conv2d(channels, config.embed, 1)
        self.conv = nn.Conv2d(2 * config.embed, config.tail, 3)
        self.shared = nn.Linear(config.tail * (h - 2) * (w - 2), config.hidden[0])
        self.points = nn.Sequential(
            nn.Linear(config.hidden[0], config.hidden[1]),
            nn.ReLU(),
            nn.Linear(config.hidden[1], 3 * config.key_points),
        )
        self.fear = nn.Sequential(
            nn.Linear(config.hidden[0], config.fear_hidden), nn.ReLU(), nn.Linear(config.fear_hidden, 1)
        )
        with torch.no_grad():  # start near the straight line
            self.points[2].weight.mul_(0.1)
            self.points[2].bias.zero_()

    def forward(self, features: Tensor, goal_code: Tensor) -> tuple[Tensor, Tensor]:
        """O_t (b, C, h, w) and codes (b*k, 7) to offsets (b*k, n, 3) and fear logits (b*k, 1)."""
        adjusted = self.adjust(features)
        each = goal_code.shape[0] // adjusted.shape[0]
        if each > 1:
            adjusted = adjusted.repeat_interleave(each, dim=0)
        embedded = self.goal(goal_code)
        weight = functional.softmax(self.weight(functional.relu(embedded)), dim=1) * self.places
        h, w = adjusted.shape[2:]
        attended = adjusted * weight.reshape(-1, 1, h, w)
        goal_map = embedded[:, :, None, None].expand(-1, -1, h, w)
        tail = functional.relu(self.conv(torch.cat([attended, goal_map], dim=1)))
        shared = functional.relu(self.shared(tail.flatten(1)))
        return self.points(shared).reshape(-1, self.key_points, 3), self.fear(shared)


class Gkpn(nn.Module):  # type: ignore[misc]  # torch is untyped here
    """Depth [m] and goal [m, level frame] to key points [m, level frame] and the logit of mu.

    The key points are offsets from a base: the straight line in x, y, and the goal's height on the last
    point only. Without that height the energy loss traps the network on the floor (|z| has a kink at 0).
    """

    line: Tensor

    def __init__(self, config: NetworkConfig | None = None) -> None:
        super().__init__()
        self.config = config or NetworkConfig()
        self.spn = Spn(self.config)
        h, w = HEIGHT, WIDTH
        for stride in (2, 2, *self.config.strides):
            h, w = (h + stride - 1) // stride, (w + stride - 1) // stride
        self.lapn = Lapn(self.config, self.config.stages[-1], (h, w))
        n = self.config.key_points
        line = torch.zeros(1, n, 3)
        line[0, :, :2] = torch.arange(1, n + 1)[:, None] / n
        line[0, -1, 2] = 1.0
        self.register_buffer("line", line)

    def encode(self, depth_m: Tensor) -> Tensor:
        """O_t of images (b, 1, 90, 160) [m], 0 = invalid."""
        return self.spn(depth_m / DEPTH_SCALE_M)

    def plan(self, features: Tensor, goal_m: Tensor) -> tuple[Tensor, Tensor]:
        """Key points (b*k, n, 3) [m] and logits (b*k, 1) for goals (b*k, 3), k goals per image in a row."""
        distance = torch.sqrt((goal_m * goal_m).sum(dim=1, keepdim=True) + 1e-6)
        code = torch.cat([goal_m / DEPTH_SCALE_M, goal_m / distance, torch.log1p(distance)], dim=1)
        offsets, logit = self.lapn(features, code)
        return goal_m[:, None, :] * self.line + offsets, logit

    def forward(self, depth_m: Tensor, goal_m: Tensor) -> tuple[Tensor, Tensor]:
        """Key points (b, n, 3) and mu (b, 1) in 0..1; what the ONNX file computes."""
        points, logit = self.plan(self.encode(depth_m), goal_m)
        return points, torch.sigmoid(logit)
