"""What is left to drive from every place of the map to one goal: one Dijkstra, many questions."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from labr_autonomy.perception.fields import Field2
from labr_autonomy.refine import search
from labr_autonomy.types import Array


class CostToGo:
    """Shortest ways to a goal on a 2D map.

    Costs are metres, weighted near obstacles and in unknown cells as in `search_land`.

    Args:
        field: The 2D map.
        goal_xy: (2,) odom; clamped into the map.
        radius_m: Least distance of a way to obstacles.
        reach_m: How far the goal may be moved to free space.
        unknown_cost: Factor on unknown cells.
    """

    def __init__(
        self, field: Field2, goal_xy: Array, radius_m: float, reach_m: float, unknown_cost: float = 2.0
    ) -> None:
        self._field = field
        distance = np.asarray(field.distance_m, dtype=float)
        self._free = distance > radius_m
        self._price = search.cell_cost(distance, field.known, radius_m, unknown_cost)
        inside = np.clip(goal_xy, field.origin_m + field.cell_m / 2, field.upper_m - field.cell_m / 2)
        self._goal = search.snap(field, self._free, inside, reach_m)
        self._cost: Array = np.full(self._free.size, np.inf)
        self._before = np.full(self._free.size, -1)
        if self._goal is None:
            return
        tails, heads, weights = search.free_edges(self._free, self._price)
        graph = csr_matrix((weights, (tails, heads)), shape=(self._free.size,) * 2)
        goal = int(np.ravel_multi_index(tuple(self._goal), self._free.shape))
        self._cost, self._before = dijkstra(graph, directed=False, indices=goal, return_predecessors=True)
        self._cost = self._cost * field.cell_m

    @property
    def target_xy(self) -> Array | None:
        """Where the ways end: the goal or the free cell nearest to it, (2,) odom; None if all is blocked."""
        if self._goal is None:
            return None
        place: Array = self._field.origin_m + (self._goal + 0.5) * self._field.cell_m
        return place

    def cost_m(self, place_xy: Array) -> float:
        """Weighted metres left from a place; inf without a way."""
        cell = search.snap(self._field, self._free, place_xy, search.START_SNAP_M)
        if cell is None:
            return float("inf")
        return float(self._cost[np.ravel_multi_index(tuple(cell), self._free.shape)])

    def path(self, start_xy: Array) -> Array | None:
        """Corners of the shortest way from a place, (k, 2) odom with the place first; None without a way."""
        cell = search.snap(self._field, self._free, start_xy, search.START_SNAP_M)
        if cell is None or self._goal is None:
            return None
        at = int(np.ravel_multi_index(tuple(cell), self._free.shape))
        if not np.isfinite(self._cost[at]):
            return None
        way = [at]
        while self._before[way[-1]] >= 0:
            way.append(int(self._before[way[-1]]))
        cells = np.stack(np.unravel_index(way, self._free.shape), axis=1)
        cells = search.straightened(cells, self._free, self._price)
        places: Array = self._field.origin_m + (cells + 0.5) * self._field.cell_m
        if len(places) == 1:
            return np.stack([np.asarray(start_xy, dtype=float), places[0]])
        places[0] = start_xy
        return places
