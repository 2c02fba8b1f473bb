"""What a family of worlds returns, and how its furnishings make way for places that a mission keeps free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from labr_autonomy.types import Array
from sim.worlds.meshes import Mesh, merged

CLEAR_M = 0.9  # free radius about each place that is kept clear
OVERHEAD_M = 2.6  # higher than this above the place nothing is in its way

Rng = np.random.Generator


@dataclass(frozen=True, slots=True)
class Layout:
    """One drawn world before it is put together. Frame: odom, centred on the origin."""

    structure: list[Mesh]  # floors, walls, ceilings, terrain, pillars, ramps: always there
    furnishings: list[Mesh]  # each a whole thing (a table with its legs, a car, a tree)
    region_m: Array  # (2, 3) lower and upper corner of where a robot can be asked to go

    def mesh(self, clear_m: Array) -> Mesh:
        """Everything as one mesh, without the furnishings that stand within `CLEAR_M` of places (k, 3)."""
        return merged([*self.structure, *(f for f in self.furnishings if not _in_the_way(f, clear_m))])


def _in_the_way(thing: Mesh, places_m: Array) -> bool:
    """Whether the bounds of a thing come within `CLEAR_M` of a place, at a height that matters."""
    low, high = thing.vertices_m.min(axis=0), thing.vertices_m.max(axis=0)
    for place in places_m:
        gap = np.maximum(np.maximum(low[:2] - place[:2], place[:2] - high[:2]), 0.0)
        if float(np.hypot(*gap)) < CLEAR_M and low[2] < place[2] + OVERHEAD_M and high[2] > place[2] - 0.5:
            return True
    return False
