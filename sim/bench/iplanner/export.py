"""Writing iPlanner's weights: one ONNX file, weights stored in half precision, and its manifest.

Every weight (convolutions and matrices) is stored as float16 and cast to float32 when the session loads, so
that it computes in single precision; the tensors keep their names, so that torch reads the same file.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import numpy_helper

from labr_autonomy.gkpn.dataset import Views
from labr_autonomy.gkpn.evaluate import evaluate, network_planner, straight_line
from labr_autonomy.gkpn.iplanner import IPlanner, IPlannerConfig
from labr_autonomy.gkpn.losses import LossConfig
from labr_autonomy.gkpn.onnx_file import OPSET, onnx_bytes
from labr_autonomy.gkpn.package import read_manifest, read_verified, write_manifest
from sim.bench.iplanner.weights import ONNX_NAME, REMEDY

HALF = ".half"  # ends the name of a tensor stored as float16
COUNTER = "num_batches_tracked"  # of a batch norm; not part of the model file


def export(net: IPlanner, folder: Path, validation: Views, facts: dict[str, Any]) -> None:
    """Write the weights' folder, with the figures of the network as stored and of the straight line.

    Args:
        net: Trained network; its weights are rounded to half precision.
        folder: Where to.
        validation: Unseen scenes the figures are taken on.
        facts: How it was trained; plain JSON values.
    """
    folder.mkdir(parents=True, exist_ok=True)
    net = rounded(net).to(memory_format=torch.contiguous_format).eval()
    config, judge = net.config, LossConfig()
    (folder / ONNX_NAME).write_bytes(
        stored_half(
            onnx_bytes(net, torch.ones(1, 1, config.height, config.width), torch.ones(1, 3), keep_names=True)
        )
    )
    write_manifest(
        folder,
        {
            "network": asdict(config),
            "parameters": sum(p.numel() for p in net.parameters()),
            "input": {"depth_m": [1, 1, config.height, config.width], "goal_level_m": [1, 3]},
            "opset": OPSET,
            "training": facts,
            "metrics": {
                "network": evaluate(network_planner(net), validation, judge),
                "straight_line": evaluate(straight_line, validation, judge),
            },
        },
        (ONNX_NAME,),
    )


def rounded(net: IPlanner) -> IPlanner:
    """The network with its weights rounded to what half precision holds, in place."""
    with torch.no_grad():
        for parameter in net.parameters():
            if parameter.ndim > 1:
                parameter.copy_(parameter.half().float())
    return net


def stored_half(content: bytes) -> bytes:
    """The model with its matrices and kernels stored as float16, each behind a cast to float32."""
    model = onnx.load_from_string(content)
    casts, kept = [], []
    for tensor in model.graph.initializer:
        value = numpy_helper.to_array(tensor)
        if value.dtype != np.float32 or value.ndim < 2:
            kept.append(tensor)
            continue
        kept.append(numpy_helper.from_array(value.astype(np.float16), tensor.name + HALF))
        casts.append(
            onnx.helper.make_node("Cast", [tensor.name + HALF], [tensor.name], to=onnx.TensorProto.FLOAT)
        )
    nodes = [*casts, *model.graph.node]
    del model.graph.initializer[:], model.graph.node[:]
    model.graph.initializer.extend(kept)
    model.graph.node.extend(nodes)
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())


def load_network(folder: Path) -> IPlanner:
    """The network of a weights' folder, in evaluation mode."""
    sizes: dict[str, Any] = read_manifest(folder, REMEDY)["network"]
    sizes = {name: tuple(size) if isinstance(size, list) else size for name, size in sizes.items()}
    net = IPlannerConfig(**sizes).build()
    model = onnx.load_from_string(read_verified(folder, ONNX_NAME, REMEDY))
    found = {t.name.removesuffix(HALF): numpy_helper.to_array(t) for t in model.graph.initializer}
    for node in model.graph.node:
        if node.op_type == "Identity" and node.input[0] in found:  # tensors of equal content are stored once
            found[node.output[0]] = found[node.input[0]]
    state = net.state_dict()
    for name in state:
        if not name.endswith(COUNTER):
            state[name] = torch.from_numpy(found[name].astype(np.float32))
    net.load_state_dict(state)
    net.eval()
    return net
