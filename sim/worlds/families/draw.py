"""From a family's name and a seed to a world."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module

import numpy as np

from labr_autonomy.errors import BadInput
from labr_autonomy.types import Array
from sim.worlds.families.layout import Layout, Rng
from sim.worlds.world import World, make_world

Size = tuple[float, float]
Family = Callable[[Rng, Size, float], Layout]  # random numbers, extents in x and y [m], difficulty 0..1

SIZES: dict[str, Size] = {
    "indoor": (24.0, 16.0),
    "rooms": (16.0, 12.0),
    "garage": (30.0, 24.0),
    "forest": (30.0, 30.0),
}
DIFFICULTY = 0.5  # where nothing else is asked for


def family_of(name: str) -> Family:
    """The family of a name.

    Raises:
        BadInput: when there is none of that name.
    """
    if name not in SIZES:
        raise BadInput(f"there is no world family '{name}'", f"Take one of {', '.join(SIZES)} or hall.")
    family: Family = import_module(f"sim.worlds.families.{name}").draw
    return family


def draw_world(name: str, seed: int, size_m: Size, difficulty: float, clear_m: Array) -> World:
    """Triangles of one generated world.

    Args:
        name: One of `SIZES`.
        seed: Same seed, same world.
        size_m: Extents of the region in x and y [m], centred on the origin.
        difficulty: 0 easy, 1 hard.
        clear_m: (k, 3) places in odom that furnishings keep free.
    """
    rng = np.random.default_rng([seed, *name.encode()])
    layout = family_of(name)(rng, size_m, difficulty)
    mesh = layout.mesh(np.asarray(clear_m, dtype=np.float64).reshape(-1, 3))
    spec = {"family": name, "seed": seed, "size_m": list(size_m), "difficulty": difficulty}
    return make_world(f"{name}-{seed}", mesh.vertices_m, mesh.faces, spec, region_m=layout.region_m)
