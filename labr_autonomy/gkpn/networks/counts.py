"""How large a network is: parameters, and floating-point operations of one plan."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.utils.flop_counter import FlopCounterMode

from labr_autonomy.gkpn.networks.config import NetworkConfig
from labr_autonomy.gkpn.networks.planner import build, examples


def counts(config: NetworkConfig) -> tuple[float, float]:
    """Millions of parameters and billions of FLOPs of a network of this configuration."""
    with torch.device("meta"):  # shapes alone: nothing is computed
        return counts_of(build(config), *(torch.empty_like(one, device="meta") for one in examples(config)))


def counts_of(net: nn.Module, *inputs: Tensor) -> tuple[float, float]:
    """The same of a network at hand, for an example of each of its inputs.

    FLOPs are twice the multiplications of convolutions and matrix products.
    """
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        net.eval()(*inputs)
    parameters = sum(p.numel() for p in net.parameters())
    return parameters / 1e6, counter.get_total_flops() / 1e9
