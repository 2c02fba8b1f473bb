"""Furnished flats in the manner of indoor scans. Frame: odom, floor at z = 0."""

from __future__ import annotations

import math

import numpy as np

from sim.worlds.families.floor_plan import (
    OUTSIDE,
    Border,
    Rect,
    Space,
    borders_of,
    floor_of,
    spanning_doors,
)
from sim.worlds.families.furnish import Room
from sim.worlds.families.home import stairs
from sim.worlds.families.home_rooms import furnish
from sim.worlds.families.layout import Layout, Rng
from sim.worlds.families.walls import (
    Opening,
    door_leaf,
    floor_and_ceiling,
    opening,
    wall,
    windows,
)
from sim.worlds.meshes import Mesh

LEAST_M = 5.0  # smallest side of a flat
_ROOM_M = 2.3  # smallest side of a room
_STEP_M = (0.27, 0.18)  # run and rise of a step
_FLIGHT_M = 0.95  # width of a flight of stairs


def draw(rng: Rng, size_m: tuple[float, float], difficulty: float) -> Layout:
    """One flat.

    Args:
        rng: Random numbers.
        size_m: Extents of the floor in x and y [m].
        difficulty: 0 (tidy, wide doors, ways round) to 1 (cluttered, narrow doors, one door a room).
    """
    floor = floor_of(size_m, LEAST_M)
    height, half_wall = rng.uniform(2.5, 2.8), 0.5 * rng.uniform(0.09, 0.16)
    spaces, borders = _plan(rng, floor)
    doors = _doors(rng, spaces, borders, difficulty)
    holes = doors + _windows(rng, spaces, borders)
    structure = floor_and_ceiling(floor, height)
    for border in borders:
        structure += wall(border, [h for h in holes if h.border == border], floor, half_wall, height)
    rooms = [
        Room(space.rect.shrunk(half_wall), [d for d in doors if number in d.border[:2]], height)
        for number, space in enumerate(spaces)
    ]
    structure += _stairs(rng, spaces, rooms, height)
    furnishings = []
    for door in doors:
        if door.width_m < 1.2 and door.bottom_m == 0.0 and rng.random() < 0.4 + 0.2 * difficulty:
            into = door.border.first if rng.random() < 0.5 else door.border.second
            leaf = door_leaf(rng, door, half_wall, into)
            if rooms[into].claim(leaf, at_door=True):
                furnishings.append(leaf)
    for room, space in zip(rooms, spaces, strict=True):
        furnish(rng, room, space.kind, difficulty)
        furnishings += room.placed
    region = np.array([[floor.x0, floor.y0, 0.0], [floor.x1, floor.y1, height - 0.3]])
    return Layout(structure, furnishings, region)


def _plan(rng: Rng, floor: Rect) -> tuple[list[Space], list[Border]]:
    """Rooms by cutting the floor again and again; in most flats about a passage."""
    hall: list[Rect] = []
    blocks = [floor]
    long_axis = int(floor.size[1] > floor.size[0])
    if min(floor.size) > 8.0 and rng.random() < 0.6:
        hall, blocks = _passage(rng, floor, long_axis)
    else:
        large = rng.uniform(0.3, 0.42)
        at = floor[long_axis] + floor.size[long_axis] * (large if rng.random() < 0.5 else 1.0 - large)
        blocks = sorted(floor.cut(long_axis, [at]), key=lambda b: b.area)
    target = rng.uniform(17.0, 26.0)  # m^2 below which a room may stay whole
    lived_in = rng.uniform(1.2, 2.4) * target  # the same, where the living room is to be
    parts = [_split(rng, block, lived_in if k == 0 else target) for k, block in enumerate(blocks)]
    rects = [room for part in parts for room in part]
    borders = borders_of(rects + hall)
    kinds = _kinds(rng, rects, borders)
    spaces = [Space(rect, kind) for rect, kind in zip(rects, kinds, strict=True)]
    return spaces + [Space(rect, "hall") for rect in hall], borders


def _passage(rng: Rng, floor: Rect, axis: int) -> tuple[list[Rect], list[Rect]]:
    """A passage along an axis that ends at a large room, and the blocks about it."""
    share = rng.uniform(0.3, 0.45)
    line = floor[axis] + floor.size[axis] * (share if rng.random() < 0.5 else 1.0 - share)
    low, high = floor.cut(axis, [line])
    big, rest = (low, high) if low.area < high.area else (high, low)
    across, wide = 1 - axis, rng.uniform(1.25, 1.7)
    at = rest[across] + rest.size[across] * rng.uniform(0.36, 0.64) - 0.5 * wide
    one, hall, other = rest.cut(across, [at, at + wide])
    return [hall], [big, one, other]


def _split(rng: Rng, block: Rect, target_m2: float) -> list[Rect]:
    """Cut a block in two until its parts are rooms."""
    axis = int(block.size[1] > block.size[0])
    length = block.size[axis]
    stop = block.area < target_m2 or (block.area < 1.5 * target_m2 and rng.random() < 0.3)
    slender = length > 2.2 * block.size[1 - axis]
    if length < 2.0 * _ROOM_M or (stop and not slender):
        return [block]
    if not slender and block.size[1 - axis] > 2.0 * _ROOM_M and rng.random() < 0.25:
        axis = 1 - axis
        length = block.size[axis]
    at = block[axis] + min(max(length * rng.uniform(0.3, 0.7), _ROOM_M), length - _ROOM_M)
    return [room for part in block.cut(axis, [at]) for room in _split(rng, part, target_m2)]


def _kinds(rng: Rng, rects: list[Rect], borders: list[Border]) -> list[str]:
    """The largest room is lived in, a neighbour is the kitchen, the smallest are baths."""
    order = sorted(range(len(rects)), key=lambda i: rects[i].area)
    kinds = [""] * len(rects)
    living = order[-1]
    kinds[living] = "living"
    beside = [
        b.first if b.second == living else b.second
        for b in borders
        if living in b[:2] and b.second != OUTSIDE and b.length_m > 2.0
    ]
    beside = [i for i in beside if i < len(rects) and rects[i].area > 7.0]
    if beside:
        kinds[beside[int(rng.integers(len(beside)))]] = "kitchen"
    left = [i for i in order if not kinds[i]]
    baths = [i for i in left if rects[i].area < 14.0][: 1 + (len(rects) > 6)]
    for i in left:
        kinds[i] = "bath" if i in baths else "bedroom"
        if i not in baths and rng.random() < 0.3:
            kinds[i] = "living" if rects[i].area > 22.0 else "study"
    return kinds


def _doors(rng: Rng, spaces: list[Space], borders: list[Border], difficulty: float) -> list[Opening]:
    """Doorways: one way into each room from living room or passage, one wide arch or bar, a few more."""
    kinds = [space.kind for space in spaces]
    top = rng.uniform(2.0, 2.15)
    weight = {"hall": 12.0, "living": 6.0, "kitchen": 1.5, "study": 0.8, "bedroom": 0.6, "bath": 0.02}
    tree = spanning_doors(rng, borders, {kinds.index("living")}, lambda a, _: weight[kinds[a]], 1.3)
    for border in borders:
        if border.second == OUTSIDE or border.length_m < 1.5 or border in tree:
            continue
        if "bath" not in (kinds[border.first], kinds[border.second]) and rng.random() < 0.35 * (
            1.0 - difficulty
        ):
            tree.append(border)
    holes: list[Opening] = []
    for border in tree:
        pair = {kinds[border.first], kinds[border.second]}
        sociable = pair <= {"living", "kitchen", "hall"} and border.length_m > 2.4
        if sociable and rng.random() < 0.75:
            holes += _wide(rng, border, "kitchen" in pair)
        else:
            width = rng.uniform(0.98, 1.1) - 0.18 * difficulty * rng.random()
            holes.append(opening(rng, border, width, 0.0, top))
    return holes


def _wide(rng: Rng, border: Border, kitchen: bool) -> list[Opening]:
    """An arch; towards a kitchen often a doorway beside a bar that can be flown over."""
    if kitchen and border.length_m > 3.2 and rng.random() < 0.65:
        way = rng.uniform(0.95, 1.2)
        bar = min(border.length_m - way - 0.9, rng.uniform(1.4, 2.4))
        start = border.low_m + 0.3 + rng.uniform(0.0, border.length_m - way - bar - 0.8)
        high = rng.uniform(0.95, 1.15)
        top = 10.0 if rng.random() < 0.5 else 2.1  # open to the ceiling, or a hatch
        first, second = (way, bar) if rng.random() < 0.5 else (bar, way)
        cuts = [(start, first), (start + first + 0.15, second)]
        return [
            Opening(border, low, low + wide, 0.0 if wide == way else high, 2.1 if wide == way else top)
            for low, wide in cuts
        ]
    width = min(border.length_m - 0.6, rng.uniform(1.5, 2.4))
    return [opening(rng, border, width, 0.0, rng.uniform(2.1, 2.3), 0.2)]


def _windows(rng: Rng, spaces: list[Space], borders: list[Border]) -> list[Opening]:
    """Windows in the outer walls."""
    sill, top = rng.uniform(0.6, 0.95), rng.uniform(2.05, 2.3)
    return [
        hole
        for border in borders
        if border.second == OUTSIDE and spaces[border.first].kind != "bath" and rng.random() < 0.75
        for hole in windows(rng, border, sill, top)
    ]


def _stairs(rng: Rng, spaces: list[Space], rooms: list[Room], height_m: float) -> list[Mesh]:
    """A flight up to below the ceiling, along a wall of a living room where it fits."""
    run, rise = _STEP_M
    count = int((height_m - 0.02) / rise)
    for space, room in zip(spaces, rooms, strict=True):
        if space.kind != "living":
            continue
        r = room.rect
        for _ in range(16):
            axis = int(rng.integers(2))
            if r.size[axis] < run * count + 0.9:
                continue
            at_low, upwards = rng.random() < 0.5, rng.random() < 0.5
            off = 0.5 * _FLIGHT_M + 0.02
            v = r[1 - axis] + off if at_low else r[3 - axis] - off
            length = run * count
            u = r[axis] + 0.02 if not upwards else r[axis + 2] - 0.02  # the high end stands at a wall
            start = u + length if not upwards else u - length
            heading = (0.0 if upwards else math.pi) + 0.5 * math.pi * axis
            flight = stairs(_FLIGHT_M, run, rise, count).moved(
                *((start, v) if axis == 0 else (v, start)), 0.0, heading
            )
            if room.claim(flight):
                return [flight]
    return []
