"""The floor under the wheels as a plane: four wheels look down, a stiff suspension follows what they find.

Planes are z at the body's x, y [m] and the rise per metre east and north, odom.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from labr_autonomy.config import Body
from labr_autonomy.types import Array
from sim.worlds.surface import FLOOR_BAND_M, Surface

FALL_M = 0.08  # floor that lies lower than this below the plane carries nothing
AXLE_M = 0.10  # wheels before and behind the origin, as the contacts of labr_quad.xml
# Tyres and suspension settle critically damped at this rate; a wheel of 6 cm radius takes about 0.1 s at
# table speed to climb the FLOOR_BAND_M.
SETTLING_RPS = 25.0
_SNAP_M = 1e-6
_SAME_M = 2e-5  # the rays' float32
_EVEN = 2e-4  # slopes that such an error makes


@dataclass(frozen=True, slots=True)
class Plane:
    """A tilted plane near the robot."""

    z_m: float
    east: float = 0.0
    north: float = 0.0

    @property
    def slope(self) -> tuple[float, float]:
        """Rise per metre east and north."""
        return self.east, self.north

    @property
    def rise(self) -> float:
        """Steepest rise per metre, the tangent of its angle."""
        return math.hypot(self.east, self.north)

    @property
    def steep(self) -> float:
        """Length of a vertical line per length along the normal, the inverse cosine of its angle."""
        return math.sqrt(1.0 + self.east * self.east + self.north * self.north)

    def moved(self, dx_m: float, dy_m: float) -> Plane:
        """The same plane, seen from another place."""
        if self.east == 0.0 and self.north == 0.0:
            return self
        return Plane(self.z_m + self.east * dx_m + self.north * dy_m, self.east, self.north)

    def roll_pitch(self, yaw_rad: float) -> tuple[float, float]:
        """Roll and pitch [rad] of a body that stands on it (z-y-x, FLU)."""
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        ahead, left = self.east * c + self.north * s, self.north * c - self.east * s
        return math.asin(left / self.steep), -math.atan(ahead)


class Footing:
    """Finds the plane that the wheels stand on.

    Args:
        surface: The world's triangles.
        body: Track of the wheels.
    """

    def __init__(self, surface: Surface, body: Body) -> None:
        self._surface = surface
        side = 0.5 * body.track_m
        # Front left, front right, rear left, rear right, middle; body x and y.
        self._under = np.array(
            [[AXLE_M, side], [AXLE_M, -side], [-AXLE_M, side], [-AXLE_M, -side], [0.0, 0.0]]
        )
        self._side_m = side

    def find(self, x_m: float, y_m: float, yaw_rad: float, z_m: float) -> Plane:
        """The plane below a place, without knowing one before.

        Args:
            x_m: Body origin, odom.
            y_m: Body origin, odom.
            yaw_rad: Heading.
            z_m: Height from which to look down.
        """
        middle = self._surface.floor_below(x_m, y_m, z_m)
        plane = Plane(middle if math.isfinite(middle) else 0.0)
        steepest = AXLE_M + self._side_m  # of a slope of 45 degrees at the outermost wheel
        found, _ = self._fitted(plane, x_m, y_m, yaw_rad, steepest, steepest)
        return found

    def follow(self, plane: Plane, x_m: float, y_m: float, yaw_rad: float) -> tuple[Plane, bool]:
        """The plane after a short way, and whether the floor under the middle has gone."""
        return self._fitted(plane, x_m, y_m, yaw_rad, FLOOR_BAND_M, FALL_M)

    def _fitted(
        self, plane: Plane, x_m: float, y_m: float, yaw_rad: float, above_m: float, below_m: float
    ) -> tuple[Plane, bool]:
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        offsets = self._under @ np.array([[c, s], [-s, c]])
        expected = plane.z_m + offsets @ np.array(plane.slope)
        seen = self._surface.floors_below(offsets + np.array([x_m, y_m]), expected + above_m)
        # A wheel over the void hangs where the plane holds it.
        wheels: Array = np.where(seen >= expected - below_m, seen, expected)
        fl, fr, rl, rr, _ = wheels.tolist()
        ahead = 0.25 * (fl + fr - rl - rr) / AXLE_M
        left = 0.25 * (fl + rl - fr - rr) / self._side_m
        if abs(ahead) < _EVEN and abs(left) < _EVEN:
            ahead = left = 0.0
        fitted = Plane(0.25 * (fl + fr + rl + rr), ahead * c - left * s, ahead * s + left * c)
        return fitted, bool(seen[4] < plane.z_m - below_m)


def _same(a: Plane, b: Plane) -> bool:
    even = abs(a.east - b.east) < _EVEN and abs(a.north - b.north) < _EVEN
    return even and abs(a.z_m - b.z_m) < _SAME_M


class Suspension:
    """The plane that the body rests on: it settles onto the wheels' plane and moves along it without lag."""

    def __init__(self, plane: Plane) -> None:
        self.plane = plane
        self._target = plane
        self._rates = (0.0, 0.0, 0.0)
        self.settled = True

    def aim(self, target: Plane) -> None:
        """Take a new plane of the wheels, at the present place."""
        if self.settled and _same(target, self.plane):
            return  # float32 of the rays; a body at rest stays at rest
        self._target, self.settled = target, False

    @property
    def target(self) -> Plane:
        """The wheels' plane at the present place."""
        return self._target

    def step(self, dt_s: float, dx_m: float, dy_m: float) -> Plane:
        """Move by (dx, dy) [m] and settle for `dt_s` [s]."""
        self._target = self._target.moved(dx_m, dy_m)
        now = self.plane.moved(dx_m, dy_m)
        if self.settled:
            self.plane = self._target
            return self.plane
        goal = (self._target.z_m, self._target.east, self._target.north)
        values, rates, left = [], [], 0.0
        for value, rate, aim in zip((now.z_m, now.east, now.north), self._rates, goal, strict=True):
            gap = aim - value
            faster = rate + dt_s * (SETTLING_RPS * SETTLING_RPS * gap - 2.0 * SETTLING_RPS * rate)
            values.append(value + dt_s * faster)
            rates.append(faster)
            left = max(left, abs(gap), abs(faster) / SETTLING_RPS)
        if left < _SNAP_M:
            self.plane, self._rates, self.settled = self._target, (0.0, 0.0, 0.0), True
        else:
            self.plane, self._rates = Plane(*values), (rates[0], rates[1], rates[2])
        return self.plane
