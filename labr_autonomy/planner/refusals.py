"""Places where it was to take off or to come down and could not: the next best ones are taken. Pure."""

from __future__ import annotations

import numpy as np

from labr_autonomy.perception.fields import Bits
from labr_autonomy.types import Array

WAITS_S = 2.0  # so long it may be where it is to change the mode without having the room for it


class Refusals:
    """What was refused on the way to one goal.

    Args:
        radius_m: So much around a place that was refused is refused with it.
    """

    def __init__(self, radius_m: float) -> None:
        self._radius_m = radius_m
        self._places: list[Array] = []
        self._since_s: float | None = None

    def reset(self) -> None:
        """Another goal."""
        self._places, self._since_s = [], None

    def __len__(self) -> int:
        return len(self._places)

    def step(self, waits: bool, place_m: Array | None, now_s: float) -> None:
        """One cycle.

        Args:
            waits: Whether it is where it is to change the mode, and may not.
            place_m: (2,) that place, odom.
            now_s: The present.
        """
        if not waits or place_m is None:
            self._since_s = None
        elif self._since_s is None:
            self._since_s = now_s
        elif now_s - self._since_s > WAITS_S:
            self._places, self._since_s = [*self._places, np.array(place_m[:2], float)], None

    def among(self, places_m: Array) -> Bits:
        """Which of some places (n, 2) are refused."""
        out: Bits = np.zeros(len(places_m), np.bool_)
        for place in self._places:
            out |= np.hypot(*(places_m - place).T) <= self._radius_m
        return out
