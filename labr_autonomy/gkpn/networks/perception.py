"""From a depth image to features O_t: a plain stem or SPN's two branches, then residual blocks.

SPN (paper, section IV-B): O_t = RB([Convpool(D_t), SConvpool(D_t)]).
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from labr_autonomy.gkpn.networks.config import PerceptionConfig


def exactly(x: Tensor) -> torch.autocast:
    """A context in which x's device computes in the precision that x has."""
    return torch.autocast("cpu" if x.is_meta else x.device.type, enabled=False)


def conv(inputs: int, outputs: int, size: int, stride: int, norm: bool) -> nn.Module:
    """Convolution that keeps the size (but for the stride), with batch norm or without."""
    layer = nn.Conv2d(inputs, outputs, size, stride, size // 2, bias=False)
    return nn.Sequential(layer, nn.BatchNorm2d(outputs)) if norm else layer


class Residual(nn.Module):  # type: ignore[misc]  # torch is untyped here
    """RB: two 3x3 convolutions and a short cut (He et al., 2016)."""

    def __init__(self, inputs: int, outputs: int, stride: int, norm: bool) -> None:
        super().__init__()
        self.first = conv(inputs, outputs, 3, stride, norm)
        self.second = conv(outputs, outputs, 3, 1, norm)
        same = inputs == outputs and stride == 1
        self.short = nn.Identity() if same else conv(inputs, outputs, 1, stride, True)

    def forward(self, x: Tensor) -> Tensor:
        """(b, inputs, h, w) to (b, outputs, h / stride, w / stride)."""
        return functional.relu(self.second(functional.relu(self.first(x))) + self.short(x))


class Branch(nn.Module):  # type: ignore[misc]  # torch is untyped here
    """Convpool: a convolution (7x7 as published) and a 3x3 maximum, each with stride 2."""

    def __init__(self, inputs: int, outputs: int, size: int, norm: bool) -> None:
        super().__init__()
        self.conv = conv(inputs, outputs, size, 2, norm)

    def forward(self, x: Tensor) -> Tensor:
        """(b, inputs, h, w) to (b, outputs, h / 4, w / 4)."""
        return functional.max_pool2d(functional.relu(self.conv(x)), 3, 2, 1)


class Sobel(nn.Module):  # type: ignore[misc]  # torch is untyped here
    """Gradients across and down by the Sobel operator, in units of one pixel."""

    kernels: Tensor

    def __init__(self) -> None:
        super().__init__()
        across = torch.tensor([[-1.0, 0.0, 1.0], [-2.0, 0.0, 2.0], [-1.0, 0.0, 1.0]]) / 8.0
        self.register_buffer("kernels", torch.stack([across, across.T])[:, None].contiguous())

    def forward(self, depth: Tensor) -> Tensor:
        """(b, 1, h, w) to (b, 2, h, w)."""
        with exactly(depth):  # differences need the full mantissa
            padded = functional.pad(depth.float(), (1, 1, 1, 1), mode="replicate")
            return functional.conv2d(padded, self.kernels)


class Perception(nn.Module):  # type: ignore[misc]  # torch is untyped here
    """Stem and residual blocks.

    Args:
        config: Widths and branches.
        inputs: Channels of what is looked at; 1 for a depth image.
    """

    def __init__(self, config: PerceptionConfig, inputs: int = 1) -> None:
        super().__init__()
        self.repeated = config.repeated
        self.plain = Branch(inputs * config.repeated, config.stem, config.stem_px, config.norm)
        self.sobel = Sobel() if config.edges else None
        self.edges = Branch(2, config.stem, config.stem_px, config.norm) if config.edges else None
        channels, layers = config.stem * (2 if config.edges else 1), []
        for width, count, stride in zip(config.stages, config.blocks, config.strides, strict=True):
            for i in range(count):
                layers.append(Residual(channels, width, stride if i == 0 else 1, config.norm))
                channels = width
        self.blocks = nn.Sequential(*layers)
        if not config.norm:  # as published
            for module in self.modules():
                if isinstance(module, nn.Conv2d):
                    nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def forward(self, x: Tensor) -> Tensor:
        """(b, inputs, h, w) to O_t (b, C, h', w') with M = h' w' places."""
        seen = [self.plain(x.expand(-1, self.repeated, -1, -1) if self.repeated > 1 else x)]
        if self.sobel is not None and self.edges is not None:
            seen.append(self.edges(self.sobel(x)))
        return self.blocks(torch.cat(seen, dim=1))


def places(config: PerceptionConfig, height: int, width: int) -> tuple[int, int]:
    """Rows and columns of O_t for an image of this size."""
    for stride in (2, 2, *config.strides):
        height, width = -(-height // stride), -(-width // stride)
    return height, width
