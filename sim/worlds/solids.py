"""Scenes of boxes and cylinders: the hall of the first missions, and the scenes that GKPN trains on.

They have an exact distance, which the training loss needs; the worlds of the benchmark are in `families`.
Places stay free and connected.

The world is centred on odom's origin. Solids are placed in groups (a table is five boxes); a group that
comes closer than CLEAR_M to a place, or that cuts the floor between two places, is not placed.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy import ndimage

from labr_autonomy.errors import BadInput
from labr_autonomy.types import Array
from sim.worlds.primitives import Scene, box, cylinder
from sim.worlds.world import World

CLEAR_M = 0.9  # free radius about each place to keep clear
PASSAGE_M = 0.45  # radius of the upright cylinder that must be able to drive between the places
OVERHEAD_M = 1.0  # solids that begin higher do not close the floor
CELL_M = 0.05
WALL_M = 0.1  # half the thickness of a hall's outer wall is 0.05
OUTDOOR_MARGIN_M = 6.0  # floor beyond the region of an outdoor family

Rng = np.random.Generator
Group = list[Array]
Size = tuple[float, float]


def generate(family: str, seed: int, size_m: Size, clear_m: Array) -> World:
    """Triangles of one generated world, floor included.

    Args:
        family: One of `FAMILIES`.
        seed: Same seed, same world.
        size_m: Extents of the region in x and y [m], centred on the origin.
        clear_m: (k, 3) places in odom that keep `CLEAR_M` of free radius over the whole height and stay
            connected on the floor for a cylinder of radius `PASSAGE_M`.
    """
    scene = generate_scene(family, seed, size_m, clear_m)
    margin = WALL_M if family == "hall" else OUTDOOR_MARGIN_M
    spec = {"family": family, "seed": seed, "size_m": list(size_m)}
    half = (0.5 * size_m[0] + margin, 0.5 * size_m[1] + margin)
    return scene.world(f"{family}-{seed}", spec, half)


def generate_scene(family: str, seed: int, size_m: Size, clear_m: Array) -> Scene:
    """The solids of `generate`, with their exact distance."""
    if family not in FAMILIES:
        raise BadInput(f"there is no world family '{family}'", f"Take one of {', '.join(FAMILIES)}.")
    places = np.asarray(clear_m, dtype=np.float64).reshape(-1, 3)
    _require_inside(family, size_m, places)
    rng = np.random.default_rng([seed, *family.encode()])
    groups = FAMILIES[family](rng, size_m)
    kept = _hall_shell(rng, size_m) if family == "hall" else []
    grid = _FloorGrid(size_m, places, kept)
    for group in groups:
        if grid.accepts(group):
            kept = kept + group
    return Scene(np.stack(kept) if kept else np.zeros((0, 8)))


def _require_inside(family: str, size_m: Size, places: Array) -> None:
    """Refuse places that the outer walls would touch."""
    room = np.array(size_m) / 2.0 - (PASSAGE_M + CELL_M + WALL_M)
    outside = [tuple(float(v) for v in p[:2]) for p in places if (np.abs(p[:2]) > room).any()]
    if outside:
        raise BadInput(
            f"the place {outside[0]} lies outside a {family} of {size_m[0]:g} x {size_m[1]:g} m about (0, 0)",
            f"Keep |x| <= {room[0]:.2f} and |y| <= {room[1]:.2f}, or enlarge size_m.",
        )


class _FloorGrid:
    """Distance to what has been placed, on the floor's 5 cm grid, and whether the places stay connected."""

    def __init__(self, size_m: Size, places: Array, shell: Group) -> None:
        x, y = (np.arange(-0.5 * s + 0.5 * CELL_M, 0.5 * s, CELL_M) for s in size_m)
        self._centres = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
        self._places = places
        low = np.array([x[0], y[0]])
        self._cells = np.rint((places[:, :2] - low) / CELL_M).astype(int)
        outline = Scene(np.stack(shell)) if shell else Scene(np.zeros((0, 8)))
        self._distance = outline.footprint_distance(self._centres, OVERHEAD_M)

    def accepts(self, group: Group) -> bool:
        """Take the group in if all places stay free and connected."""
        if not len(self._places):
            return True
        scene = Scene(np.stack(group))
        if (scene.footprint_distance(self._places[:, :2]) < CLEAR_M).any():
            return False
        distance = np.minimum(self._distance, scene.footprint_distance(self._centres, OVERHEAD_M))
        labels, _ = ndimage.label(distance > PASSAGE_M)
        found = labels[self._cells[:, 0], self._cells[:, 1]]
        if found[0] == 0 or (found != found[0]).any():
            return False
        self._distance = distance
        return True


def _at(rng: Rng, size_m: Size, margin_m: float = 0.4) -> tuple[float, float]:
    """A place anywhere in the region."""
    x, y = (float(rng.uniform(-0.5 * s + margin_m, 0.5 * s - margin_m)) for s in size_m)
    return x, y


def _count(rng: Rng, size_m: Size, low: float, high: float) -> int:
    """A number of groups, given as groups per 100 m^2."""
    return max(1, round(float(rng.uniform(low, high)) * size_m[0] * size_m[1] / 100.0))


def _pillar(rng: Rng, size_m: Size, low_m: float = 0.1, high_m: float = 0.45, short: float = 0.3) -> Group:
    """A vertical cylinder, tall or (with probability `short`) low enough to fly over."""
    top = float(rng.uniform(0.5, 2.0) if rng.random() < short else rng.uniform(2.5, 4.5))
    return [cylinder(*_at(rng, size_m), float(rng.uniform(low_m, high_m)), 0.0, top)]


def _block(rng: Rng, size_m: Size, top_m: tuple[float, float], half_m: tuple[float, float]) -> Group:
    """A box that stands on the floor."""
    top = float(rng.uniform(*top_m))
    hx, hy = rng.uniform(*half_m, 2)
    return [box([*_at(rng, size_m), top / 2], [hx, hy, top / 2], float(rng.uniform(0, math.pi)))]


def _turned(x: float, y: float, yaw: float, along: float, across: float) -> tuple[float, float]:
    """The point at (along, across) of a frame at (x, y) turned by yaw."""
    c, s = math.cos(yaw), math.sin(yaw)
    return x + c * along - s * across, y + s * along + c * across


def _table(rng: Rng, size_m: Size) -> Group:
    """A table top on four thin legs."""
    (x, y), yaw = _at(rng, size_m, 0.9), float(rng.uniform(0, math.pi))
    hx, hy, top, thick = rng.uniform(0.5, 0.9), rng.uniform(0.35, 0.5), rng.uniform(0.68, 0.8), 0.02
    half = (top - thick) / 2
    corners = [_turned(x, y, yaw, i * (hx - 0.04), j * (hy - 0.04)) for i in (-1, 1) for j in (-1, 1)]
    legs = [box([*corner, half], [0.025, 0.025, half], yaw) for corner in corners]
    return [box([x, y, top], [hx, hy, thick], yaw), *legs]


def _gap_wall(rng: Rng, size_m: Size, gap_m: tuple[float, float], top_m: float) -> Group:
    """Two pieces of wall in line with a passage between them, along x or y, nearly."""
    (x, y), gap, length = _at(rng, size_m), float(rng.uniform(*gap_m)), float(rng.uniform(1.0, 3.0))
    yaw = float(rng.choice([0.0, math.pi / 2]) + rng.normal(0.0, 0.05))
    reach, half = 0.5 * (gap + length), [length / 2, 0.08, top_m / 2]
    return [box([*_turned(x, y, yaw, side * reach, 0.0), top_m / 2], half, yaw) for side in (-1, 1)]


def _hall_shell(rng: Rng, size_m: Size) -> Group:
    """The outer walls of a hall, just outside its region; no ceiling."""
    top, t = float(rng.uniform(2.6, 3.2)), 0.5 * WALL_M
    sx, sy = 0.5 * size_m[0], 0.5 * size_m[1]
    long = [box([0.0, side * (sy + t), top / 2], [sx + WALL_M, t, top / 2]) for side in (-1, 1)]
    return long + [box([side * (sx + t), 0.0, top / 2], [t, sy, top / 2]) for side in (-1, 1)]


def _hall(rng: Rng, size_m: Size) -> list[Group]:
    """What stands in a hall: partial walls, pillars, boxes of all heights and tables, in a mixed order."""
    top = float(rng.uniform(2.2, 2.8))
    groups = [_gap_wall(rng, size_m, (1.2, 1.6), top) for _ in range(_count(rng, size_m, 1.5, 3.5))]
    rest = [_pillar(rng, size_m, 0.12, 0.3, short=0.1) for _ in range(_count(rng, size_m, 1.5, 4.0))]
    rest += [_block(rng, size_m, (0.3, 0.8), (0.2, 0.6)) for _ in range(_count(rng, size_m, 2.0, 5.0))]
    rest += [_block(rng, size_m, (0.9, 2.2), (0.2, 0.7)) for _ in range(_count(rng, size_m, 1.5, 4.0))]
    rest += [_table(rng, size_m) for _ in range(_count(rng, size_m, 0.7, 2.0))]
    return groups + [rest[i] for i in rng.permutation(len(rest))]


def _forest(rng: Rng, size_m: Size) -> list[Group]:
    """Trunks."""
    return [_pillar(rng, size_m) for _ in range(_count(rng, size_m, 7.0, 13.0))]


def _boxes(rng: Rng, size_m: Size) -> list[Group]:
    """Boxes, low and high."""
    tops = ((0.3, 1.5), (1.5, 4.5))
    return [
        _block(rng, size_m, tops[rng.integers(2)], (0.2, 1.2)) for _ in range(_count(rng, size_m, 5.0, 9.0))
    ]


def _walls(rng: Rng, size_m: Size) -> list[Group]:
    """Walls with a passage, low and high."""
    return [
        _gap_wall(rng, size_m, (1.1, 2.0), float(rng.uniform(0.6, 1.6) if rng.random() < 0.35 else 4.5))
        for _ in range(_count(rng, size_m, 3.0, 5.0))
    ]


def _mixed(rng: Rng, size_m: Size) -> list[Group]:
    """A little of forest, boxes and walls."""
    groups = _forest(rng, size_m)[::3] + _boxes(rng, size_m)[::3] + _walls(rng, size_m)[::3]
    return [groups[i] for i in rng.permutation(len(groups))]


def _barrier(rng: Rng, size_m: Size) -> list[Group]:
    """Long low walls best flown over, overhead beams and poles."""
    groups: list[Group] = []
    for _ in range(_count(rng, size_m, 1.0, 2.0)):
        top, yaw = float(rng.uniform(0.4, 1.3)), float(rng.uniform(0, math.pi))
        length = float(rng.uniform(0.15, 0.3)) * min(size_m)
        groups.append([box([*_at(rng, size_m), top / 2], [length, 0.15, top / 2], yaw)])
    for _ in range(_count(rng, size_m, 1.0, 1.8)):
        low, yaw = float(rng.uniform(0.9, 1.5)), float(rng.uniform(0, math.pi))
        half = float(rng.uniform(0.25, 0.75))
        groups.append([box([*_at(rng, size_m), low + half], [float(rng.uniform(1, 4)), 0.2, half], yaw)])
    return groups + [_pillar(rng, size_m, 0.1, 0.4, short=0.0) for _ in range(_count(rng, size_m, 2.0, 4.0))]


FAMILIES: dict[str, Callable[[Rng, Size], list[Group]]] = {
    "hall": _hall,
    "forest": _forest,
    "boxes": _boxes,
    "walls": _walls,
    "mixed": _mixed,
    "barrier": _barrier,
}
