"""Networks by name: the four rows of the paper's tables, at its size and at the ablation's, and ours.

The widths at the paper's size come from a search for its Table 2; they show that its figures can be met, not
which layers its authors chose. `iplanner` is the published network (leggedrobotics/iPlanner @ 4a8d823) with
32 goal channels at 640x384, the only setting near both of the paper's figures.
"""

from __future__ import annotations

from dataclasses import replace

from labr_autonomy.errors import BadInput
from labr_autonomy.gkpn.networks.config import (
    AttentionConfig,
    ConcatConfig,
    MapConfig,
    NetworkConfig,
    PerceptionConfig,
    RevisionConfig,
)

_RESNET = PerceptionConfig(
    edges=False,
    repeated=3,
    stem=64,
    stages=(64, 128, 256, 512),
    blocks=(2, 2, 2, 2),
    strides=(1, 2, 2, 2),
    norm=False,
)
_ATTENTION = AttentionConfig(embed=256, tail=224, hidden=(896, 512), fear=128)


def _paper(perception: PerceptionConfig, planning: ConcatConfig | AttentionConfig) -> NetworkConfig:
    return NetworkConfig(384, 640, perception, planning)


PAPER: dict[str, NetworkConfig] = {
    "iplanner": replace(_paper(_RESNET, ConcatConfig()), unit_m=1.0, from_line=False),
    "lapn": _paper(replace(_RESNET, stages=(64, 128, 256, 384)), _ATTENTION),
    "spn": _paper(replace(_RESNET, edges=True, repeated=1, stem=48), ConcatConfig()),
    "gkpn": _paper(replace(_RESNET, edges=True, repeated=1, stem=48, stages=(64, 128, 256, 448)), _ATTENTION),
}

_SMALL = PerceptionConfig(edges=False, stem=32)
_SMALL_CONCAT = ConcatConfig(goal=16, tail=(96, 64), hidden=(256, 128), fear=64)

# The same four at 160x90, each side of the comparison as wide as the other: Table 1 in hours, not in weeks.
ABLATION: dict[str, NetworkConfig] = {
    "iplanner-160": NetworkConfig(perception=_SMALL, planning=_SMALL_CONCAT),
    "lapn-160": NetworkConfig(perception=_SMALL),
    "spn-160": NetworkConfig(planning=_SMALL_CONCAT),
    "gkpn-160": NetworkConfig(),
}

_LABR = NetworkConfig(
    perception=PerceptionConfig(
        stem=8, stem_px=5, stages=(24, 48, 96, 128), blocks=(1, 1, 1, 1), strides=(2, 1, 2, 1)
    ),
    planning=AttentionConfig(embed=64, tail=32),
    map=MapConfig(),
    revision=RevisionConfig(),
    hypotheses=1,
)

# What ships (labr-three), and what it loses without each of its additions.
OURS: dict[str, NetworkConfig] = {
    "labr": _LABR,
    "labr-three": replace(_LABR, hypotheses=3),
    "labr-unrevised": replace(_LABR, revision=None),
    "labr-blind": replace(_LABR, map=None, revision=None),
}

# The baseline of the benchmark, at a size that can be trained here: published layers at a quarter of their
# widths, half the image's sides.
BASELINE: dict[str, NetworkConfig] = {
    "iplanner-320": replace(
        PAPER["iplanner"],
        height=180,
        width=320,
        perception=replace(_RESNET, repeated=1, stem=16, stages=(16, 32, 64, 128)),
        planning=ConcatConfig(goal=16, tail=(128, 64), hidden=(256, 128), fear=32),
    ),
}

NETWORKS: dict[str, NetworkConfig] = {**PAPER, **ABLATION, **OURS, **BASELINE}


def find_network(name: str) -> NetworkConfig:
    """The network of a name.

    Raises:
        BadInput: for a name that is not known.
    """
    try:
        return NETWORKS[name]
    except KeyError:
        raise BadInput(f"there is no network '{name}'", f"Choose one of {', '.join(NETWORKS)}.") from None
