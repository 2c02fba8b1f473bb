"""The movers of a flight: drawn across the way from its start to its goals."""

from __future__ import annotations

from collections.abc import Sequence

from labr_autonomy.config import RobotConfig
from sim.movers.draw import draw_movers
from sim.movers.mover import Mover
from sim.movers.way import likely_way
from sim.worlds.free_space import FreeSpace
from sim.worlds.surface import Surface
from sim.worlds.world import World


def movers_for(
    count: int,
    seed: int,
    places_m: Sequence[tuple[float, float, float]],
    world: World,
    surface: Surface,
    robot: RobotConfig,
    *,
    free: FreeSpace | None = None,
) -> tuple[Mover, ...]:
    """At most `count` movers, on tracks that a mover has to itself; fewer where the way leaves no room.

    Args:
        count: How many are wanted; with none nothing is computed.
        seed: Of the flight.
        places_m: Body origins of start and goals in turn, odom [m].
        world: Where.
        surface: Its surface.
        robot: The robot.
        free: Where the robot can be, if that is known already.
    """
    if count <= 0:
        return ()
    known = free or FreeSpace(world, surface, robot)
    way = likely_way(known.land, places_m, robot.body.below_m)
    return draw_movers(count, seed, way, places_m, surface, robot.body)
