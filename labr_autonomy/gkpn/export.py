"""Writing trained weights: safetensors, one ONNX file and the manifest. Needs the `train` extra."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import safetensors.torch
import torch

from labr_autonomy.gkpn.dataset import Views
from labr_autonomy.gkpn.evaluate import evaluate, network_planner, straight_line
from labr_autonomy.gkpn.losses import LossConfig
from labr_autonomy.gkpn.network import HEIGHT, WIDTH, Gkpn, NetworkConfig
from labr_autonomy.gkpn.onnx_file import OPSET, onnx_bytes
from labr_autonomy.gkpn.package import ONNX_NAME, TENSORS_NAME, read_manifest, read_verified, write_manifest


def export(net: Gkpn, folder: Path, validation: Views, loss: LossConfig, facts: dict[str, Any]) -> None:
    """Write the weights' folder, with the figures of the network and of the straight line.

    Args:
        net: Trained network.
        folder: Where to.
        validation: Unseen scenes the figures are taken on.
        loss: Lengths that define a collision.
        facts: How it was trained; plain JSON values.
    """
    folder.mkdir(parents=True, exist_ok=True)
    net = net.to(memory_format=torch.contiguous_format).eval()
    tensors = {name: value.contiguous() for name, value in net.state_dict().items()}
    (folder / TENSORS_NAME).write_bytes(safetensors.torch.save(tensors))
    (folder / ONNX_NAME).write_bytes(onnx_bytes(net, torch.ones(1, 1, HEIGHT, WIDTH), torch.ones(1, 3)))
    write_manifest(
        folder,
        {
            "network": asdict(net.config),
            "parameters": sum(p.numel() for p in net.parameters()),
            "input": {"depth_m": [1, 1, HEIGHT, WIDTH], "goal_level_m": [1, 3]},
            "opset": OPSET,
            "training": facts,
            "metrics": {
                "network": evaluate(network_planner(net), validation, loss),
                "straight_line": evaluate(straight_line, validation, loss),
            },
        },
    )


def load_network(folder: Path) -> Gkpn:
    """The network of a weights' folder, in evaluation mode."""
    sizes: dict[str, Any] = read_manifest(folder)["network"]
    sizes = {name: tuple(size) if isinstance(size, list) else size for name, size in sizes.items()}
    net = Gkpn(NetworkConfig(**sizes))
    net.load_state_dict(safetensors.torch.load(read_verified(folder, TENSORS_NAME)))
    net.eval()
    return net
