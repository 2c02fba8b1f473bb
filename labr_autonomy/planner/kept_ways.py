"""The map's shortest ways, kept from cycle to cycle: they change slowly and cost a good part of one."""

from __future__ import annotations

import math
from collections.abc import Callable

from labr_autonomy.refine.search import CostToGo

SEARCH_EVERY_S = 0.4


class KeptWays:
    """Ways to one goal, searched anew every `SEARCH_EVERY_S` and whenever something else is asked."""

    def __init__(self) -> None:
        self._ways: CostToGo | None = None
        self._asked: tuple[float, ...] = ()
        self._searched_s = -math.inf

    def of(self, asked: tuple[float, ...], now_s: float, search: Callable[[], CostToGo]) -> CostToGo:
        """The ways.

        Args:
            asked: What they depend on besides the map: the goal, and the layer in which they run.
            now_s: The present, on the clock of the requests.
            search: Makes them.
        """
        if self._ways is None or asked != self._asked or now_s - self._searched_s >= SEARCH_EVERY_S:
            self._ways, self._asked, self._searched_s = search(), asked, now_s
        return self._ways
