"""Beside a way: where there is room, on the floor as it is or in the air. Frame: odom; metres."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.config import RobotConfig
from labr_autonomy.types import Array
from sim.bench.known import Known
from sim.worlds.free_layers import AIR_MARGIN_M

STANDING_CLEAR_M = 0.03  # of the outline
FLOOR_GIVE_M = 0.6  # floors between a route's corners are this near to the straight line

Flags = NDArray[np.bool_]
Numbers = NDArray[np.int64]


class Footing:
    """Moves points (n, 3) of a way by offsets (n, 3) where the robot fits there, and leaves them elsewhere.

    Args:
        known: The world.
        robot: Its outline counts.
    """

    def __init__(self, known: Known, robot: RobotConfig) -> None:
        body = robot.body
        self._known, self._below_m = known, body.below_m
        self._sphere_m = math.hypot(body.radius_m, max(body.below_m, body.above_m)) + AIR_MARGIN_M

    def on_floor(self, points: Array, offset: Array) -> tuple[Array, Array, Numbers]:
        """Body origins on the floor, its heights (n,), and reach (n,), -1 where the robot cannot stand."""
        shifted, good = self._brought_down(points + offset)
        plain, fine = self._brought_down(points)
        out = np.where(good[:, None], shifted, plain)
        places = self._places(out)
        stands = (good | fine) & (places >= 0)
        reach = np.where(stands, self._known.free.land.reach[places], -1).astype(np.int64)
        return out, out[:, 2] - self._below_m, reach

    def _brought_down(self, points: Array) -> tuple[Array, Flags]:
        """Points (n, 3) brought down to the floor, and whether the outline is free there, (n,)."""
        surface, below = self._known.surface, self._below_m
        out = points.copy()
        places = self._places(points)
        found = places >= 0
        look_from = self._known.free.land.floor_z_m[places] + 0.5 * below
        out[:, 2] = surface.floors_below(points[:, :2], np.where(found, look_from, points[:, 2])) + below
        found &= np.abs(out[:, 2] - look_from) < 2.0 * below  # a floor is there, not a hole
        slopes = np.zeros((len(out), 2))
        for k in np.flatnonzero(found):
            slopes[k] = surface.floor_slope(*(float(v) for v in out[k]))
        found[found] = surface.clear(out[found], STANDING_CLEAR_M, on_floor=True, slopes=slopes[found])
        return out, found

    def _places(self, points: Array) -> Numbers:
        """Numbers of the standing places below points (n, 3), (n,) int; -1 where there is none."""
        land, below = self._known.free.land, self._below_m
        near = [land.nearest(p[:2], float(p[2]) - below, land.cell_m, FLOOR_GIVE_M) for p in points]
        return np.array([-1 if place is None else place for place in near], np.int64)

    def in_air(self, points: Array, offset: Array) -> tuple[Array, Array, Numbers]:
        """Body origins, the heights (n,) of the floors below, and reach (n,), -1 where it cannot fly."""
        air, surface = self._known.free.air, self._known.surface
        shifted = points + offset
        out = np.where(surface.away(shifted, self._sphere_m)[:, None], shifted, points)
        at = np.floor((out - air.origin_m) / air.cell_m).astype(int)
        at = np.clip(at, 0, np.array(air.free.shape) - 1)
        floors = air.floor_z_m[tuple(at.T)].astype(np.float64)
        free = air.free[tuple(at.T)] & np.isfinite(floors) & surface.away(out, self._sphere_m)
        return out, floors, np.where(free, air.reach[tuple(at.T)], -1).astype(np.int64)
