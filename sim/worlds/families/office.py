"""Furniture that offices have, as `furniture.py` gives it, and rooms furnished with it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from sim.worlds.families.furnish import Piece, Place, Room, repeat
from sim.worlds.families.furniture import (
    FEET_M,
    bin_,
    block,
    books,
    cabinet,
    cartons,
    chair,
    legs,
    pendant,
    plant,
    pole,
    round_table,
    shelf,
    sofa,
    table,
)
from sim.worlds.families.layout import Rng
from sim.worlds.meshes import Mesh, box


def office_chair(rng: Rng) -> list[Mesh]:
    """A swivel chair on a five-armed foot."""
    seat, back = rng.uniform(0.44, 0.52), rng.uniform(0.9, 1.15)
    parts = [pole(0.0, 0.0, 0.1, seat - 0.06, 0.03), block(0.0, 0.0, seat - 0.06, seat, 0.46, 0.46)]
    for k in range(5):
        yaw = 2.0 * math.pi * k / 5
        parts.append(box((0.17, 0.0, 0.08), (0.14, 0.02, 0.018)).moved(0.0, 0.0, 0.0, yaw))
        parts.append(box((0.29, 0.0, 0.034), (0.025, 0.02, 0.028)).moved(0.0, 0.0, 0.0, yaw))
    parts.append(block(0.0, -0.22, seat + 0.12, back, 0.42, 0.05))
    return [*parts, block(0.0, -0.25, seat - 0.04, seat + 0.3, 0.05, 0.03)]


def desk(rng: Rng, wide_m: float) -> list[Mesh]:
    """A desk with drawers on one side and a screen or two on it; the sitter is at +y."""
    deep, high = rng.uniform(0.7, 0.8), rng.uniform(0.7, 0.76)
    parts = table(wide_m, deep, high, 0.05)
    side = rng.choice([-1.0, 1.0])
    if rng.random() < 0.6:
        parts.append(block(side * (0.5 * wide_m - 0.33), 0.0, 0.06, high - 0.06, 0.4, deep - 0.15))
    for x in rng.permutation([-0.3, 0.3])[: int(rng.integers(1, 3))]:
        parts.append(block(float(x), -0.2, high + 0.1, high + 0.46, 0.54, 0.04))
        parts.append(block(float(x), -0.22, high, high + 0.1, 0.2, 0.16))
    if rng.random() < 0.5:
        parts.append(block(0.0, -0.5 * deep + 0.1, 0.3, high - 0.06, wide_m - 0.2, 0.018))
    return parts


def screen(wide_m: float, high_m: float) -> list[Mesh]:
    """A partition screen on two feet."""
    feet = [block(s * (0.5 * wide_m - 0.15), 0.0, FEET_M, 0.035, 0.05, 0.36) for s in (-1.0, 1.0)]
    return [block(0.0, 0.0, 0.036, high_m, wide_m, 0.05), *feet]


def whiteboard(rng: Rng) -> list[Mesh]:
    """A board on a rolling stand."""
    wide, top = rng.uniform(1.0, 1.6), rng.uniform(1.7, 1.9)
    parts = [block(0.0, 0.0, 0.8, top, wide, 0.03)]
    for s in (-1.0, 1.0):
        parts.append(block(s * (0.5 * wide + 0.025), 0.0, 0.06, top, 0.04, 0.04))
        parts.append(block(s * (0.5 * wide + 0.025), 0.0, FEET_M, 0.06, 0.05, 0.55))
    return parts


def sign(rng: Rng, ceiling_m: float, bottom_m: float) -> list[Mesh]:
    """A sign hung across a corridor."""
    wide, high = rng.uniform(0.5, 1.1), rng.uniform(0.15, 0.3)
    rods = [pole(s * 0.4 * wide, 0.0, bottom_m + high, ceiling_m - 0.002, 0.008, 6) for s in (-1.0, 1.0)]
    return [block(0.0, 0.0, bottom_m, bottom_m + high, wide, 0.04), *rods]


def bench(rng: Rng) -> list[Mesh]:
    """A bench to wait on."""
    wide = rng.uniform(1.0, 1.6)
    return [block(0.0, 0.0, 0.4, 0.45, wide, 0.4), *legs(wide - 0.1, 0.36, 0.4, 0.05)]


def copier() -> list[Mesh]:
    """A copying machine."""
    return [
        block(0.0, 0.0, 0.05, 0.85, 0.6, 0.6),
        block(0.0, 0.0, 0.85, 1.05, 0.56, 0.54),
        *legs(0.5, 0.5, 0.05, 0.05),
        block(0.42, 0.0, 0.6, 0.64, 0.22, 0.35),
    ]


def furnish(rng: Rng, room: Room, kind: str, difficulty: float) -> None:
    """Fill one space of an office with what its kind has."""
    _KINDS[kind](rng, room, difficulty)
    amount = difficulty * room.rect.area
    repeat(rng, 0.012 * amount, lambda: room.anywhere(rng, Piece(cartons(rng)), 8))
    repeat(rng, 0.010 * amount, lambda: room.anywhere(rng, Piece(bin_(rng)), 4))
    repeat(rng, 0.012 * amount, lambda: room.anywhere(rng, Piece(office_chair(rng)), 4))


def _hang(rng: Rng, room: Room, per_m2: float, difficulty: float) -> None:
    """Lamps over the room; the harder the world, the lower."""
    low = room.height_m - rng.uniform(0.3, 0.5) - 0.75 * difficulty * rng.random()
    lamp = Piece(pendant(rng, room.height_m, low))
    repeat(rng, per_m2 * room.rect.area, lambda: room.anywhere(rng, lamp, 3, square=True))


def _chairs(rng: Rng, room: Room, place: Place, wide: float, deep: float, share: float) -> None:
    """Chairs about a table, facing it."""
    make = Piece(chair(rng) if rng.random() < 0.5 else office_chair(rng))
    seats, out = max(1, int(wide / 0.7)), 0.5 * deep + 0.16
    for x in ((np.arange(seats) + 0.5) / seats - 0.5) * (wide - 0.16):
        for side in (-1.0, 1.0):
            if rng.random() < share:
                away = out + rng.uniform(0.0, 0.15)
                turn = (math.pi if side > 0 else 0.0) + rng.uniform(-0.25, 0.25)
                room.around(place, make, [(float(x), side * away, turn)])


def _office(rng: Rng, room: Room, difficulty: float) -> None:
    """Desks along the walls, each with its chair; cabinets, a shelf, a plant."""
    make_desk, seat = Piece(desk(rng, rng.uniform(1.2, 1.8))), Piece(office_chair(rng))

    def work_place() -> None:
        place = room.at_wall(rng, make_desk, 8)
        if place is not None:
            spot = (
                rng.uniform(-0.2, 0.2),
                0.5 * (make_desk.high_m[1] - make_desk.low_m[1]) + rng.uniform(0.15, 0.5),
            )
            room.around(place, seat, [(*spot, math.pi + rng.uniform(-0.8, 0.8))])

    repeat(rng, max(1.0, room.rect.area * (0.05 + 0.08 * difficulty)), work_place)
    repeat(rng, 0.4 + 1.6 * difficulty, lambda: room.at_wall(rng, Piece(_storage(rng))))
    repeat(rng, 0.4 + 0.6 * difficulty, lambda: room.at_wall(rng, Piece(plant(rng)), 4, 0.05))
    _hang(rng, room, 0.02 + 0.04 * difficulty, difficulty)


def _storage(rng: Rng) -> list[Mesh]:
    """A cabinet or filled shelves."""
    wide, deep, high = rng.uniform(0.8, 1.3), rng.uniform(0.35, 0.45), rng.uniform(0.75, 2.0)
    if rng.random() < 0.5:
        return cabinet(wide, deep, high)
    boards = max(3, round(high / 0.4))
    return shelf(wide, deep, high, boards) + books(rng, wide, deep, high, boards)


def _open_plan(rng: Rng, room: Room, difficulty: float) -> None:
    """Islands of desks in rows, or desks along the walls where columns leave no island room; and screens."""
    wide, pairs = rng.uniform(1.3, 1.7), int(rng.integers(1, 4))
    kit = Piece(desk(rng, wide)), Piece(office_chair(rng)), Piece(screen(wide, rng.uniform(1.2, 1.5)))
    long_x = room.rect.size[0] >= room.rect.size[1]
    pitch_u, pitch_v = wide * pairs + rng.uniform(1.2, 1.9), rng.uniform(3.5, 4.3)
    size = room.rect.size if long_x else room.rect.size[::-1]
    nu, nv = max(1, int((size[0] - 0.8) / pitch_u)), max(1, int((size[1] - 0.6) / pitch_v))
    (cx, cy), desks = room.rect.centre, 0
    for u in (np.arange(nu) - 0.5 * (nu - 1)) * (size[0] / nu):
        for v in (np.arange(nv) - 0.5 * (nv - 1)) * (size[1] / nv):
            if rng.random() < 0.65 + 0.35 * difficulty:
                centre = (cx + u, cy + v, 0.0) if long_x else (cx - v, cy + u, 0.5 * math.pi)
                desks += _island(rng, room, centre, pairs, kit)
    if desks < 2:
        _office(rng, room, difficulty)
    area = room.rect.area

    def free_screen() -> None:
        room.anywhere(rng, Piece(screen(rng.uniform(1.2, 1.8), rng.uniform(1.2, 1.6))), 6, square=True)

    repeat(rng, (0.01 + 0.04 * difficulty) * area, free_screen)
    repeat(rng, (0.02 + 0.03 * difficulty) * area, lambda: room.at_wall(rng, Piece(_storage(rng))))
    repeat(rng, (0.01 + 0.02 * difficulty) * area, lambda: room.at_wall(rng, Piece(plant(rng)), 4, 0.05))
    _hang(rng, room, 0.02 + 0.04 * difficulty, difficulty)


def _island(rng: Rng, room: Room, centre: Place, pairs: int, kit: tuple[Piece, Piece, Piece]) -> int:
    """Pairs of desks back to back about a screen, each with its chair; returns how many desks stand."""
    make_desk, seat, divider = kit
    wide, deep, _ = make_desk.high_m - make_desk.low_m
    desks = 0
    for k in range(pairs):
        x = (k - 0.5 * (pairs - 1)) * (wide + 0.02)
        room.around(centre, divider, [(x, 0.0, 0.0)])
        for side in (-1.0, 1.0):
            if room.around(
                centre, make_desk, [(x, side * (0.5 * deep + 0.03), 0.0 if side > 0 else math.pi)]
            ):
                desks += 1
                away = deep + rng.uniform(0.15, 0.45)
                turn = (math.pi if side > 0 else 0.0) + rng.uniform(-0.7, 0.7)
                room.around(centre, seat, [(x + rng.uniform(-0.2, 0.2), side * away, turn)])
    return desks


def _meeting(rng: Rng, room: Room, difficulty: float) -> None:
    """One table in the middle with chairs round it, a board and a sideboard."""
    size = sorted(room.rect.size)
    wide = float(np.clip(size[1] - rng.uniform(2.0, 2.6), 1.2, 4.0))
    deep = float(np.clip(size[0] - 2.4, 0.8, 1.3))
    top = Piece(table(wide, deep, rng.uniform(0.72, 0.76), 0.08))
    yaw = 0.0 if room.rect.size[0] >= room.rect.size[1] else 0.5 * math.pi
    for shift in (0.0, 0.3, -0.3, 0.6):
        place = (room.rect.centre[0] + shift, room.rect.centre[1] + 0.5 * shift, yaw)
        if room.put(top, *place):
            _chairs(rng, room, place, wide, deep, 0.55 + 0.45 * difficulty)
            break
    else:
        small = room.anywhere(rng, Piece(round_table(0.5, 0.74)), 8)
        if small is not None:
            _chairs(rng, room, small, 0.7, 1.0, 0.8)
    repeat(rng, 0.6, lambda: room.at_wall(rng, Piece(whiteboard(rng))))
    repeat(rng, 0.3 + 0.7 * difficulty, lambda: room.at_wall(rng, Piece(cabinet(1.4, 0.4, 0.75))))
    repeat(rng, 0.3 + 0.7 * difficulty, lambda: room.at_wall(rng, Piece(plant(rng)), 4, 0.05))
    _hang(rng, room, 0.05 + 0.03 * difficulty, difficulty)


def _store(rng: Rng, room: Room, difficulty: float) -> None:
    """Rows of shelves, a copier, boxes on the floor."""
    wide, deep, high = rng.uniform(0.9, 1.2), rng.uniform(0.4, 0.55), rng.uniform(1.7, 2.2)
    rack = Piece(shelf(wide, deep, high, 5) + books(rng, wide, deep, high, 5))
    area = room.rect.area
    repeat(rng, (0.15 + 0.2 * difficulty) * area, lambda: room.at_wall(rng, rack, 4))
    repeat(rng, 0.7, lambda: room.at_wall(rng, Piece(copier())))
    repeat(rng, (0.05 + 0.12 * difficulty) * area, lambda: room.anywhere(rng, Piece(cartons(rng))))


def _lounge(rng: Rng, room: Room, difficulty: float) -> None:
    """Sofas about low tables, a kitchenette, round tables with chairs."""
    counter = Piece(cabinet(rng.uniform(1.6, 2.6), 0.62, 0.9))
    room.at_wall(rng, counter, 8)
    room.at_wall(rng, Piece(cabinet(0.62, 0.65, 1.8)), 4)

    def seats() -> None:
        place = room.at_wall(rng, Piece(sofa(rng, rng.uniform(1.5, 2.2))), 8)
        if place is not None:
            low = Piece(table(rng.uniform(0.7, 1.1), 0.55, rng.uniform(0.2, 0.45), 0.05))
            room.around(place, low, [(0.0, 1.15, 0.0)])

    def round_group() -> None:
        place = room.anywhere(rng, Piece(round_table(rng.uniform(0.4, 0.55), 0.74)), 12, about_m=0.5)
        if place is not None:
            _chairs(rng, room, place, 0.7, 0.9, 0.9)

    area = room.rect.area
    repeat(rng, (0.02 + 0.03 * difficulty) * area, seats)
    repeat(rng, (0.02 + 0.05 * difficulty) * area, round_group)
    repeat(rng, (0.02 + 0.02 * difficulty) * area, lambda: room.at_wall(rng, Piece(plant(rng)), 4, 0.05))
    _hang(rng, room, 0.03 + 0.05 * difficulty, difficulty)


def _corridor(rng: Rng, room: Room, difficulty: float) -> None:
    """What stands along corridors, and signs across them."""
    metres = max(room.rect.size)
    things: list[Callable[[], list[Mesh]]] = [
        lambda: plant(rng),
        lambda: cartons(rng),
        lambda: bench(rng),
        lambda: bin_(rng),
        lambda: cabinet(rng.uniform(0.6, 1.2), 0.4, rng.uniform(0.8, 1.9)),
    ]
    if min(room.rect.size) > 1.75:
        things.append(copier)

    def stand() -> None:
        room.at_wall(rng, Piece(things[int(rng.integers(len(things)))]()), 8, 0.03)

    repeat(rng, metres * (0.04 + 0.26 * difficulty), stand)
    repeat(rng, metres * 0.14 * difficulty, lambda: room.anywhere(rng, Piece(cartons(rng)), 8))
    yaw = 0.5 * math.pi if room.rect.size[0] > room.rect.size[1] else 0.0

    def hang() -> None:
        low = room.height_m - rng.uniform(0.4, 0.6) - 0.9 * difficulty * rng.random()
        thing = sign(rng, room.height_m, low) if rng.random() < 0.6 else pendant(rng, room.height_m, low)
        x, y = (rng.uniform(room.rect[k] + 0.3, room.rect[k + 2] - 0.3) for k in (0, 1))
        middle = room.rect.centre
        room.put(Piece(thing), *((x, middle[1]) if yaw else (middle[0], y)), yaw)

    repeat(rng, metres * (0.05 + 0.12 * difficulty), hang)


_KINDS: dict[str, Callable[[Rng, Room, float], None]] = {
    "corridor": _corridor,
    "office": _office,
    "open": _open_plan,
    "meeting": _meeting,
    "store": _store,
    "lounge": _lounge,
}
