"""Furniture of offices and homes.

Each function returns the parts of a piece as `furnish.Piece` takes them:
origin on the floor under its middle, back towards -y, front towards +y, all parts closed. [m]
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from sim.worlds.families.layout import Rng
from sim.worlds.meshes import Mesh, box, hull_of_rings, tube

FEET_M = 0.003  # furniture begins this high, so that its lower faces do not lie in the floor's
_EDGE_M = 0.002  # between a part and the next one upon it
_CUBE = box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))


def block(x_m: float, y_m: float, low_m: float, high_m: float, wide_m: float, deep_m: float) -> Mesh:
    """An upright box over a rectangle about (x, y)."""
    half = np.array([wide_m, deep_m, high_m - low_m - _EDGE_M]) * 0.5
    return Mesh(_CUBE.vertices_m * half + np.array([x_m, y_m, 0.5 * (low_m + high_m)]), _CUBE.faces)


def pole(x_m: float, y_m: float, low_m: float, high_m: float, radius_m: float, sides: int = 8) -> Mesh:
    """An upright round stick."""
    return tube(np.array([[x_m, y_m, low_m], [x_m, y_m, high_m]]), [radius_m, radius_m], sides)


def cone(low_m: float, high_m: float, below_m: float, above_m: float, sides: int = 10) -> Mesh:
    """A truncated upright cone: radius `below_m` at its foot, `above_m` at its top."""
    return tube(np.array([[0.0, 0.0, low_m], [0.0, 0.0, high_m]]), [below_m, above_m], sides)


def legs(wide_m: float, deep_m: float, high_m: float, thick_m: float, low_m: float = FEET_M) -> list[Mesh]:
    """Four legs at the corners of a rectangle."""
    x, y = 0.5 * (wide_m - thick_m), 0.5 * (deep_m - thick_m)
    return [block(u, v, low_m, high_m, thick_m, thick_m) for u in (-x, x) for v in (-y, y)]


def table(wide_m: float, deep_m: float, high_m: float, leg_m: float = 0.06) -> list[Mesh]:
    """A top on four legs."""
    top = block(0.0, 0.0, high_m - 0.035, high_m, wide_m, deep_m)
    return [top, *legs(wide_m - 0.08, deep_m - 0.08, high_m - 0.035, leg_m)]


def round_table(radius_m: float, high_m: float) -> list[Mesh]:
    """A round top on one foot."""
    top = pole(0.0, 0.0, high_m - 0.03, high_m, radius_m, 16)
    return [top, pole(0.0, 0.0, 0.03, high_m - 0.03, 0.045), pole(0.0, 0.0, FEET_M, 0.03, 0.5 * radius_m, 12)]


def chair(rng: Rng) -> list[Mesh]:
    """A chair on four legs of 2 to 3 cm."""
    wide, seat, leg = rng.uniform(0.40, 0.48), rng.uniform(0.43, 0.47), rng.uniform(0.02, 0.03)
    back = rng.uniform(0.82, 0.98)
    posts = [
        block(u, 0.5 * (leg - wide), seat, back, leg, leg) for u in (0.5 * (leg - wide), 0.5 * (wide - leg))
    ]
    rest = block(0.0, 0.5 * (leg - wide), back - 0.22, back - 0.02, wide - 2.0 * leg, 0.02)
    return [
        block(0.0, 0.0, seat - 0.035, seat, wide, wide),
        *legs(wide, wide, seat - 0.035, leg),
        *posts,
        rest,
    ]


def stool(rng: Rng) -> list[Mesh]:
    """A bar stool on thin legs."""
    high, side = rng.uniform(0.62, 0.75), 0.34
    return [block(0.0, 0.0, high - 0.04, high, side, side), *legs(side, side, high - 0.04, 0.025)]


def shelf(wide_m: float, deep_m: float, high_m: float, boards: int) -> list[Mesh]:
    """Open shelves with a back."""
    thick = 0.022
    parts = [block(s * 0.5 * (wide_m - thick), 0.0, FEET_M, high_m, thick, deep_m) for s in (-1.0, 1.0)]
    parts.append(block(0.0, 0.5 * (0.012 - deep_m), 0.05, high_m, wide_m - 2.0 * thick, 0.012))
    levels = np.linspace(0.07, high_m - thick, boards)
    return parts + [block(0.0, 0.006, z, z + thick, wide_m - 2.0 * thick, deep_m - 0.014) for z in levels]


def books(rng: Rng, wide_m: float, deep_m: float, high_m: float, boards: int) -> list[Mesh]:
    """What stands on the boards of `shelf`."""
    levels = np.linspace(0.07, high_m - 0.022, boards)
    parts = []
    for z, above in itertools.pairwise(levels):
        wide = rng.uniform(0.25, 0.85) * (wide_m - 0.1)
        x = rng.uniform(-0.5, 0.5) * (wide_m - 0.1 - wide)
        top = z + 0.022 + rng.uniform(0.5, 0.85) * (above - z - 0.03)
        parts.append(block(x, 0.0, float(z) + 0.024, float(top), wide, 0.7 * deep_m))
    return parts


def cabinet(wide_m: float, deep_m: float, high_m: float) -> list[Mesh]:
    """A closed body on a plinth, with handles."""
    body = block(0.0, 0.0, 0.08, high_m, wide_m, deep_m)
    plinth = block(0.0, -0.02, FEET_M, 0.08, wide_m - 0.06, deep_m - 0.06)
    doors = max(1, round(wide_m / 0.5))
    x = (np.arange(doors) + 0.85) * (wide_m / doors) - 0.5 * wide_m
    handles = [
        block(float(u), 0.5 * deep_m + 0.015, 0.6 * high_m, 0.6 * high_m + 0.12, 0.015, 0.026) for u in x
    ]
    return [body, plinth, *handles]


def plant(rng: Rng) -> list[Mesh]:
    """A pot with a stem and leaning leaves."""
    pot, high = rng.uniform(0.12, 0.2), rng.uniform(0.7, 1.7)
    rim = rng.uniform(0.25, 0.4)
    parts = [cone(FEET_M, rim, 0.75 * pot, pot), pole(0.0, 0.0, rim + _EDGE_M, 0.8 * high, 0.02, 6)]
    count = int(rng.integers(7, 12))
    for k in range(count):
        yaw, reach = 2.4 * k + rng.uniform(-0.3, 0.3), rng.uniform(0.7, 1.2) * (pot + 0.14)
        z = rim + 0.1 + (high - rim - 0.1) * (k + 0.5) / count
        c, s = math.cos(yaw), math.sin(yaw)
        points = np.array([[0.02, z - 0.15], [0.55 * reach, z], [reach, z - 0.04 + 0.08 * rng.random()]])
        along = np.column_stack([points[:, 0] * c, points[:, 0] * s, points[:, 1]])
        parts.append(_leaf(along, (-s, c), (0.012, 0.065, 0.01)))
    return parts


def _leaf(along_m: np.ndarray, across: tuple[float, float], half_m: tuple[float, ...]) -> Mesh:
    """A thin blade along three points."""
    side, up = np.array([*across, 0.0]), np.array([0.0, 0.0, 0.004])
    corners = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
    rings = [
        np.stack([point + u * half * side + v * up for u, v in corners])
        for point, half in zip(along_m, half_m, strict=True)
    ]
    return hull_of_rings(rings)


def cartons(rng: Rng) -> list[Mesh]:
    """One to three cardboard boxes on each other."""
    parts, base = [], FEET_M
    side = rng.uniform(0.3, 0.55, 2)
    for _ in range(int(rng.integers(1, 4))):
        high = rng.uniform(0.2, 0.4)
        part = box((0.0, 0.0, base + 0.5 * high), (*(0.5 * side), 0.5 * high - _EDGE_M))
        dx, dy, yaw = rng.uniform(-1.0, 1.0, 3) * (0.03, 0.03, 0.2)
        parts.append(part.moved(dx, dy, 0.0, yaw))
        base, side = base + high, side * rng.uniform(0.75, 1.0)
    return parts


def bin_(rng: Rng) -> list[Mesh]:
    """A waste-paper bin."""
    high = rng.uniform(0.28, 0.6)
    return [cone(FEET_M, high, 0.09 + 0.08 * high, 0.11 + 0.12 * high)]


def pendant(rng: Rng, ceiling_m: float, bottom_m: float) -> list[Mesh]:
    """A lamp hung from the ceiling by a cord: a round shade or a long bar."""
    if rng.random() < 0.6:
        high, radius = rng.uniform(0.18, 0.32), rng.uniform(0.15, 0.28)
        shade = cone(bottom_m, bottom_m + high, radius, 0.35 * radius)
        return [shade, pole(0.0, 0.0, bottom_m + high + _EDGE_M, ceiling_m - _EDGE_M, 0.008, 6)]
    wide = rng.uniform(0.9, 1.4)
    cords = [pole(u, 0.0, bottom_m + 0.08, ceiling_m - _EDGE_M, 0.006, 6) for u in (-0.4 * wide, 0.4 * wide)]
    return [block(0.0, 0.0, bottom_m, bottom_m + 0.07, wide, 0.12), *cords]


def floor_lamp(rng: Rng) -> list[Mesh]:
    """A lamp on a thin pole."""
    high = rng.uniform(1.4, 1.8)
    foot = pole(0.0, 0.0, FEET_M, 0.03, 0.15, 12)
    return [foot, pole(0.0, 0.0, 0.032, high - 0.25, 0.014, 6), cone(high - 0.248, high, 0.2, 0.13)]


def sofa(rng: Rng, wide_m: float) -> list[Mesh]:
    """A sofa or armchair on short feet, with arms, back and seat cushions."""
    deep, seat, back = rng.uniform(0.8, 0.95), rng.uniform(0.38, 0.46), rng.uniform(0.7, 0.95)
    arm, foot = rng.uniform(0.1, 0.2), rng.uniform(0.05, 0.12)
    parts = legs(wide_m - 0.06, deep - 0.06, foot, 0.05)
    parts.append(block(0.0, 0.0, foot, seat - 0.12, wide_m, deep))
    parts.append(block(0.0, 0.5 * (0.2 - deep), seat - 0.12, back, wide_m - 2.0 * arm, 0.2))
    for side in (-1.0, 1.0):
        parts.append(block(side * 0.5 * (wide_m - arm), 0.0, seat - 0.12, seat + 0.2, arm, deep))
    count = max(1, round((wide_m - 2.0 * arm) / 0.7))
    each = (wide_m - 2.0 * arm) / count
    for k in range(count):
        x = (k + 0.5) * each - 0.5 * wide_m + arm
        parts.append(block(x, 0.1, seat - 0.12, seat, each - 0.02, deep - 0.22))
    return parts
