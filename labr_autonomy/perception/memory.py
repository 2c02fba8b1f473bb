"""What the robot saw farther back than the rolling map reaches: a coarse plan of where it can drive.

The rolling map forgets what leaves its box. This plan keeps, for each cell, the distance to obstacles as it
was when the robot was last near, so that a dead end is not entered twice. Frame: odom; metres.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.perception.fields import Bits, Field2
from labr_autonomy.perception.shift import moved
from labr_autonomy.types import Array

SIDE_M = 60.0
EDGE_M = 12.0  # nearer than this to its edge the robot is put back into the middle
SEAM_M = 1.0  # so far inside the rolling map distances do not miss what lies beyond it
AROUND_M = 3.0  # of unknown floor beyond all that was seen a way may lead through
SOLID_M = 0.05  # nearer than this to what stands there a cell is that
FAR_M = 9.0  # distance to obstacles where none was seen


class Memory:
    """The plan.

    Args:
        cell_m: Edge of a cell; that of the fields that it is given.
        side_m: Edge of the square.
    """

    def __init__(self, cell_m: float, side_m: float = SIDE_M) -> None:
        n = round(side_m / cell_m)
        self._cell_m = cell_m
        self._distance_m = np.full((n, n), FAR_M, np.float32)
        self._known: Bits = np.zeros((n, n), np.bool_)
        self._walls: Bits = np.zeros((n, n), np.bool_)
        self._corner: NDArray[np.int64] | None = None  # odom, in whole cells
        self._low, self._high = np.full(2, n), np.zeros(2, np.int64)  # what was ever near

    def remember(
        self, near: Field2, place_m: Array, walls_m: Array | None = None, sure: Bits | None = None
    ) -> None:
        """Take in what is seen round the robot.

        Args:
            near: Distances round the robot, in cells of this plan.
            place_m: (2|3,) the robot, odom.
            walls_m: (k, 2) where something as high as a wall stands, odom.
            sure: (nx, ny) cells of `near` that were looked at long enough to believe that what stood there
                is gone; all that are known when it is left out. Floor is seen before what stands on it.
        """
        self._follow(np.asarray(place_m[:2], float))
        assert self._corner is not None
        if walls_m is not None:
            cells = np.floor(walls_m / self._cell_m).astype(np.int64) - self._corner
            cells = cells[((cells >= 0) & (cells < len(self._walls))).all(axis=1)]
            self._walls[cells[:, 0], cells[:, 1]] = True
        seam, n = round(SEAM_M / self._cell_m), len(self._known)
        shape = np.array(near.known.shape)
        seam = seam if (shape > 2 * seam).all() else 0
        first = np.round(near.origin_m / self._cell_m).astype(np.int64) - self._corner
        low, high = np.clip(first + seam, 0, n), np.clip(first + shape - seam, 0, n)
        if (high <= low).any():
            return
        here = np.s_[low[0] : high[0], low[1] : high[1]]
        there = np.s_[low[0] - first[0] : high[0] - first[0], low[1] - first[1] : high[1] - first[1]]
        fresh = near.known[there] | ~self._known[here]
        if sure is not None:
            stood = self._known[here] & (self._distance_m[here] <= SOLID_M)
            fresh &= ~stood | sure[there] | (near.distance_m[there] <= SOLID_M)
        self._distance_m[here] = np.where(fresh, near.distance_m[there], self._distance_m[here])
        self._known[here] |= near.known[there]
        self._low, self._high = np.minimum(self._low, low), np.maximum(self._high, high)

    def plan(self, goal_m: Array) -> tuple[Field2, Bits]:
        """All that is remembered and the way to a goal (2|3,), with unknown floor around.

        Returns:
            The plan, and its cells (nx, ny) of which only a wall higher up was seen: likely it goes on below.
        """
        assert self._corner is not None
        goal = np.floor(np.asarray(goal_m[:2], float) / self._cell_m).astype(np.int64) - self._corner
        around, n = round(AROUND_M / self._cell_m), len(self._known)
        low = np.clip(np.minimum(self._low, goal - around), 0, n - 1)
        high = np.clip(np.maximum(self._high, goal + around), low + 1, n)
        crop = np.s_[low[0] : high[0], low[1] : high[1]]
        origin = (self._corner + low) * self._cell_m
        field = Field2(self._distance_m[crop], self._known[crop], origin, self._cell_m)
        return field, self._walls[crop] & ~self._known[crop]

    def _follow(self, place_m: Array) -> None:
        n = len(self._known)
        middle = np.floor(place_m / self._cell_m).astype(np.int64) - n // 2
        if self._corner is None:
            self._corner = middle
        by = middle - self._corner
        if (np.abs(by) * self._cell_m <= 0.5 * n * self._cell_m - EDGE_M).all():
            return
        self._distance_m = moved(self._distance_m, by, FAR_M)
        self._known = moved(self._known, by, False)
        self._walls = moved(self._walls, by, False)
        self._low, self._high = np.clip(self._low - by, 0, n), np.clip(self._high - by, 0, n)
        self._corner = middle
