"""The pilot with a recorder: every call, what it was given and what it answered, to be made again.

The recorder gets functions that make the messages; they run in the log's thread, and what they look at is
never changed afterwards (values are frozen, arrays are replaced).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from labr_autonomy.config import RobotConfig
from labr_autonomy.guard.fence import Zone
from labr_autonomy.mission.pilot import Pilot
from labr_autonomy.mission.pilot_io import Actions, Look
from labr_autonomy.mission.steps import Step
from labr_autonomy.planner.messages import PlanRequest, PlanResult
from labr_autonomy.record.codec import pack
from labr_autonomy.types import Odometry, Pose

Record = Callable[[Callable[[], dict[str, Any]]], None]


class RecordedPilot(Pilot):
    """Does what the pilot does, and has it written down.

    Args:
        config: The robot.
        duration_s: The mission comes down and ends after this.
        record: Takes each call.
    """

    def __init__(self, config: RobotConfig, duration_s: float, record: Record) -> None:
        super().__init__(config, duration_s=duration_s)
        self._record = record
        robot = config.model_dump(mode="json")
        self._record(lambda: {"call": "make", "robot": robot, "duration_s": pack(duration_s)})

    def load(self, mission: Sequence[Step], zones: Sequence[Zone]) -> None:
        """Set what is to be done, before the first tick."""
        kept, fences = tuple(mission), tuple(zones)
        self._record(lambda: {"call": "load", "mission": pack(kept), "zones": pack(fences)})
        super().load(mission, zones)

    def begin(self, now_s: float) -> None:
        """The mission's clocks start now."""
        self._record(lambda: {"call": "begin", "now_s": now_s})
        super().begin(now_s)

    def insert(self, new: Sequence[Step], now_s: float, *, keep: bool = True) -> None:
        """Do other steps now."""
        kept = tuple(new)
        self._record(lambda: {"call": "insert", "steps": pack(kept), "now_s": now_s, "keep": keep})
        super().insert(new, now_s, keep=keep)

    def skip(self, now_s: float) -> None:
        """Give the present step up."""
        self._record(lambda: {"call": "skip", "now_s": now_s})
        super().skip(now_s)

    def fail(self, reason: str) -> None:
        """Going on is impossible."""
        if not self._deciding:  # what it decides by itself, it will decide again
            self._record(lambda: {"call": "fail", "reason": reason})
        super().fail(reason)

    def tick(self, look: Look, now_s: float) -> Actions:
        """Decide what leaves."""
        self._deciding = True
        try:
            actions = super().tick(look, now_s)
        finally:
            self._deciding = False
        self._record(lambda: {"call": "tick", "now_s": now_s, "look": pack(look), "actions": pack(actions)})
        return actions

    def request(
        self, sequence: int, frame_sequence: int, frame_pose: Pose, odometry: Odometry, now_s: float
    ) -> PlanRequest:
        """What to plan next."""
        made = super().request(sequence, frame_sequence, frame_pose, odometry, now_s)
        self._record(
            lambda: {
                "call": "request",
                "sequence": sequence,
                "frame_sequence": frame_sequence,
                "frame_pose": pack(frame_pose),
                "odometry": pack(odometry),
                "now_s": now_s,
                "request": pack(made),
            }
        )
        return made

    def accept(self, result: PlanResult, now_s: float) -> None:
        """Take over a plan; the planner's own log has it whole."""
        sequence = result.sequence
        self._record(lambda: {"call": "accept", "sequence": sequence, "now_s": now_s})
        super().accept(result, now_s)

    _deciding = False
