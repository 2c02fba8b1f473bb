"""What `train` asks of a network and of its loss: GKPN and the benchmark's iPlanner learn by one loop."""

from __future__ import annotations

from typing import Any, ClassVar, Protocol

from torch import Tensor, nn

from labr_autonomy.gkpn.losses import Losses


class Loss(Protocol):
    """Weights and lengths of a loss; a frozen dataclass."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    def losses(
        self, points_m: Tensor, logit: Tensor, goal_m: Tensor, pose: Tensor, solids: Tensor, floor_m: Tensor
    ) -> Losses:
        """All terms for a batch; arguments as of `labr_autonomy.gkpn.losses.losses`."""
        ...


class NetworkSpec(Protocol):
    """Sizes of a network; a frozen dataclass.

    What it builds has `encode(depth_m (b, 1, h, w)) -> features` and
    `plan(features, goal_m (b*k, 3)) -> (key points (b*k, n, 3), logit (b*k, 1))`.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]

    def build(self) -> nn.Module:
        """A fresh network."""
        ...
