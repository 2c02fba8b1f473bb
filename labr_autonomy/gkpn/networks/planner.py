"""A planning network put together from its configuration."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from labr_autonomy.gkpn.local_map import SHOWN, SIDE
from labr_autonomy.gkpn.networks.config import AttentionConfig, ConcatConfig, NetworkConfig
from labr_autonomy.gkpn.networks.perception import Perception, places
from labr_autonomy.gkpn.networks.planning import Heads, planning
from labr_autonomy.gkpn.networks.revision import Revision

GOAL_CODE = 7  # position, direction, logarithm of the distance


class PlanningNetwork(nn.Module):  # type: ignore[misc]  # torch is untyped here
    """Depth [m] and goal [m, level frame] to key points [m, level frame] and the logit of mu.

    With `from_line` the key points are offsets from a base: the straight line in x, y, and the goal's height
    on the last point only. Without that height the energy loss traps the network on the floor (|z| has a
    kink at 0).

    Args:
        config: What it is made of.
    """

    line: Tensor

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        code = GOAL_CODE if config.from_line else 3
        self.perception = Perception(config.perception)
        size = places(config.perception, config.height, config.width)
        self.planning = planning(config.planning, config.perception.stages[-1], size, code)
        inputs = self.planning.outputs
        self.map_perception: nn.Module | None = None
        self.map_planning: nn.Module | None = None
        if config.map is not None:
            m = config.map
            self.map_perception = Perception(m.perception, SHOWN)
            attention = AttentionConfig(m.embed, m.tail)
            size = places(m.perception, SIDE, SIDE)
            self.map_planning = planning(attention, m.perception.stages[-1], size, code)
            inputs += self.map_planning.outputs
        n, plan = config.key_points, config.planning
        fear = plan.fear if config.revision is None else None
        self.heads = Heads(inputs, plan.hidden, fear, config.hypotheses, n, config.from_line)
        self.revision: Any = None
        if config.revision is not None:
            assert config.map is not None, "paths are looked at on a map"
            coarse = config.map.perception.stages[-1]
            self.revision = Revision(config.revision, SHOWN, coarse, plan.hidden[0], n)
        line = torch.zeros(1, 1, n, 3)
        if config.from_line:
            line[..., :2] = torch.arange(1, n + 1)[:, None] / n
            line[..., -1, 2] = 1.0
        self.register_buffer("line", line)

    def encode(self, depth_m: Tensor, local_map: Tensor | None = None) -> list[Tensor]:
        """O_t of images (b, 1, h, w) [m], 0 = invalid, and of maps (b, SHOWN, SIDE, SIDE) in 0..1.

        The maps themselves come third, where there are some.
        """
        features = [self.perception(depth_m / self.config.unit_m)]
        if self.map_perception is not None:
            assert local_map is not None, "this network looks at a map as well"
            features += [self.map_perception(local_map), local_map]
        return features

    def plan(
        self, features: list[Tensor], goal_m: Tensor, floor_m: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Paths and logits; see `stages`, of which it gives the last.

        Returns:
            Key points (b*k, hypotheses, n, 3) [m] and logits (b*k, hypotheses).
        """
        every, logit = self.stages(features, goal_m, floor_m)
        return every[-1], logit

    def stages(
        self, features: list[Tensor], goal_m: Tensor, floor_m: Tensor | None = None
    ) -> tuple[list[Tensor], Tensor]:
        """Paths and logits for goals (b*k, 3), k goals of each image in a row.

        Args:
            features: Of `encode`.
            goal_m: Level frame.
            floor_m: (b*k, 1) driving height in the level frame, for a network that revises its paths.

        Returns:
            Key points (b*k, hypotheses, n, 3) [m] as proposed and after each revision, and the logits
            (b*k, hypotheses) of the last.
        """
        code = self._code(goal_m)
        seen = [self.planning(features[0], code)]
        if self.map_planning is not None:
            seen.append(self.map_planning(features[1], code))
        shared, offsets = self.heads(torch.cat(seen, dim=1))
        scale = 1.0 if self.config.from_line else self.config.unit_m
        points = goal_m[:, None, None, :] * self.line + offsets.float() * scale
        if self.revision is None:
            return [points], self.heads.fear(shared).float()
        assert floor_m is not None, "a network that revises its paths is told where the floor is"
        every, logit = self.revision(points, floor_m, features[2], features[1], shared)
        return every, logit

    @property
    def opinion(self) -> nn.Linear:
        """The last layer of mu, whose scale and shift calibration sets."""
        layers = self.heads.fear if self.revision is None else self.revision.fear
        return layers[2]

    def _code(self, goal_m: Tensor) -> Tensor:
        scaled = goal_m / self.config.unit_m
        if not self.config.from_line:
            return scaled
        distance = torch.sqrt((goal_m * goal_m).sum(dim=1, keepdim=True) + 1e-6)
        return torch.cat([scaled, goal_m / distance, torch.log1p(distance)], dim=1)

    def forward(
        self,
        depth_m: Tensor,
        goal_m: Tensor,
        local_map: Tensor | None = None,
        floor_m: Tensor | None = None,
    ) -> tuple[Tensor, Tensor]:
        """Key points (b, hypotheses, n, 3) and mu (b, hypotheses) in 0..1; what the ONNX file computes."""
        points, logit = self.plan(self.encode(depth_m, local_map), goal_m, floor_m)
        return points, torch.sigmoid(logit)


def build(config: NetworkConfig) -> PlanningNetwork:
    """A fresh network."""
    return PlanningNetwork(config)


def examples(config: NetworkConfig) -> list[Tensor]:
    """One of each input: depth, goal and, where the network takes them, map and floor."""
    out = [torch.ones(1, 1, config.height, config.width), torch.tensor([[2.0, 0.5, 0.0]])]
    if config.map is not None:
        out.append(torch.zeros(1, SHOWN, SIDE, SIDE))
    if config.revision is not None:
        out.append(torch.zeros(1, 1))
    return out


def from_values(values: dict[str, Any]) -> NetworkConfig:
    """The configuration that `dataclasses.asdict` gave, read back from JSON."""
    from labr_autonomy.gkpn.networks.config import MapConfig, PerceptionConfig, RevisionConfig

    def tuples(part: dict[str, Any]) -> dict[str, Any]:
        return {key: tuple(v) if isinstance(v, list) else v for key, v in part.items()}

    parts = dict(values)
    parts["perception"] = PerceptionConfig(**tuples(parts["perception"]))
    kind = AttentionConfig if "embed" in parts["planning"] else ConcatConfig
    parts["planning"] = kind(**tuples(parts["planning"]))
    if parts.get("map") is not None:
        m = dict(parts["map"])
        m["perception"] = PerceptionConfig(**tuples(m["perception"]))
        parts["map"] = MapConfig(**m)
    if parts.get("revision") is not None:
        parts["revision"] = RevisionConfig(**parts["revision"])
    return NetworkConfig(**parts)
