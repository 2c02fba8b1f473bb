"""The weights of the benchmark's iPlanner, and its inference."""

from __future__ import annotations

from pathlib import Path

from labr_autonomy.gkpn.infer import PlanningOnnx

ONNX_NAME = "iplanner.onnx"
REMEDY = "Restore the folder from the repository."


def packaged_dir() -> Path:
    """The weights that come with the package."""
    return Path(__file__).parent / "weights"


class IPlannerOnnx(PlanningOnnx):
    """The trained iPlanner on ONNX Runtime; torch is not needed.

    Args:
        weights_dir: Folder with iplanner.onnx and manifest.json; the packaged one by default.
    """

    def __init__(self, weights_dir: Path | None = None) -> None:
        super().__init__(weights_dir or packaged_dir(), ONNX_NAME, REMEDY)
