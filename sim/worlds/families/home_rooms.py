"""Rooms of a home, furnished with `home.py` and `furniture.py`."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from sim.worlds.families import home
from sim.worlds.families.furnish import Piece, Place, Room, repeat
from sim.worlds.families.furniture import (
    bin_,
    books,
    cabinet,
    cartons,
    chair,
    floor_lamp,
    pendant,
    plant,
    round_table,
    shelf,
    sofa,
    stool,
    table,
)
from sim.worlds.families.layout import Rng
from sim.worlds.meshes import Mesh

_CLUTTER: tuple[Callable[[Rng], list[Mesh]], ...] = (
    home.shoe,
    home.bag,
    home.ball,
    home.toys,
    home.basket,
    cartons,
)


def furnish(rng: Rng, room: Room, kind: str, difficulty: float) -> None:
    """Fill one room of a home with what its kind has, then clutter its floor."""
    _KINDS[kind](rng, room, difficulty)
    things = _CLUTTER[:5] if kind in ("bath", "kitchen") else _CLUTTER

    def litter() -> None:
        room.anywhere(rng, Piece(things[int(rng.integers(len(things)))](rng)), 6)

    repeat(rng, (0.03 + 0.32 * difficulty) * room.rect.area, litter)
    low = room.height_m - rng.uniform(0.35, 0.55) - 0.65 * difficulty * rng.random()
    lamp = Piece(pendant(rng, room.height_m, low))
    repeat(rng, 0.3 + 0.05 * difficulty * room.rect.area, lambda: room.anywhere(rng, lamp, 4, square=True))


def _rug(rng: Rng, room: Room, place: Place, ahead_m: float) -> None:
    """A rug before or under a piece, where the room is wide enough."""
    spread = Piece(home.rug(rng, rng.uniform(1.4, 2.4), rng.uniform(1.0, 1.7)))
    room.around(place, spread, [(0.0, ahead_m, 0.0)])


def _bookshelf(rng: Rng) -> list[Mesh]:
    wide, deep, high = rng.uniform(0.7, 1.2), rng.uniform(0.28, 0.36), rng.uniform(1.0, 2.1)
    boards = max(3, round(high / 0.36))
    return shelf(wide, deep, high, boards) + books(rng, wide, deep, high, boards)


def _sit_at(rng: Rng, room: Room, place: Place, wide_m: float, deep_m: float, round_it: bool) -> None:
    """Chairs about a table, some pushed in, some not."""
    seat, spots = Piece(chair(rng)), []
    if round_it:
        for turn in np.arange(4) * 0.5 * math.pi + rng.uniform(0.0, 1.5):
            away = 0.5 * wide_m + rng.uniform(0.16, 0.4)
            spots.append((away * math.cos(turn), away * math.sin(turn), float(turn) + 0.5 * math.pi))
    else:
        count = max(1, int(wide_m / 0.65))
        for x in ((np.arange(count) + 0.5) / count - 0.5) * (wide_m - 0.16):
            spots.append((float(x), 0.5 * deep_m + rng.uniform(0.12, 0.45), math.pi + rng.uniform(-0.3, 0.3)))
            spots.append((float(x), -0.5 * deep_m - rng.uniform(0.12, 0.45), rng.uniform(-0.3, 0.3)))
        spots.append((0.5 * wide_m + 0.3, 0.0, 0.5 * math.pi))
    room.around(place, seat, [spot for spot in spots if rng.random() < 0.85])


def _dining(rng: Rng, room: Room) -> None:
    """A table to eat at, with its chairs and perhaps a rug and a lamp."""
    round_it = rng.random() < 0.35
    wide, deep = (1.1, 1.1) if round_it else (rng.uniform(1.2, 2.1), rng.uniform(0.8, 1.0))
    top = Piece(
        round_table(0.5 * wide, 0.74) if round_it else table(wide, deep, rng.uniform(0.72, 0.77), 0.07)
    )
    place = room.anywhere(rng, top, 24, square=True, about_m=0.62)
    if place is None:
        place = room.anywhere(rng, top, 12, square=True, about_m=0.2)
    if place is None:
        return
    _sit_at(rng, room, place, wide, deep, round_it)
    if rng.random() < 0.4:
        _rug(rng, room, place, 0.0)
    if rng.random() < 0.6:
        room.around(place, Piece(pendant(rng, room.height_m, rng.uniform(1.45, 1.75))), [(0.0, 0.0, 0.0)])


def _living(rng: Rng, room: Room, difficulty: float) -> None:
    """Sofas about a low table and a television; where there is space, a dining table."""

    def group() -> None:
        wide = rng.uniform(1.7, 2.5) if room.rect.area > 14.0 else 1.5
        couch = Piece(sofa(rng, wide))
        place = room.at_wall(rng, couch, 10, 0.04)
        if place is None:
            place = room.anywhere(rng, couch, 8, square=True)
        if place is None:
            return
        ahead = rng.uniform(1.05, 1.25)
        room.around(place, Piece(home.coffee_table(rng)), [(rng.uniform(-0.3, 0.3), ahead, 0.0)])
        if rng.random() < 0.7:
            _rug(rng, room, place, ahead)
        easy = Piece(sofa(rng, rng.uniform(0.8, 0.95)))
        side = rng.choice([-1.0, 1.0])
        turn = side * (0.5 * math.pi + rng.uniform(-0.4, 0.4))
        room.around(place, easy, [(side * (0.5 * wide + 0.55), ahead + rng.uniform(-0.1, 0.4), turn)])
        room.around(place, Piece(floor_lamp(rng)), [(-side * (0.5 * wide + 0.25), -0.1, 0.0)])

    area = room.rect.area
    repeat(rng, 1.0 + max(0.0, area - 30.0) * 0.02, group)
    room.at_wall(rng, Piece(home.tv_stand(rng)), 6)
    repeat(rng, 0.03 * area + 0.02 * area * difficulty, lambda: _dining(rng, room))
    repeat(rng, (0.02 + 0.04 * difficulty) * area, lambda: room.at_wall(rng, Piece(_bookshelf(rng))))
    repeat(rng, (0.01 + 0.02 * difficulty) * area, lambda: room.at_wall(rng, Piece(plant(rng)), 5, 0.06))
    repeat(rng, (0.01 + 0.02 * difficulty) * area, lambda: room.at_wall(rng, Piece(home.curtain(2.2)), 4))


def _bedroom(rng: Rng, room: Room, difficulty: float) -> None:
    """A bed with night tables, a wardrobe, perhaps a desk."""
    wide = float(rng.choice([0.95, 1.4, 1.65])) if min(room.rect.size) > 2.8 else 0.95
    for width in sorted({wide, 0.95}, reverse=True):
        place = room.at_wall(rng, Piece(home.bed(rng, width)), 16)
        if place is not None:
            night = Piece(cabinet(0.42, 0.36, rng.uniform(0.4, 0.55)))
            room.around(place, night, [(s * (0.5 * width + 0.3), -0.82, 0.0) for s in (-1.0, 1.0)])
            if rng.random() < 0.6:
                _rug(rng, room, place, 1.2)
            break
    room.at_wall(rng, Piece(home.wardrobe(rng)), 10)
    repeat(rng, 0.3 + 0.6 * difficulty, lambda: _study_desk(rng, room))
    repeat(rng, 0.3 + 0.7 * difficulty, lambda: room.at_wall(rng, Piece(cabinet(1.0, 0.45, 0.85))))
    repeat(rng, 0.3 + 0.5 * difficulty, lambda: room.at_wall(rng, Piece(floor_lamp(rng)), 4, 0.05))
    repeat(rng, 0.3 + 0.5 * difficulty, lambda: room.at_wall(rng, Piece(home.curtain(2.2)), 4))


def _study_desk(rng: Rng, room: Room) -> None:
    """A desk at a wall with a chair before it."""
    place = room.at_wall(rng, Piece(table(rng.uniform(1.0, 1.5), 0.65, 0.74, 0.05)), 8)
    if place is not None:
        room.around(place, Piece(chair(rng)), [(rng.uniform(-0.2, 0.2), rng.uniform(0.4, 0.7), math.pi)])


def _kitchen(rng: Rng, room: Room, difficulty: float) -> None:
    """Units along walls, a fridge; an island with stools or a small table."""
    longest = max(room.rect.size) - 0.3
    for wide in (min(longest, rng.uniform(2.4, 3.6)), 1.8, 1.2):
        if room.at_wall(rng, Piece(home.counter(wide)), 10, 0.01) is not None:
            break
    repeat(
        rng,
        0.5 + 0.8 * difficulty,
        lambda: room.at_wall(rng, Piece(home.counter(rng.uniform(1.0, 1.8))), 8, 0.01),
    )
    room.at_wall(rng, Piece(home.fridge(rng)), 10)
    placed = None
    if min(room.rect.size) > 3.0 and rng.random() < 0.7:
        block = Piece(home.island(rng))
        placed = room.anywhere(rng, block, 12, square=True, middle=0.4)
        if placed is not None:
            seats = [(x, 0.75, math.pi) for x in (-0.5, 0.0, 0.5) if rng.random() < 0.4 + 0.5 * difficulty]
            room.around(placed, Piece(stool(rng)), seats)
    if placed is None or room.rect.area > 22.0:
        _dining(rng, room)
    repeat(rng, 0.5, lambda: room.at_wall(rng, Piece(bin_(rng)), 4))


def _bath(rng: Rng, room: Room, difficulty: float) -> None:
    """Tub, basin, toilet."""
    room.at_wall(rng, Piece(home.bathtub(rng)), 16)
    room.at_wall(rng, Piece(home.toilet()), 10)
    room.at_wall(rng, Piece(home.basin(rng)), 10)
    repeat(rng, 0.3 + 0.7 * difficulty, lambda: room.at_wall(rng, Piece(home.basket(rng))))
    if rng.random() < 0.5:
        room.anywhere(rng, Piece(home.rug(rng, 0.8, 0.6)), 4, square=True)


def _study(rng: Rng, room: Room, difficulty: float) -> None:
    """Desks and books."""
    repeat(rng, 1.0 + 0.6 * difficulty, lambda: _study_desk(rng, room))
    repeat(rng, 1.0 + 0.12 * difficulty * room.rect.area, lambda: room.at_wall(rng, Piece(_bookshelf(rng))))
    repeat(rng, 0.5, lambda: room.at_wall(rng, Piece(sofa(rng, rng.uniform(0.8, 1.6)))))
    repeat(rng, 0.5, lambda: room.at_wall(rng, Piece(plant(rng)), 4, 0.06))
    if rng.random() < 0.6:
        room.anywhere(rng, Piece(home.rug(rng, 1.8, 1.3)), 4, square=True, middle=0.5)


def _hall(rng: Rng, room: Room, difficulty: float) -> None:
    """A passage: a chest, shoes at the wall, a runner on the floor."""
    repeat(
        rng, 0.5 + difficulty, lambda: room.at_wall(rng, Piece(cabinet(rng.uniform(0.6, 1.0), 0.3, 0.85)), 8)
    )
    repeat(rng, 1.0 + 2.0 * difficulty, lambda: room.at_wall(rng, Piece(home.shoe(rng)), 4, 0.05))
    long_x = room.rect.size[0] > room.rect.size[1]
    strip = Piece(home.rug(rng, 1.8, 0.7))
    room.put(strip, *room.rect.centre, 0.0 if long_x else 0.5 * math.pi)


_KINDS: dict[str, Callable[[Rng, Room, float], None]] = {
    "living": _living,
    "bedroom": _bedroom,
    "kitchen": _kitchen,
    "bath": _bath,
    "study": _study,
    "hall": _hall,
}
