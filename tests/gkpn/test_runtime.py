"""OpenVINO gives what ONNX Runtime gives, where it is installed."""

import numpy as np
import pytest

from labr_autonomy.gkpn.package import ONNX_NAME, packaged_dir, read_verified
from labr_autonomy.gkpn.runtime import OnnxRuntime, start


def test_openvino_answers_as_onnx_runtime_does():
    pytest.importorskip("openvino", reason="an extra: pip install 'labr-autonomy[openvino]'")
    model = read_verified(packaged_dir(), ONNX_NAME)
    one, other = start(model), start(model, name="openvino")
    assert other.inputs == one.inputs
    rng = np.random.default_rng(3)
    for _ in range(5):
        feed = {name: rng.uniform(0.0, 1.0, shape).astype(np.float32) for name, shape in one.inputs.items()}
        feed["depth"] *= 9.0
        feed["goal"] *= 4.0
        for expected, found in zip(one.run(feed), other.run(feed), strict=True):
            assert np.abs(expected - found).max() < 1e-4


def test_onnx_runtime_is_what_runs_unless_asked_otherwise():
    assert isinstance(start(read_verified(packaged_dir(), ONNX_NAME)), OnnxRuntime)
