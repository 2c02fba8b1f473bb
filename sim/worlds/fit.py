"""Whether what a world file says fits its mesh: one sentence for whatever does not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from labr_autonomy.config import Body
from labr_autonomy.errors import BadInput
from labr_autonomy.types import Array
from sim.worlds.surface import Surface
from sim.worlds.world import World

THIN_M = 1.0  # a mesh narrower than this and higher than it is narrow lies on its side
SLACK_M = 0.05  # bounds may reach this far beyond the mesh in x and y
FLOOR_M = 0.15  # the floor lies at most this far from the height that the start names
LOOK_M = 0.3  # above the named height; from here the floor is looked for


def check_fit(world: World, spec: Mapping[str, Any]) -> None:
    """Check bounds, start and goals of a world file against the triangles.

    Args:
        world: Built from `spec`.
        spec: As `read_world_file` returns it.

    Raises:
        BadInput: for the first thing that does not fit.
    """
    _check_axis(world)
    _check_bounds(world)
    if "start" not in spec and "goals" not in spec:
        return
    body = Body()
    surface = Surface(world, body)
    if "start" in spec:
        _check_start(world, surface, body, spec["start"])
    for goal in spec.get("goals", ()):
        _check_goal(world, surface, goal)


def _check_axis(world: World) -> None:
    x, y, z = (float(v) for v in world.upper_m - world.lower_m)
    if min(x, y) < THIN_M < z:
        raise BadInput(
            f"the mesh of '{world.name}' is {z:.3g} m high and only {min(x, y):.2g} m wide",
            "Set `up` to the file's axis that points up, and `scale` to its metres per unit.",
        )


def _check_bounds(world: World) -> None:
    low, high = world.region_m
    beyond = (low[:2] < world.lower_m[:2] - SLACK_M) | (high[:2] > world.upper_m[:2] + SLACK_M)
    # Upwards there is only sky, but some of the mesh must be between the lowest and the highest place.
    if beyond.any() or low[2] > world.upper_m[2] or high[2] < world.lower_m[2]:
        raise BadInput(
            f"the bounds of '{world.name}' reach beyond its mesh, which spans {_span(world)}",
            "Correct `bounds`, or `scale` and `up` if that is not the size of the place.",
        )


def _check_start(world: World, surface: Surface, body: Body, start: Sequence[float]) -> None:
    x, y, _, z = start
    floor_m = surface.floor_below(x, y, z + LOOK_M)
    if abs(floor_m - z) > FLOOR_M:
        under = (
            f"the next one down is at z = {floor_m:.2f}" if np.isfinite(floor_m) else "there is none below"
        )
        raise BadInput(
            f"there is no floor under the start of '{world.name}' at ({x:g}, {y:g}, {z:g}): {under}",
            f"Put `start` on a floor, or correct `up` and `scale`: the mesh spans {_span(world)}.",
        )
    stands = np.array([x, y, floor_m + body.below_m])
    free_m = surface.free_place(stands, on_floor=True)
    if free_m <= 0.0:
        solid = surface.inside(stands)
        raise BadInput(
            f"the start of '{world.name}' at ({x:g}, {y:g}, {z:g}) "
            + ("is inside a solid" if solid else f"leaves no room for a robot {2 * body.radius_m:g} m wide"),
            "Move `start` to free floor.",
        )


def _check_goal(world: World, surface: Surface, goal: Sequence[float]) -> None:
    said = f"the goal ({', '.join(f'{v:g}' for v in goal)}) of '{world.name}'"
    if len(goal) == 2:
        if not np.isfinite(surface.floor_below(goal[0], goal[1], float(world.region_m[1, 2]))):
            raise BadInput(f"{said} has no floor under it", "Move it, or give z for a place in the air.")
        return
    if surface.free_place(np.asarray(goal, dtype=np.float64)) <= 0.0:
        raise BadInput(f"{said} is not free", "Move it, or leave z out for a place on the floor.")


def _span(world: World) -> str:
    def corner(place_m: Array) -> str:
        return "(" + ", ".join(f"{v:.4g}" for v in place_m) + ")"

    return f"{corner(world.lower_m)} to {corner(world.upper_m)} m"
