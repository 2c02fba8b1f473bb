"""What computes a network on the processor: ONNX Runtime, or OpenVINO where it is installed and asked for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from labr_autonomy.gkpn.package import RuntimeName, check_runtime

Arrays = Mapping[str, NDArray[np.float32]]


class Runtime(Protocol):
    """A network ready to run."""

    inputs: dict[str, tuple[int, ...]]  # shapes by name

    def run(self, feed: Arrays) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Key points and mu for the inputs by name."""
        ...


class OnnxRuntime:
    """A network on ONNX Runtime, in single precision.

    Args:
        model: The ONNX file; inputs as of `gkpn.onnx_file`.
        threads: To use.
    """

    def __init__(self, model: bytes, threads: int = 1) -> None:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
        options.log_severity_level = 3
        self._session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
        self.inputs = {i.name: tuple(int(n) for n in i.shape) for i in self._session.get_inputs()}

    def run(self, feed: Arrays) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """See `Runtime`."""
        points, mu = self._session.run(["points", "mu"], dict(feed))
        return points, mu


class OpenVino:
    """The same on OpenVINO; faster on processors with AMX, slower or equal on others.

    Single precision is asked for: left to itself it computes in bfloat16 where it can, which moves key points
    by centimetres.

    Args:
        model: The ONNX file.
        threads: To use.

    Raises:
        BadInput: where OpenVINO is not installed.
    """

    def __init__(self, model: bytes, threads: int = 1) -> None:
        check_runtime("openvino")
        import openvino

        core = openvino.Core()
        hints: dict[str, Any] = {
            "INFERENCE_PRECISION_HINT": "f32",
            "INFERENCE_NUM_THREADS": threads,
            "PERFORMANCE_HINT": "LATENCY",
        }
        compiled = core.compile_model(core.read_model(model), "CPU", hints)
        self._request = compiled.create_infer_request()
        self.inputs = {i.any_name: tuple(int(n) for n in i.shape) for i in compiled.inputs}

    def run(self, feed: Arrays) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """See `Runtime`."""
        found = self._request.infer(dict(feed))
        return np.array(found["points"]), np.array(found["mu"])


RUNTIMES: dict[str, type[OnnxRuntime] | type[OpenVino]] = {"onnxruntime": OnnxRuntime, "openvino": OpenVino}


def start(model: bytes, threads: int = 1, name: RuntimeName = "onnxruntime") -> Runtime:
    """A network's ONNX file ready to run on the processor."""
    return RUNTIMES[name](model, threads)
