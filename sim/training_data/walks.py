"""Where pictures are taken: walks along routes from one random place to another, driven or flown.

A walk begins as a mission does, looking anywhere. The robot turns on the spot where the way bends, now and
then looks round, and keeps beside the way as far as there is room. Frame: odom; metres, radians.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import quaternion_from_rpy, wrap_pi
from labr_autonomy.types import Array, Mode, Pose
from sim.bench.known import Known
from sim.bench.route import Leg, Router
from sim.training_data.footing import Footing, Numbers

STRAIGHT_M = (4.0, 12.0)  # from the start to the end of a walk
PICTURE_M = (0.12, 0.2)  # between two pictures: what the map of a flight gets at 5 Hz
VIEW_EVERY = (4, 6)  # pictures; so views are about 0.8 m apart
HEIGHT_M = (0.5, 2.5)  # of a flight's ends above the floor
AHEAD_M = 0.4  # the robot looks towards this point of its way
TURN_RAD = 0.4  # more than this between two pictures is turned on the spot
LOOK_ROUND = 0.02  # of all pictures
BESIDE_M, BESIDE_STEP_M = 0.25, 0.06  # from the way
YAW_SIGMA_RAD = 0.12
TILT_RAD = {Mode.LAND: math.radians(3.0), Mode.AIR: math.radians(12.0)}
DRAWS = 20


@dataclass(frozen=True, slots=True)
class Stop:
    """One picture."""

    pose: Pose
    rpy_rad: tuple[float, float, float]
    floor_z_m: float  # of the floor below
    mode: Mode
    reach: int  # as in `free_layers.LandLayer`
    view: bool  # also a view of the data set


class Walker:
    """Walks through one world.

    Args:
        known: The world.
        robot: The robot.
        rng: Where chance comes from.
    """

    def __init__(self, known: Known, robot: RobotConfig, rng: np.random.Generator) -> None:
        self._known, self._rng = known, rng
        self._footing = Footing(known, robot)
        # driving costs so much that a flight only ends where it is to end
        self._flyer = Router(known.free, replace(known.router.energy, land_w=1e6, transition_s=600.0))
        high = known.cells_height_m
        self._hovers = np.flatnonzero((high >= HEIGHT_M[0]) & (high <= HEIGHT_M[1]))

    def walk(self, flying: bool) -> list[Stop]:
        """The pictures of one walk, in order; none when the dice find no way.

        Args:
            flying: Begin and end in the air, where the world has room for that; else on land.
        """
        flying = flying and len(self._hovers) > 1
        ends = self._ends(flying)
        if ends is None:
            return []
        router = self._flyer if flying else self._known.router
        route = router.route(*ends, start_in_air=flying, goal_in_air=flying)
        if route is None:
            return []
        until_view, stops = 0, []
        for stop in self._stops(route.legs):
            stops.append(replace(stop, view=until_view == 0))
            if until_view == 0:
                until_view = int(self._rng.integers(VIEW_EVERY[0], VIEW_EVERY[1] + 1))
            until_view -= 1
        return stops

    def _ends(self, flying: bool) -> tuple[Array, Array] | None:
        """Two body origins that are joined, as far apart as wished or as the world allows."""
        known, land = self._known, self._known.free.land
        if flying:
            spots, group = known.cells_m[self._hovers], known.cells_reach[self._hovers]
        else:
            on_floor = np.flatnonzero(land.ground)
            spots, group = known.places_m[on_floor], land.island[on_floor]
        for _ in range(DRAWS):
            first = int(self._rng.integers(len(spots)))
            away = np.linalg.norm(spots - spots[first], axis=1)
            there = np.flatnonzero(
                (group == group[first]) & (away >= STRAIGHT_M[0]) & (away <= STRAIGHT_M[1])
            )
            if len(there):
                return spots[first], spots[int(self._rng.choice(there))]
        nearer = np.flatnonzero((group == group[first]) & (away > 1.0) & (away < STRAIGHT_M[0]))
        return (spots[first], spots[int(self._rng.choice(nearer))]) if len(nearer) else None

    def _stops(self, legs: tuple[Leg, ...]) -> Iterator[Stop]:
        yaw = float(self._rng.uniform(-math.pi, math.pi))
        for leg in legs:
            points, ahead = self._along(leg.points_m)
            points, floors, reach = self._settled(points, ahead, leg.mode)
            for k in np.flatnonzero(reach >= 0):
                wanted = ahead[k] + YAW_SIGMA_RAD * float(self._rng.standard_normal())
                if self._rng.random() < LOOK_ROUND:
                    wanted += float(self._rng.choice([-1.0, 1.0])) * float(self._rng.uniform(1.0, 2.5))
                turns = math.ceil(abs(wrap_pi(wanted - yaw)) / TURN_RAD)
                step = wrap_pi(wanted - yaw) / max(turns, 1)
                for _ in range(max(turns, 1)):
                    yaw = wrap_pi(yaw + step)
                    yield self._stop(points[k], yaw, float(floors[k]), leg.mode, int(reach[k]))

    def _along(self, corners_m: Array) -> tuple[Array, Array]:
        """Points (n, 3) along a polyline, and the heading (n,) towards the way ahead."""
        keep = np.append(True, np.linalg.norm(np.diff(corners_m, axis=0), axis=1) > 1e-6)
        corners = corners_m[keep]
        s = np.concatenate([[0.0], np.cumsum([np.linalg.norm(b - a) for a, b in pairwise(corners)])])
        count = math.ceil(s[-1] / PICTURE_M[0]) + 1
        at = np.cumsum(self._rng.uniform(*PICTURE_M, count)) - PICTURE_M[0]
        at = np.append(0.0, at[(at > 0.0) & (at < s[-1])])

        def along(t: Array) -> Array:
            return np.column_stack([np.interp(t, s, corners[:, axis]) for axis in range(3)])

        points, further = along(at), along(np.minimum(at + AHEAD_M, s[-1]))
        way = further - points
        still = np.hypot(way[:, 0], way[:, 1]) < 0.05  # straight up, or at the end
        heading = np.arctan2(way[:, 1], way[:, 0])
        for k in np.flatnonzero(still):
            heading[k] = heading[k - 1] if k else float(self._rng.uniform(-math.pi, math.pi))
        return points, heading

    def _settled(self, points: Array, heading: Array, mode: Mode) -> tuple[Array, Array, Numbers]:
        """Beside the way where there is room, on the floor; floors (n,), and reach (n,), -1 for nowhere."""
        beside = np.zeros((len(points), 3))
        shift = np.zeros(3)
        for k in range(len(points)):
            shift = np.clip(0.9 * shift + BESIDE_STEP_M * self._rng.standard_normal(3), -BESIDE_M, BESIDE_M)
            beside[k] = shift
        left = np.column_stack([-np.sin(heading), np.cos(heading), np.zeros(len(heading))])
        offset = left * beside[:, :1]
        if mode is Mode.AIR:
            offset[:, 2] = beside[:, 1]
            return self._footing.in_air(points, offset)
        return self._footing.on_floor(points, offset)

    def _stop(self, point: Array, yaw: float, floor_z_m: float, mode: Mode, reach: int) -> Stop:
        most = TILT_RAD[mode]
        roll, pitch = np.clip(0.4 * most * self._rng.standard_normal(2), -most, most)
        if mode is Mode.LAND:  # it lies as the floor does
            east, north = self._known.surface.floor_slope(*(float(v) for v in point))
            c, s = math.cos(yaw), math.sin(yaw)
            roll += math.atan(-s * east + c * north)
            pitch -= math.atan(c * east + s * north)
        rpy = (float(roll), float(pitch), yaw)
        return Stop(Pose(point, quaternion_from_rpy(*rpy)), rpy, floor_z_m, mode, reach, view=False)
