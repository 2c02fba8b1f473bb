"""The trained networks in a folder: the rows of the ablation, each trained with one seed or more."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labr_autonomy.errors import BadInput
from labr_autonomy.gkpn.package import MANIFEST_NAME, ONNX_NAME, read_manifest, read_verified
from labr_autonomy.gkpn.runtime import start
from sim.bench.alone.names import method_of

VARIANTS = ("iplanner", "lapn", "spn", "gkpn")  # in the order of the paper's rows
_REMEDY = "Export it by the training of this version, or move it elsewhere"


@dataclass(frozen=True, slots=True)
class Trained:
    """One trained network."""

    folder: Path
    variant: str  # of `VARIANTS`
    seed: int  # of its training
    loss: float  # at the end of its training
    steps: int
    height: int  # of the image that it takes
    width: int

    @property
    def method(self) -> str:
        """Its name in a benchmark."""
        return method_of(self.folder)


def find_trained(runs: Path) -> list[Trained]:
    """Every network whose weights' folder lies in a folder, by variant and seed.

    Raises:
        BadInput: when there is none; when one is of no row of the table, does not say how it was trained, or
            is there twice; or when they take images of different sizes.
    """
    folders = sorted(path.parent for path in runs.glob(f"*/{MANIFEST_NAME}"))
    if not folders:
        raise BadInput(
            f"{runs} holds no trained network", f"Name a folder of folders with {MANIFEST_NAME} each"
        )
    found: dict[tuple[int, int], Trained] = {}
    for folder in folders:
        one = _read(folder)
        key = (VARIANTS.index(one.variant), one.seed)
        if key in found:
            raise BadInput(
                f"{folder} and {found[key].folder} are both {one.variant} trained with seed {one.seed}",
                "Move one of them elsewhere",
            )
        found[key] = one
    trained = [found[key] for key in sorted(found)]
    _require_one_size(trained)
    return trained


def _read(folder: Path) -> Trained:
    manifest = read_manifest(folder)
    name = str(manifest.get("name", ""))
    variant = name.partition("-")[0]
    if variant not in VARIANTS:
        raise BadInput(
            f"the network in {folder} is called '{name}', which is no row of Table I",
            f"Table I compares {', '.join(VARIANTS)}; move it elsewhere",
        )
    height, width = start(read_verified(folder, ONNX_NAME)).inputs["depth"][2:]
    training = manifest.get("training", {})
    return Trained(
        folder,
        variant,
        int(_figure(folder, training, "seed")),
        _figure(folder, training, "loss"),
        int(_figure(folder, training, "steps")),
        int(height),
        int(width),
    )


def _figure(folder: Path, training: dict[str, Any], key: str) -> float:
    value = training.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise BadInput(f"the manifest in {folder} does not tell the training's {key}", _REMEDY)
    return float(value)


def _require_one_size(trained: Sequence[Trained]) -> None:
    """Networks are compared at one resolution, or the pixels are compared instead."""
    first = trained[0]
    other = next((t for t in trained if (t.height, t.width) != (first.height, first.width)), None)
    if other is not None:
        raise BadInput(
            f"{first.folder} takes images of {first.width}x{first.height} and {other.folder} of "
            f"{other.width}x{other.height}, and Table I compares networks at one resolution",
            "Keep those of one resolution in the folder",
        )
