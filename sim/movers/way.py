"""The way that a robot is likely to take over the floor, for movers to cross. Frame: odom; metres."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from labr_autonomy.types import Array
from sim.worlds.free_layers import LandLayer

START_M = 0.5  # the robot stands this near to where it is said to start


def likely_way(land: LandLayer, places_m: Sequence[tuple[float, float, float]], below_m: float) -> Array:
    """Points on the floor along the shortest drive from place to place, about 0.1 m apart, (n, 3) odom.

    A goal that cannot be driven to (in the air, or on another floor) is driven up to the place nearest to
    it. The way is empty where the robot cannot stand at its start.

    Args:
        land: Where a robot can stand.
        places_m: Body origins of the start and of each goal in turn, odom.
        below_m: From the body origin to the floor of a standing robot.
    """
    start = np.array(places_m[0])
    first = land.nearest(start[:2], float(start[2]) - below_m, START_M)
    if first is None:
        return np.zeros((0, 3))
    xyz = np.column_stack([land.xy_m, land.floor_z_m])
    island = np.flatnonzero(land.island == land.island[first])
    numbers = [first]
    for place in places_m[1:]:
        aside = np.linalg.norm(xyz[island, :2] - place[:2], axis=1)
        numbers.append(int(island[aside.argmin()]))
    legs = [_drive(land, xyz, a, b) for a, b in itertools.pairwise(numbers)]
    return np.concatenate(legs) if legs else np.zeros((0, 3))


def _drive(land: LandLayer, xyz_m: Array, first: int, last: int) -> Array:
    """The shortest way over neighbouring places."""
    here, turn = np.nonzero(land.beside >= 0)
    there = land.beside[here, turn]
    length = np.linalg.norm(xyz_m[there] - xyz_m[here], axis=1)
    graph = csr_matrix((length, (here, there)), shape=(len(xyz_m), len(xyz_m)))
    _, before = dijkstra(graph, indices=first, return_predecessors=True)
    chain = [last]
    while chain[-1] != first:
        previous = int(before[chain[-1]])
        if previous < 0:  # neighbours that can be driven in one direction only
            return np.zeros((0, 3))
        chain.append(previous)
    way: Array = xyz_m[chain[::-1]]
    return way
