"""iPlanner's reaction to fear, as a pure state machine.

As in `iplanner_node.py` of leggedrobotics/iPlanner @ 4a8d823: frames whose path leads forward and is feared
are counted, and after more than three of them the robot stops. While it stands, frames without fear count
down, and at zero it goes on. A new goal starts anew.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from labr_autonomy.types import Array

THRESHOLD = 0.5
FRAMES = 3  # `buffer_size` of the vehicles' configuration
AHEAD_M = 0.5  # the path's direction is that of its first point beyond this
FORWARD_COS = 0.5


@dataclass(frozen=True, slots=True)
class Fear:
    """What is remembered from frame to frame."""

    count: int = 0
    stopped: bool = False


def step(state: Fear, fear: float, forward: bool) -> Fear:
    """One frame.

    Args:
        state: Before it.
        fear: The network's, 0..1.
        forward: Whether its path leads forward.
    """
    count = state.count
    if fear > THRESHOLD and forward:
        count += 0 if state.stopped else 1
    elif state.stopped:
        count -= 1
    stopped = count > FRAMES or (state.stopped and count > 0)
    return Fear(count, stopped)


def leads_forward(path_m: Array) -> bool:
    """Whether a path (n, >=2), body at the origin looking along x, leads forward; a short one does."""
    for x, y in path_m[:, :2]:
        away = math.hypot(x, y)
        if away > AHEAD_M:
            return bool(x > FORWARD_COS * away)
    return True
