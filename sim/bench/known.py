"""A world with everything that the bench knows about it, made once for the trials that share it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.config import RobotConfig
from labr_autonomy.types import Array
from sim.bench.route import Router
from sim.worlds.free_space import FreeSpace
from sim.worlds.made import made_world
from sim.worlds.surface import Surface
from sim.worlds.world import World


@dataclass(frozen=True, slots=True)
class Known:
    """A world, where a robot can be in it, and its ways."""

    world: World
    surface: Surface
    free: FreeSpace
    router: Router
    places_m: Array  # (n, 3) body origin at every place of `free.land`
    cells_m: Array  # (m, 3) middle of every free cell of `free.air`
    cells_height_m: Array  # (m,) above the ground below
    cells_reach: NDArray[np.int32]  # (m,)


def know(spec: Mapping[str, Any], robot: RobotConfig) -> Known:
    """Everything about the world of a spec (`World.spec`), from memory if it was asked for just before."""
    return _know(json.dumps(dict(spec), sort_keys=True), robot)


@lru_cache(maxsize=2)  # a trial's task and its oracle ask for the same one
def _know(spec_json: str, robot: RobotConfig) -> Known:
    world, surface = made_world(json.loads(spec_json), robot.body)
    free = FreeSpace(world, surface, robot)
    land, air = free.land, free.air
    places = np.column_stack([land.xy_m, land.floor_z_m + robot.body.below_m])
    index = np.argwhere(air.free)
    cells = air.centres_m(index)
    at = tuple(index.T)
    height = cells[:, 2] - air.floor_z_m[at]
    return Known(world, surface, free, Router(free), places, cells, height, air.reach[at])
