"""A planning network as one ONNX file: inputs `depth`, `goal` and, where it takes them, `map` and `floor`."""

from __future__ import annotations

import io
import warnings

import torch
from torch import Tensor, nn

OPSET = 17


def onnx_bytes(net: nn.Module, *inputs: Tensor) -> bytes:
    """The network for a batch of one.

    Args:
        net: With the call (depth (1, 1, height, width), goal (1, 3), ...) -> (key points, mu).
        inputs: An example of each.
    """
    buffer = io.BytesIO()
    with warnings.catch_warnings():  # the TorchScript exporter is kept on purpose: it needs no onnxscript
        warnings.simplefilter("ignore")
        torch.onnx.export(
            net.eval(),
            inputs,
            buffer,
            input_names=["depth", "goal", "map", "floor"][: len(inputs)],
            output_names=["points", "mu"],
            opset_version=OPSET,
            dynamo=False,
        )
    return buffer.getvalue()
