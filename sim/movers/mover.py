"""One mover: its shape, its track, and how far the robot is from it. Frame: odom; metres, seconds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

from labr_autonomy.config import Body

Kind = Literal["person", "box"]


@dataclass(frozen=True, slots=True)
class Shape:
    """An upright solid that stands on the floor: a cylinder for a person, or a box along its heading."""

    kind: Kind
    half_m: tuple[float, float]  # half extents along and across its heading; a person's radius twice
    height_m: float

    @property
    def radius_m(self) -> float:
        """Of the upright cylinder about it."""
        return self.half_m[0] if self.kind == "person" else math.hypot(*self.half_m)


@dataclass(frozen=True, slots=True)
class Placed:
    """A shape at a place: what a camera sees of a mover, and what can be touched."""

    shape: Shape
    x_m: float
    y_m: float
    floor_z_m: float
    yaw_rad: float

    def clearance_m(self, x_m: float, y_m: float, z_m: float, body: Body) -> float:
        """Exact distance to the robot's upright cylinder about a body origin [m]; <= 0 is contact.

        Where they meet it is minus the least way that parts them, sideways or upwards.
        """
        dx, dy = x_m - self.x_m, y_m - self.y_m
        if self.shape.kind == "person":
            aside = math.hypot(dx, dy) - self.shape.half_m[0]
        else:
            c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
            qx = abs(c * dx + s * dy) - self.shape.half_m[0]
            qy = abs(c * dy - s * dx) - self.shape.half_m[1]
            aside = math.hypot(max(qx, 0.0), max(qy, 0.0)) + min(max(qx, qy), 0.0)
        aside -= body.radius_m
        above = z_m - body.below_m - (self.floor_z_m + self.shape.height_m)
        below = self.floor_z_m - (z_m + body.above_m)
        level = max(above, below)
        if aside > 0.0 and level > 0.0:
            return math.hypot(aside, level)
        return max(aside, level)


@dataclass(frozen=True, slots=True)
class Mover:
    """A shape and its straight track to and fro over the floor. Plain values, JSON-ready by `as_dict`."""

    shape: Shape
    ends_m: tuple[tuple[float, float], tuple[float, float]]  # x, y of both ends, odom
    floor_z_m: tuple[float, ...]  # floor at even steps from end to end, odom; at least two
    speed_mps: float  # while it walks
    pauses_s: tuple[float, float]  # at either end
    along_m: float  # where it is at first, from the first end
    forth: bool  # whether it goes towards the second end at first

    @property
    def length_m(self) -> float:
        """Of the track."""
        return math.dist(*self.ends_m)

    def at(self, along_m: float) -> Placed:
        """The mover so far from the first end of its track."""
        (x0, y0), (x1, y1) = self.ends_m
        share = min(max(along_m / self.length_m, 0.0), 1.0)
        step = share * (len(self.floor_z_m) - 1)
        i = min(int(step), len(self.floor_z_m) - 2)
        low, high = self.floor_z_m[i], self.floor_z_m[i + 1]
        return Placed(
            self.shape,
            x0 + share * (x1 - x0),
            y0 + share * (y1 - y0),
            low + (step - i) * (high - low),
            math.atan2(y1 - y0, x1 - x0),
        )

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return asdict(self)

    @staticmethod
    def from_dict(values: Mapping[str, Any]) -> Mover:
        """Back again; lists as JSON has them will do."""
        shape = values["shape"]
        (x0, y0), (x1, y1) = values["ends_m"]
        long, wide = shape["half_m"]
        first_s, last_s = values["pauses_s"]
        return Mover(
            Shape(shape["kind"], (float(long), float(wide)), float(shape["height_m"])),
            ((float(x0), float(y0)), (float(x1), float(y1))),
            tuple(float(z) for z in values["floor_z_m"]),
            float(values["speed_mps"]),
            (float(first_s), float(last_s)),
            float(values["along_m"]),
            bool(values["forth"]),
        )
