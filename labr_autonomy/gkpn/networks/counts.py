"""How large a network is: parameters, and floating-point operations of one plan."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.utils.flop_counter import FlopCounterMode

from labr_autonomy.gkpn.local_map import CHANNELS, SIDE
from labr_autonomy.gkpn.networks.config import NetworkConfig
from labr_autonomy.gkpn.networks.planner import build


def counts(config: NetworkConfig) -> tuple[float, float]:
    """Millions of parameters and billions of FLOPs of a network of this configuration."""
    with torch.device("meta"):  # shapes alone: nothing is computed
        maps = [torch.empty(1, CHANNELS, SIDE, SIDE)] if config.map is not None else []
        return counts_of(build(config), torch.empty(1, 1, config.height, config.width), *maps)


def counts_of(net: nn.Module, depth: Tensor, *maps: Tensor) -> tuple[float, float]:
    """The same of a network at hand, for an image (1, 1, h, w) and a goal.

    FLOPs are twice the multiplications of convolutions and matrix products.
    """
    goal = torch.ones(1, 3, device=depth.device)
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        net.eval()(depth, goal, *maps)
    parameters = sum(p.numel() for p in net.parameters())
    return parameters / 1e6, counter.get_total_flops() / 1e9
