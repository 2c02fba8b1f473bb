"""Floor plans: rectangles that tile a floor, the borders between them, and which borders get a door.

A plan is a list of spaces without gaps or overlaps; walls stand on the borders (`walls.py`). Frame: odom.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from labr_autonomy.errors import BadInput
from sim.worlds.families.layout import Rng

OUTSIDE = -1  # in the place of a neighbour, at the edge of the floor
_SAME_M = 1e-6


class Rect(NamedTuple):
    """An upright rectangle on the floor [m]."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def size(self) -> tuple[float, float]:
        """Extents in x and y [m]."""
        return self.x1 - self.x0, self.y1 - self.y0

    @property
    def area(self) -> float:
        """[m^2]."""
        return (self.x1 - self.x0) * (self.y1 - self.y0)

    @property
    def centre(self) -> tuple[float, float]:
        """[m]."""
        return 0.5 * (self.x0 + self.x1), 0.5 * (self.y0 + self.y1)

    def shrunk(self, by_m: float) -> Rect:
        """Smaller by this on every side."""
        return Rect(self.x0 + by_m, self.y0 + by_m, self.x1 - by_m, self.y1 - by_m)

    def cut(self, axis: int, at_m: Sequence[float]) -> list[Rect]:
        """Slices between lines across an axis (0: x, 1: y), in rising order."""
        edges = [self[axis], *at_m, self[axis + 2]]
        pairs = itertools.pairwise(edges)
        if axis == 0:
            return [Rect(low, self.y0, high, self.y1) for low, high in pairs]
        return [Rect(self.x0, low, self.x1, high) for low, high in pairs]


class Space(NamedTuple):
    """One room or piece of corridor; its rectangle ends in the middle of its walls."""

    rect: Rect
    kind: str


class Border(NamedTuple):
    """A straight piece of line between two spaces, or between a space and the outside."""

    first: int  # index of a space
    second: int  # index of another, or OUTSIDE
    along: int  # 0: runs along x, 1: along y
    at_m: float  # the other coordinate
    low_m: float
    high_m: float

    @property
    def length_m(self) -> float:
        """[m]."""
        return self.high_m - self.low_m


def floor_of(size_m: tuple[float, float], least_m: float) -> Rect:
    """The whole floor, centred on the origin.

    Raises:
        BadInput: when it is too small for a plan.
    """
    if not all(math.isfinite(side) and side >= least_m for side in size_m):
        raise BadInput(
            f"a floor of {size_m[0]:g} x {size_m[1]:g} m is too small for this family",
            f"Give at least {least_m:g} m in x and y.",
        )
    return Rect(-0.5 * size_m[0], -0.5 * size_m[1], 0.5 * size_m[0], 0.5 * size_m[1])


def borders_of(rects: Sequence[Rect]) -> list[Border]:
    """All borders of a plan, those to the outside last."""
    whole = Rect(*(f(r[k] for r in rects) for k, f in enumerate((min, min, max, max))))
    inner, outer = [], []
    for i, one in enumerate(rects):
        for j, other in enumerate(rects):
            for axis in (0, 1):  # across the border
                if i == j or abs(one[axis + 2] - other[axis]) > _SAME_M:
                    continue
                low, high = max(one[1 - axis], other[1 - axis]), min(one[3 - axis], other[3 - axis])
                if high - low > _SAME_M:
                    inner.append(Border(i, j, 1 - axis, one[axis + 2], low, high))
        for k in range(4):
            if abs(one[k] - whole[k]) < _SAME_M:
                across = k % 2
                outer.append(Border(i, OUTSIDE, 1 - across, one[k], one[1 - across], one[3 - across]))
    return inner + outer


def weighted_cuts(rng: Rng, low_m: float, high_m: float, count: int, spread: float) -> list[float]:
    """Lines that cut a length into `count` pieces of uneven share, 1 +- spread before scaling."""
    share = rng.uniform(1.0 - spread, 1.0 + spread, count)
    return list(low_m + (high_m - low_m) * np.cumsum(share)[:-1] / share.sum())


def spanning_doors(
    rng: Rng,
    borders: Sequence[Border],
    reached: set[int],
    weight: Callable[[int, int], float],
    least_m: float,
) -> list[Border]:
    """Borders that get a door, so that each space is reached once from those already reached.

    Args:
        rng: Random numbers.
        borders: Borders of the plan.
        reached: Indices of the spaces to start from.
        weight: Of a door from a reached space (first) into a new one (second); 0 for never.
        least_m: A border shorter than this takes no door.
    """
    reached = set(reached)
    usable = [b for b in borders if b.second != OUTSIDE and b.length_m >= least_m]
    doors: list[Border] = []
    while True:
        open_ones = [b for b in usable if (b.first in reached) != (b.second in reached)]
        odds = np.array(
            [weight(*((b.first, b.second) if b.first in reached else (b.second, b.first))) for b in open_ones]
        )
        if odds.sum() <= 0.0:
            return doors
        chosen = open_ones[int(rng.choice(len(open_ones), p=odds / odds.sum()))]
        doors.append(chosen)
        reached |= {chosen.first, chosen.second}
