"""What the lock-step runner asks of a planning method: the planner process's own questions."""

from __future__ import annotations

from typing import Protocol

from labr_autonomy.planner.messages import PlanRequest, PlanResult
from labr_autonomy.types import DepthFrame


class Planner(Protocol):
    """One planning cycle at a time; `labr_autonomy.planner.pipeline.Pipeline` is one."""

    def cycle(self, request: PlanRequest, frame: DepthFrame | None) -> PlanResult:
        """Plan once; without a frame from what is known."""
        ...
