"""Setting furniture into one room: nothing overlaps, doorways stay clear and the floor stays in one piece.

A piece is a list of convex parts about its own origin on the floor: its back towards -y, front to +y.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from labr_autonomy.types import Array
from sim.worlds.families.floor_plan import Rect
from sim.worlds.families.layout import Rng
from sim.worlds.families.walls import Opening
from sim.worlds.meshes import Mesh, box, merged

ROBOT_M = 0.36  # the robot's radius of 0.30 m and a margin
UNDER_M = 0.30  # parts that begin higher are driven under
OVER_M = 0.04  # parts that end lower are driven over
DOOR_ZONE_M = 0.85  # depth of floor that stays free before a doorway
HEADROOM_M = 2.0  # below this nothing hangs in a doorway's zone
_CELL_M = 0.1
_WHOLE = 0.92  # share of a room's free floor that must hang together with its doors

Parts = Sequence[Mesh]
Place = tuple[float, float, float]  # x, y [m], yaw [rad]


class Piece:
    """Furniture before it has a place."""

    def __init__(self, parts: Parts) -> None:
        self.mesh = merged(parts)
        self._starts = np.cumsum([0] + [len(part.vertices_m) for part in parts[:-1]])
        low, high = self.mesh.vertices_m.min(axis=0), self.mesh.vertices_m.max(axis=0)
        self.low_m, self.high_m = low, high  # (3,) bounds about the origin

    def bounds(self, x_m: float, y_m: float, yaw_rad: float) -> Array:
        """Bounds of each part at a place, (k, 6): lower corner, upper corner."""
        v = self.mesh.moved(x_m, y_m, 0.0, yaw_rad).vertices_m
        low, high = np.minimum.reduceat(v, self._starts), np.maximum.reduceat(v, self._starts)
        return np.concatenate([low, high], axis=1)


class Room:
    """The floor of one room and what stands on it so far.

    Args:
        rect: Its clear floor, between the faces of its walls.
        doors: Its doorways and open sides.
        height_m: Of its ceiling.
    """

    def __init__(self, rect: Rect, doors: Sequence[Opening], height_m: float) -> None:
        self.rect, self.height_m = rect, height_m
        self.placed: list[Mesh] = []
        nx, ny = (max(1, math.ceil(side / _CELL_M)) for side in rect.size)
        self._x = rect.x0 + (np.arange(nx) + 0.5) * (rect.size[0] / nx)
        self._y = rect.y0 + (np.arange(ny) + 0.5) * (rect.size[1] / ny)
        self._shut = np.ones((nx, ny), dtype=bool)
        core = self._cells(np.array([[*rect.shrunk(ROBOT_M)]]))[0]
        self._shut[core] = False
        self._bounds = np.zeros((0, 6))
        self._zones = np.array([self._zone(door) for door in doors]).reshape(-1, 4)
        self._gates = [self._gate(door) for door in doors]

    def _cells(self, rects: Array) -> list[tuple[slice, slice]]:
        """Cells whose middle lies in each rectangle (k, 4)."""
        i0, j0 = np.searchsorted(self._x, rects[:, 0]), np.searchsorted(self._y, rects[:, 1])
        i1, j1 = np.searchsorted(self._x, rects[:, 2]), np.searchsorted(self._y, rects[:, 3])
        return [(slice(a, b), slice(c, d)) for a, b, c, d in zip(i0, i1, j0, j1, strict=True)]

    def _zone(self, door: Opening) -> tuple[float, float, float, float]:
        """The floor before a doorway."""
        x, y = door.centre_m
        side, deep = 0.5 * door.width_m + 0.05, DOOR_ZONE_M + 0.1
        dx, dy = (side, deep) if door.border.along == 0 else (deep, side)
        return x - dx, y - dy, x + dx, y + dy

    def _gate(self, door: Opening) -> tuple[int, int]:
        """The cell from which a doorway is entered."""
        inner = self.rect.shrunk(min(0.45, 0.49 * min(self.rect.size)))
        x, y = (min(max(c, inner[k]), inner[k + 2]) for k, c in enumerate(door.centre_m))
        return int(np.abs(self._x - x).argmin()), int(np.abs(self._y - y).argmin())

    def put(self, piece: Piece, x_m: float, y_m: float, yaw_rad: float = 0.0) -> bool:
        """Set a piece down, if it fits there."""
        bounds = piece.bounds(x_m, y_m, yaw_rad)
        if not self._fits(bounds):
            return False
        shut = self._with(bounds)
        if shut is None:
            return False
        self._take(piece.mesh.moved(x_m, y_m, 0.0, yaw_rad), bounds, shut)
        return True

    def claim(self, mesh: Mesh, *, at_door: bool = False) -> bool:
        """Let a part of the building stand here, if it fits like furniture; it does not become furniture.

        `at_door` is for what belongs to a doorway, such as its open leaf.
        """
        bounds = np.concatenate([mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)])[None]
        shut = self._with(bounds) if self._fits(bounds, at_door=at_door) else None
        if shut is None:
            return False
        self._bounds, self._shut = np.concatenate([self._bounds, bounds]), shut
        return True

    def _take(self, mesh: Mesh, bounds: Array, shut: NDArray[np.bool_]) -> None:
        self._shut = shut
        self._bounds = np.concatenate([self._bounds, bounds[bounds[:, 5] > OVER_M]])
        self.placed.append(mesh)

    def _fits(self, bounds: Array, *, at_door: bool = False) -> bool:
        """Whether parts lie in the room, off the doorways and off each other thing."""
        low, high = bounds[:, :3].min(axis=0), bounds[:, 3:].max(axis=0)
        r = self.rect
        if low[0] < r.x0 or low[1] < r.y0 or high[0] > r.x1 or high[1] > r.y1 or high[2] > self.height_m:
            return False
        tall = bounds[bounds[:, 5] > OVER_M]
        in_way = tall[tall[:, 2] < HEADROOM_M][:, None]
        z = self._zones[None]
        if (
            not at_door
            and (
                (in_way[..., 0] < z[..., 2])
                & (in_way[..., 3] > z[..., 0])
                & (in_way[..., 1] < z[..., 3])
                & (in_way[..., 4] > z[..., 1])
            ).any()
        ):
            return False
        a, b = tall[:, None], self._bounds[None]
        return not ((a[..., :3] < b[..., 3:]) & (a[..., 3:] > b[..., :3])).all(axis=2).any()

    def _shut_by(self, bounds: Array) -> NDArray[np.bool_]:
        """Cells closed to the robot's middle once these parts stand too."""
        low = bounds[(bounds[:, 2] < UNDER_M) & (bounds[:, 5] > OVER_M)]
        rects = np.concatenate([low[:, :2] - ROBOT_M, low[:, 3:5] + ROBOT_M], axis=1)
        shut = self._shut.copy()
        for cells in self._cells(rects):
            shut[cells] = True
        return shut

    def _with(self, bounds: Array) -> NDArray[np.bool_] | None:
        """The closed cells with these parts, or None where they would cut the floor or a doorway off."""
        shut = self._shut_by(bounds)
        free = ~shut
        labels, _ = ndimage.label(free)
        if self._gates:
            at_doors = {int(labels[gate]) for gate in self._gates}
            if len(at_doors) > 1 or 0 in at_doors:
                return None
            whole = (labels == at_doors.pop()).sum()
        else:
            whole = np.bincount(labels.reshape(-1))[1:].max(initial=0)
        return shut if whole >= _WHOLE * free.sum() else None

    def at_wall(self, rng: Rng, piece: Piece, tries: int = 6, gap_m: float = 0.02) -> Place | None:
        """Set a piece with its back to some wall; says where, or None where it fits nowhere."""
        for _ in range(tries):
            place = self._wall_place(rng, piece, gap_m)
            if place is not None and self.put(piece, *place):
                return place
        return None

    def _wall_place(self, rng: Rng, piece: Piece, gap_m: float) -> Place | None:
        """A place with the back to a wall; longer walls are taken more often. None where it is too wide."""
        lengths = np.array([self.rect.size[0], self.rect.size[1]] * 2)
        side = int(rng.choice(4, p=lengths / lengths.sum()))  # back to the south, east, north, west
        low, high = piece.low_m[0], piece.high_m[0]
        room = lengths[side] - (high - low) - 2.0 * gap_m
        if room < 0.0:
            return None
        along = rng.uniform(0.0, room) if rng.random() < 0.7 else rng.choice([0.0, room])  # or in a corner
        u, v = (
            -0.5 * lengths[side] + gap_m + along - low,
            -0.5 * lengths[1 - side % 2] + gap_m - piece.low_m[1],
        )
        x, y = ((u, v), (-v, u), (-u, -v), (v, -u))[side]
        cx, cy = self.rect.centre
        return cx + x, cy + y, side * 0.5 * math.pi

    def anywhere(
        self,
        rng: Rng,
        piece: Piece,
        tries: int = 6,
        *,
        square: bool = False,
        middle: float = 1.0,
        about_m: float = 0.0,
    ) -> Place | None:
        """Set a piece somewhere on the floor; says where, or None where it fits nowhere.

        Args:
            rng: Random numbers.
            piece: What to set down.
            tries: How often to try another place.
            square: Square to the walls, or at any yaw.
            middle: Less than 1 keeps to the middle of the room.
            about_m: Free space wanted on all sides, for chairs to come.
        """
        (cx, cy), (wide, deep) = self.rect.centre, self.rect.size
        (u0, v0, _), (u1, v1, _) = piece.low_m, piece.high_m
        half = (0.5 * (u1 - u0) + about_m, 0.5 * (v1 - v0) + about_m, 0.4)
        about = Piece([box((0.5 * (u0 + u1), 0.5 * (v0 + v1), 0.5), half)])
        for _ in range(tries):
            yaw = float(0.5 * math.pi * rng.integers(4) if square else rng.uniform(0.0, 2.0 * math.pi))
            x = cx + 0.5 * middle * wide * rng.uniform(-1.0, 1.0)
            y = cy + 0.5 * middle * deep * rng.uniform(-1.0, 1.0)
            if about_m > 0.0 and not self._fits(about.bounds(x, y, yaw)):
                continue
            if self.put(piece, x, y, yaw):
                return float(x), float(y), yaw
        return None

    def around(self, place: Place, piece: Piece, spots: Sequence[Place]) -> int:
        """Set the same piece at spots (x, y, yaw) about another thing's place; returns how many fitted."""
        x, y, yaw = place
        c, s = math.cos(yaw), math.sin(yaw)
        return sum(self.put(piece, x + c * u - s * v, y + s * u + c * v, yaw + turn) for u, v, turn in spots)


def repeat(rng: Rng, count_mean: float, thing: Callable[[], object]) -> None:
    """Do something a random number of times with a given mean."""
    whole = int(count_mean)
    for _ in range(whole + int(rng.random() < count_mean - whole)):
        thing()
