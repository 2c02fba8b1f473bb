"""Writing trained weights: safetensors, one ONNX file and the manifest that says what they are."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.torch
import torch

from labr_autonomy.gkpn.learning.calibration import platt, reliability
from labr_autonomy.gkpn.learning.figures import (
    Paths,
    judge_paths,
    mu_when_spoiled,
    network_planner,
    straight_line,
    summary,
)
from labr_autonomy.gkpn.learning.settings import Settings
from labr_autonomy.gkpn.learning.views import Views
from labr_autonomy.gkpn.networks.planner import PlanningNetwork, build, examples, from_values
from labr_autonomy.gkpn.onnx_file import OPSET, onnx_bytes
from labr_autonomy.gkpn.package import ONNX_NAME, TENSORS_NAME, read_manifest, read_verified, write_manifest

GOAL_RANGE_M = 7.0  # farthest goals of the data (`sim.training_data.goals`)


def calibrate(net: PlanningNetwork, views: Views, *, land_only: bool) -> tuple[dict[str, Any], Paths]:
    """Make mu a probability: scale and shift its logit by what becomes of every other scene's paths.

    Returns:
        Figures and reliability over the scenes that were left out, and all paths judged afterwards.
    """
    paths = judge_paths(network_planner(net), views, land_only=land_only)
    fitted = paths["scene"] % 2 == 0
    scale, shift = platt(paths["logit"][fitted], paths["fear"][fitted])
    with torch.no_grad():
        net.opinion.weight.mul_(scale)
        net.opinion.bias.mul_(scale).add_(shift)
    paths = judge_paths(network_planner(net), views, land_only=land_only)
    unseen: Paths = {name: values[~fitted] for name, values in paths.items()} if not fitted.all() else paths
    facts = {
        "scale": round(scale, 4),
        "shift": round(shift, 4),
        "figures": summary(unseen, views.families),
        "reliability": reliability(unseen["mu"], unseen["fear"]),
    }
    return facts, paths


def export(
    net: PlanningNetwork,
    folder: Path,
    settings: Settings,
    training: dict[str, Any],
    validation: Views,
) -> dict[str, Any]:
    """Calibrate mu, and write the weights' folder.

    Args:
        net: Trained network; its mu is calibrated in place.
        folder: Where to.
        settings: Of the run.
        training: How it went; plain JSON values.
        validation: Unseen views that the figures are taken on.

    Returns:
        The figures in the manifest.
    """
    folder.mkdir(parents=True, exist_ok=True)
    net = net.to("cpu", memory_format=torch.contiguous_format).eval()
    _rounded(net)
    calibration, paths = calibrate(net, validation, land_only=settings.land_only)
    config = net.config
    (folder / TENSORS_NAME).write_bytes(safetensors.torch.save(_rounded(net)))
    (folder / ONNX_NAME).write_bytes(onnx_bytes(net, *examples(config)))
    line = judge_paths(straight_line, validation, land_only=settings.land_only)
    metrics = {
        "network": summary(paths, validation.families),
        "straight_line": summary(line, validation.families),
        "calibration": calibration,
        "mean_mu": mu_when_spoiled(network_planner(net), validation),
    }
    write_manifest(
        folder,
        {
            "name": settings.network,
            "network": asdict(config),
            "parameters": int(sum(np.prod(p.shape) for p in net.parameters())),
            "goal_range_m": GOAL_RANGE_M,
            "land_only": settings.land_only,
            "opset": OPSET,
            "training": training,
            "metrics": metrics,
        },
    )
    return metrics


def _rounded(net: PlanningNetwork) -> dict[str, torch.Tensor]:
    """All values, matrices and kernels in half precision: that moves key points by 2 mm and halves the file.

    The network takes on the rounded values, so that all files of a folder say the same.
    """
    learnt = {name for name, value in net.named_parameters() if value.dim() > 1}
    tensors = {
        name: (value.half() if name in learnt else value).contiguous()
        for name, value in net.state_dict().items()
    }
    net.load_state_dict(tensors)
    return tensors


def load_network(folder: Path) -> PlanningNetwork:
    """The network of a weights' folder, in evaluation mode."""
    net = build(from_values(read_manifest(folder)["network"]))
    net.load_state_dict(safetensors.torch.load(read_verified(folder, TENSORS_NAME)))
    net.eval()
    return net
