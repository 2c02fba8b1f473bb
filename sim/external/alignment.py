"""How the autopilot's own world lies in ours: a turn about the vertical and a shift. Pure, ENU."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim.autopilot.vectors import ZERO, Vector, turn, wrap


@dataclass(frozen=True, slots=True)
class Alignment:
    """`ours = turn(theirs, yaw) + shift`."""

    yaw_rad: float = 0.0
    shift_m: Vector = ZERO

    @staticmethod
    def of(ours_m: Vector, ours_yaw_rad: float, theirs_m: Vector, theirs_yaw_rad: float) -> Alignment:
        """The one under which their pose is ours."""
        yaw = wrap(ours_yaw_rad - theirs_yaw_rad)
        turned = turn(theirs_m, yaw)
        return Alignment(yaw, (ours_m[0] - turned[0], ours_m[1] - turned[1], ours_m[2] - turned[2]))

    def ours(self, theirs_m: Vector) -> Vector:
        """A place of theirs in our world (3,) [m]."""
        x, y, z = turn(theirs_m, self.yaw_rad)
        return x + self.shift_m[0], y + self.shift_m[1], z + self.shift_m[2]

    def theirs(self, ours_m: Vector) -> Vector:
        """A place of ours in their world (3,) [m]."""
        s = self.shift_m
        return turn((ours_m[0] - s[0], ours_m[1] - s[1], ours_m[2] - s[2]), -self.yaw_rad)

    def ours_vector(self, theirs: Vector) -> Vector:
        """A direction of theirs in our world."""
        return turn(theirs, self.yaw_rad)

    def theirs_vector(self, ours: Vector) -> Vector:
        """A direction of ours in their world."""
        return turn(ours, -self.yaw_rad)

    @property
    def half_turn(self) -> tuple[float, float]:
        """Cosine and sine of half the turn, for quaternions."""
        return math.cos(0.5 * self.yaw_rad), math.sin(0.5 * self.yaw_rad)
