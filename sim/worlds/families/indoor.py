"""Office floors: corridors, rooms off them, doors, furniture. Frame: odom, floor at z = 0."""

from __future__ import annotations

import numpy as np

from sim.worlds.families.floor_plan import (
    OUTSIDE,
    Border,
    Rect,
    Space,
    borders_of,
    floor_of,
    spanning_doors,
    weighted_cuts,
)
from sim.worlds.families.furnish import Room
from sim.worlds.families.furniture import block
from sim.worlds.families.layout import Layout, Rng
from sim.worlds.families.office import furnish
from sim.worlds.families.walls import (
    Opening,
    door_leaf,
    floor_and_ceiling,
    opening,
    wall,
    windows,
)
from sim.worlds.meshes import Mesh

LEAST_M = 8.0  # smallest side of a floor
_BLOCK_M = 7.6  # a block wider than this both ways gets a corridor of its own
_ROOM_M = (2.7, 6.0)  # how wide rooms along a corridor are
_OPEN_M2 = 28.0  # larger rooms may be open-plan offices or lounges
_COLUMNS_M2 = 30.0  # and larger ones may have columns


def draw(rng: Rng, size_m: tuple[float, float], difficulty: float) -> Layout:
    """One office floor.

    Args:
        rng: Random numbers.
        size_m: Extents of the floor in x and y [m].
        difficulty: 0 (wide, empty, many ways round) to 1 (narrow, full, dead ends, things hanging low).
    """
    floor = floor_of(size_m, LEAST_M)
    height, half_wall = rng.uniform(2.6, 3.0), 0.5 * rng.uniform(0.10, 0.18)
    spaces = _Plan(rng, difficulty, 2.0 * half_wall).spaces(floor)
    borders = borders_of([space.rect for space in spaces])
    doors = _doors(rng, spaces, borders, difficulty)
    holes = doors + _windows(rng, spaces, borders, height)
    structure = floor_and_ceiling(floor, height)
    for border in borders:
        structure += wall(border, [h for h in holes if h.border == border], floor, half_wall, height)
    rooms = [
        Room(space.rect.shrunk(half_wall), [d for d in doors if number in d.border[:2]], height)
        for number, space in enumerate(spaces)
    ]
    furnishings = []
    for door in doors:
        if door.width_m < 1.3 and rng.random() < 0.3 + 0.4 * difficulty:
            sides = sorted(door.border[:2], key=lambda i: spaces[int(i)].kind == "corridor")  # rooms first
            into = int(sides[int(rng.random() < 0.2)])
            leaf = door_leaf(rng, door, half_wall, into)
            if rooms[into].claim(leaf, at_door=True):
                furnishings.append(leaf)
    for room, space in zip(rooms, spaces, strict=True):
        if space.rect.area > _COLUMNS_M2 and space.kind in ("open", "lounge") and rng.random() < 0.6:
            structure += _columns(rng, room)
        furnish(rng, room, space.kind, difficulty)
        furnishings += room.placed
    region = np.array([[floor.x0, floor.y0, 0.0], [floor.x1, floor.y1, height - 0.3]])
    return Layout(structure, furnishings, region)


class _Plan:
    """Cuts a floor into corridors and blocks, and blocks into rooms."""

    def __init__(self, rng: Rng, difficulty: float, wall_m: float) -> None:
        self._rng, self._difficulty, self._wall_m = rng, difficulty, wall_m
        self._spaces: list[Space] = []

    def spaces(self, floor: Rect) -> list[Space]:
        """All spaces of a floor."""
        along = int(floor.size[1] > floor.size[0])
        if self._rng.random() < 0.25:
            along = 1 - along
        self._corridor(floor, along, sides=frozenset())
        return self._spaces

    def _block(self, block: Rect, sides: frozenset[int]) -> None:
        """A block; `sides` are the edges of its Rect (0 to 3) along which a corridor runs."""
        if min(block.size) > _BLOCK_M and self._rng.random() < 0.9:
            touching = sorted(sides)
            side = touching[int(self._rng.integers(len(touching)))]
            self._corridor(block, side % 2, sides)
        else:
            self._rooms(block, sides)

    def _corridor(self, block: Rect, along: int, sides: frozenset[int]) -> None:
        """Run a corridor along an axis through a block, through or up to a room at its far end."""
        rng = self._rng
        width = self._wall_m + rng.uniform(2.0, 2.4) - 0.6 * self._difficulty * rng.random() ** 0.5
        ends = [side for side in (along, along + 2) if side in sides]
        start = ends[int(rng.integers(len(ends)))] if ends else along + 2 * int(rng.integers(2))
        rest = frozenset(side for side in sides if side not in (along, along + 2))
        if block.size[along] > 9.0 and rng.random() < 0.15 + 0.45 * self._difficulty:
            deep = rng.uniform(2.8, 4.5)
            end = (start + 2) % 4
            line = block[end] + (deep if end < 2 else -deep)
            low, high = block.cut(along, [line])
            far, block = (low, high) if end < 2 else (high, low)
            self._rooms(far, frozenset({start}) | rest | ({end} & sides))
        across = 1 - along
        at = block[across] + block.size[across] * rng.uniform(0.36, 0.64) - 0.5 * width
        low, middle, high = block.cut(across, [at, at + width])
        self._spaces.append(Space(middle, "corridor"))
        self._block(low, (sides & {along, along + 2, across}) | {across + 2})
        self._block(high, (sides & {along, along + 2, across + 2}) | {across})

    def _rooms(self, block: Rect, sides: frozenset[int]) -> None:
        """A row of rooms along the longest corridor beside a block."""
        rng = self._rng
        side = max(sorted(sides), key=lambda k: block.size[1 - k % 2])
        axis = 1 - side % 2
        length, deep = block.size[axis], block.size[1 - axis]
        if _OPEN_M2 < block.area < 110.0 and rng.random() < 0.4:
            self._add(block)
            return
        count = max(1, round(length / rng.uniform(*_ROOM_M)))
        for room in block.cut(axis, weighted_cuts(rng, block[axis], block[axis + 2], count, 0.3)):
            if deep > 5.5 and rng.random() < 0.25 + 0.4 * self._difficulty:
                at = room[1 - axis] + room.size[1 - axis] * rng.uniform(0.42, 0.58)
                for part in room.cut(1 - axis, [at]):
                    self._add(part)
            else:
                self._add(room)

    def _add(self, room: Rect) -> None:
        rng = self._rng
        if room.area > _OPEN_M2 and min(room.size) > 4.0:
            kind = "open" if rng.random() < 0.65 else str(rng.choice(["lounge", "meeting"]))
        elif min(room.size) < 2.6 or room.area < 9.0:
            kind = str(rng.choice(["store", "office"]))
        else:
            kind = str(rng.choice(["office", "meeting", "store", "lounge"], p=[0.55, 0.22, 0.11, 0.12]))
        self._spaces.append(Space(room, kind))


def _doors(rng: Rng, spaces: list[Space], borders: list[Border], difficulty: float) -> list[Opening]:
    """Doorways: corridors open into each other, each room has one door, some have a second."""
    corridors = {i for i, space in enumerate(spaces) if space.kind == "corridor"}
    top = rng.uniform(2.0, 2.2)
    holes = []

    def door(border: Border) -> Opening:
        width = rng.uniform(1.05, 1.2) - 0.15 * difficulty * (0.5 + 0.5 * rng.random())
        if border.length_m > 3.0 and rng.random() < 0.12:
            width = rng.uniform(1.6, 2.0)  # a double door
        return opening(rng, border, width, 0.0, top)

    taken = set()
    for border in borders:
        if border.first in corridors and border.second in corridors:
            holes.append(Opening(border, border.low_m, border.high_m, 0.0, 10.0))
            taken.add(border)
    doors = spanning_doors(rng, borders, corridors, lambda a, _: 50.0 if a in corridors else 1.0, 1.5)
    taken |= set(doors)
    for border in borders:
        if border.second == OUTSIDE or border.length_m < 1.6 or border in taken:
            continue
        into = border.first in corridors or border.second in corridors
        if rng.random() < (0.40 if into else 0.22) * (1.0 - 0.85 * difficulty):
            doors.append(border)
    return holes + [door(border) for border in doors]


def _windows(rng: Rng, spaces: list[Space], borders: list[Border], height_m: float) -> list[Opening]:
    """Windows in the outer walls of rooms."""
    sill, top = rng.uniform(0.7, 1.0), height_m - rng.uniform(0.3, 0.6)
    return [
        hole
        for border in borders
        if border.second == OUTSIDE and spaces[border.first].kind != "store" and rng.random() < 0.8
        for hole in windows(rng, border, sill, top)
    ]


def _columns(rng: Rng, room: Room) -> list[Mesh]:
    """Square columns in rows through a large room, off its doorways."""
    side, pitch = rng.uniform(0.3, 0.5), rng.uniform(2.8, 4.0)
    lines = []
    for axis in (0, 1):
        count = max(2, round(room.rect.size[axis] / pitch))
        lines.append(room.rect[axis] + room.rect.size[axis] / count * np.arange(1, count))
    standing = [block(x, y, 0.0, room.height_m, side, side) for x in lines[0] for y in lines[1]]
    return [column for column in standing if room.claim(column)]
