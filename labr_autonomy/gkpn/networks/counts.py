"""How large a network is: parameters, and floating-point operations of one plan."""

from __future__ import annotations

import torch
from torch.utils.flop_counter import FlopCounterMode

from labr_autonomy.gkpn.local_map import CHANNELS, SIDE
from labr_autonomy.gkpn.networks.config import NetworkConfig
from labr_autonomy.gkpn.networks.planner import build


def counts(config: NetworkConfig) -> tuple[float, float]:
    """Millions of parameters and billions of FLOPs, twice the multiplications of convolutions and products."""
    with torch.device("meta"):  # shapes alone: nothing is computed
        net = build(config).eval()
        depth = torch.empty(1, 1, config.height, config.width)
        local_map = torch.empty(1, CHANNELS, SIDE, SIDE) if config.map is not None else None
        with FlopCounterMode(display=False) as counter, torch.no_grad():
            net(depth, torch.empty(1, 3), local_map)
    parameters = sum(p.numel() for p in net.parameters())
    return parameters / 1e6, counter.get_total_flops() / 1e9
