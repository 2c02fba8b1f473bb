"""What a planning network is made of; plain values, JSON-ready.

Readings of the paper where its text is ambiguous, chosen once for all networks:

- "SConvpool" is the Sobel operator in both directions, then the same convolution and pooling as "Convpool".
- The goal's embedding has C1 x M entries, one vector for each place: a goal broadcast over the places would
  make the softmax over M uniform. The softmax runs over M for each channel and is multiplied by M, so that
  its mean is one.
- The tensor product of O_atten is taken place by place: a matrix product would give C1 x C1 or M x M, not
  the C1 x M that the text states.
- FLOPs are twice the multiplications of convolutions and matrix products.
"""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class PerceptionConfig:
    """From an image to O_t (C, M)."""

    edges: bool = True  # the Sobel branch of SPN beside the plain one
    repeated: int = 1  # channels that the image is repeated to in the plain branch; 3 as published
    stem: int = 16  # channels of each branch
    stem_px: int = 7  # side of its convolution
    stages: tuple[int, ...] = (32, 64, 128, 160)
    blocks: tuple[int, ...] = (1, 2, 2, 1)
    strides: tuple[int, ...] = (1, 2, 2, 1)
    norm: bool = True  # batch norm after every convolution; else on the short cuts alone, as published


@dataclass(frozen=True, slots=True)
class ConcatConfig:
    """iPlanner's planning: the goal broadcast over the places, two convolutions, three linear maps."""

    goal: int = 32  # channels of the broadcast goal
    tail: tuple[int, int] = (512, 256)
    hidden: tuple[int, int] = (1024, 512)
    fear: int = 128


@dataclass(frozen=True, slots=True)
class AttentionConfig:
    """LAPN: linear reweighting of the places by the goal, one convolution, three linear maps."""

    embed: int = 96  # C1
    tail: int = 48
    hidden: tuple[int, int] = (256, 128)
    fear: int = 64


@dataclass(frozen=True, slots=True)
class MapConfig:
    """The second input: what has been seen lately, from above, in the level frame (`gkpn.local_map`)."""

    perception: PerceptionConfig = field(
        default_factory=lambda: PerceptionConfig(
            edges=False, stem=12, stem_px=5, stages=(24, 48), blocks=(1, 1), strides=(1, 2)
        )
    )
    embed: int = 48
    tail: int = 24


@dataclass(frozen=True, slots=True)
class RevisionConfig:
    """Looks at the map along the path, each followed by a correction (`networks.revision`)."""

    steps: int = 2
    every: int = 2  # of the spline's 51 points are looked at
    point: int = 20  # numbers that a place on the path is summed up in
    context: int = 16  # channels of the map's features that are looked at
    hidden: int = 160


@dataclass(frozen=True, slots=True)
class NetworkConfig:
    """A whole network."""

    height: int = 90  # of the image [px]
    width: int = 160
    perception: PerceptionConfig = field(default_factory=PerceptionConfig)
    planning: ConcatConfig | AttentionConfig = field(default_factory=AttentionConfig)
    map: MapConfig | None = None
    revision: RevisionConfig | None = None  # takes a map
    key_points: int = 5  # n
    hypotheses: int = 1  # paths proposed, each with its own mu
    unit_m: float = 10.0  # depth and goal are divided by it
    from_line: bool = True  # key points are offsets from the straight line; else places, as published
