"""Furniture that homes have, as `furniture.py` gives it."""

from __future__ import annotations

import math

import numpy as np

from sim.worlds.families.furniture import FEET_M, block, cabinet, cone, legs, pole
from sim.worlds.families.layout import Rng
from sim.worlds.meshes import Mesh, box, hull_of_rings, prism


def stairs(wide_m: float, run_m: float, rise_m: float, count: int) -> Mesh:
    """A flight of solid steps along x from x = 0 upwards, its middle line on the x axis; one closed solid."""
    x = run_m * np.arange(count + 1)
    high = FEET_M + rise_m * np.arange(count + 1)  # high[k + 1]: top of step k
    rows, faces = [], []
    for y in (-0.5 * wide_m, 0.5 * wide_m):
        rows.append(np.column_stack([x, np.full(count + 1, y), np.full(count + 1, FEET_M)]))
        rows.append(np.column_stack([x[:-1], np.full(count, y), high[1:]]))  # front edge of each step
        rows.append(np.column_stack([x[1:], np.full(count, y), high[1:]]))  # back edge of each step
    per_side = 3 * count + 1
    for k in range(count):
        foot, after, front, back = k, k + 1, count + 1 + k, 2 * count + 1 + k
        below = 2 * count + k if k else foot  # back edge of the step before
        # On the side at -y, seen from -y; mirrored on the other. The first step has no step before it.
        fans = [(after, back, front), (after, front, below)] + ([(after, below, foot)] if k else [])
        faces += fans + [tuple(per_side + v for v in fan[::-1]) for fan in fans]
        for p, q in ((below, front), (front, back), (after, foot)):  # riser, tread, underside
            faces += [(p, q, per_side + q), (p, per_side + q, per_side + p)]
    p, q = 3 * count, count  # the back of the last step, from its back edge down
    faces += [(p, q, per_side + q), (p, per_side + q, per_side + p)]
    turned = np.array(faces, dtype=np.int32)
    return Mesh(np.concatenate(rows), turned)


def bed(rng: Rng, wide_m: float) -> list[Mesh]:
    """A bed with head board, mattress and pillows."""
    long, foot, top = 2.05, rng.uniform(0.08, 0.2), rng.uniform(0.45, 0.6)
    head = block(0.0, 0.03 - 0.5 * long, FEET_M, rng.uniform(0.8, 1.15), wide_m + 0.06, 0.05)
    parts = [head, *legs(wide_m - 0.1, long - 0.15, foot, 0.07)]
    parts.append(block(0.0, 0.03, foot, top - 0.22, wide_m, long - 0.06))
    parts.append(block(0.0, 0.03, top - 0.22, top, wide_m - 0.04, long - 0.1))
    heads = (-0.25 * wide_m, 0.25 * wide_m) if wide_m > 1.2 else (0.0,)
    return parts + [block(x, 0.35 - 0.5 * long, top, top + 0.12, 0.65, 0.4) for x in heads]


def wardrobe(rng: Rng) -> list[Mesh]:
    """A tall wardrobe."""
    return cabinet(rng.uniform(1.0, 2.0), 0.6, rng.uniform(1.9, 2.25))


def counter(wide_m: float) -> list[Mesh]:
    """Kitchen units with a worktop, a tap, a hob and cupboards above."""
    tap = [pole(0.3 * wide_m, -0.2, 0.905, 1.2, 0.015), block(0.3 * wide_m, -0.12, 1.2, 1.225, 0.03, 0.19)]
    over = block(-0.1 * wide_m, -0.14, 1.45, 2.1, 0.8 * wide_m, 0.34)
    hob = block(-0.25 * wide_m, 0.0, 0.9, 0.912, min(0.58, 0.4 * wide_m), 0.5)
    return [*_units(wide_m, 0.58), block(0.0, 0.0, 0.86, 0.9, wide_m + 0.01, 0.62), *tap, over, hob]


def _units(wide_m: float, deep_m: float) -> list[Mesh]:
    return cabinet(wide_m, deep_m, 0.86)


def island(rng: Rng) -> list[Mesh]:
    """A kitchen island with an overhanging top."""
    wide = rng.uniform(1.4, 2.2)
    return [*_units(wide, 0.65), block(0.0, 0.12, 0.86, 0.91, wide + 0.1, 0.95)]


def fridge(rng: Rng) -> list[Mesh]:
    """A fridge with a handle."""
    high = rng.uniform(1.5, 2.0)
    feet = legs(0.56, 0.58, 0.06, 0.05)
    return [block(0.0, 0.0, 0.06, high, 0.6, 0.64), block(0.25, 0.345, 0.8, 1.3, 0.03, 0.04), *feet]


def bathtub(rng: Rng) -> list[Mesh]:
    """A tub: four sides and a bottom."""
    wide, deep, high = rng.uniform(1.55, 1.8), rng.uniform(0.7, 0.8), rng.uniform(0.5, 0.6)
    parts = [block(0.0, 0.0, FEET_M, 0.18, wide, deep)]
    for side in (-1.0, 1.0):
        parts.append(block(side * 0.5 * (wide - 0.09), 0.0, 0.18, high, 0.09, deep))
        parts.append(block(0.0, side * 0.5 * (deep - 0.08), 0.18, high, wide - 0.184, 0.08))
    return parts


def toilet() -> list[Mesh]:
    """A bowl before a cistern."""
    bowl = cone(FEET_M, 0.4, 0.12, 0.2, 12).moved(0.0, 0.12)
    return [bowl, block(0.0, -0.22, 0.4, 0.8, 0.38, 0.17), block(0.0, 0.12, 0.402, 0.44, 0.38, 0.46)]


def basin(rng: Rng) -> list[Mesh]:
    """A wash basin on a foot or on a cupboard."""
    top = block(0.0, 0.0, 0.78, 0.86, 0.6, 0.46)
    tap = block(0.0, -0.15, 0.86, 0.98, 0.03, 0.1)
    if rng.random() < 0.5:
        return [top, tap, pole(0.0, -0.05, FEET_M, 0.78, 0.09, 10)]
    return [top, tap, *cabinet(0.56, 0.4, 0.78)]


def tv_stand(rng: Rng) -> list[Mesh]:
    """A low board with a television."""
    wide, high = rng.uniform(1.2, 1.9), rng.uniform(0.4, 0.55)
    parts = [block(0.0, 0.0, 0.12, high, wide, 0.4), *legs(wide - 0.1, 0.34, 0.12, 0.04)]
    size = rng.uniform(0.9, 1.3)
    parts.append(block(0.0, -0.02, high, high + 0.06, 0.4, 0.2))
    return [*parts, block(0.0, -0.02, high + 0.06, high + 0.06 + 0.57 * size, size, 0.05)]


def coffee_table(rng: Rng) -> list[Mesh]:
    """A low table: some can be driven under, most not."""
    wide, deep, high = rng.uniform(0.8, 1.2), rng.uniform(0.5, 0.8), rng.choice([0.2, 0.3, 0.38, 0.45])
    parts = [
        block(0.0, 0.0, high - 0.03, high, wide, deep),
        *legs(wide - 0.04, deep - 0.04, high - 0.03, 0.04),
    ]
    if rng.random() < 0.5:
        parts.append(block(rng.uniform(-0.2, 0.2), 0.0, high, high + 0.04, 0.22, 0.28))
    return parts


def rug(rng: Rng, wide_m: float, deep_m: float) -> list[Mesh]:
    """A rug, thin enough to be driven over; round or square."""
    top = FEET_M + rng.uniform(0.006, 0.025)
    if rng.random() < 0.3:
        return [pole(0.0, 0.0, FEET_M, top, 0.5 * min(wide_m, deep_m), 20)]
    return [block(0.0, 0.0, FEET_M, top, wide_m, deep_m)]


def curtain(high_m: float) -> list[Mesh]:
    """A folded curtain, to hang before a wall."""
    folds = np.linspace(-0.25, 0.25, 7)
    return [block(float(x), 0.02 * (-1.0) ** k, 0.05, high_m, 0.07, 0.05) for k, x in enumerate(folds)]


def shoe(rng: Rng) -> list[Mesh]:
    """A pair of shoes."""
    parts = []
    for side in (-1.0, 1.0):
        yaw = rng.uniform(-0.5, 0.5)
        sole = np.array([[-0.045, -0.14], [0.045, -0.14], [0.05, 0.08], [0.0, 0.15], [-0.05, 0.08]])
        parts.append(prism(sole, FEET_M, 0.055).moved(side * 0.09, 0.0, 0.0, yaw))
        parts.append(box((0.0, -0.08, 0.095), (0.04, 0.055, 0.038)).moved(side * 0.09, 0.0, 0.0, yaw))
    return parts


def bag(rng: Rng) -> list[Mesh]:
    """A bag or rucksack, 25 to 40 cm."""
    high, wide, deep = rng.uniform(0.25, 0.4), rng.uniform(0.28, 0.4), rng.uniform(0.15, 0.22)
    rings = []
    for z, share in ((FEET_M, 0.85), (0.4 * high, 1.0), (0.8 * high, 0.85), (high, 0.35)):
        u, v = 0.5 * wide * share, 0.5 * deep * share
        rings.append(np.array([[-u, -v, z], [u, -v, z], [u, v, z], [-u, v, z]]))
    return [hull_of_rings(rings)]


def ball(rng: Rng) -> list[Mesh]:
    """A toy ball."""
    radius = rng.uniform(0.05, 0.14)
    turn = np.linspace(0.05, math.pi - 0.05, 7)
    angle = np.arange(10) * (2.0 * math.pi / 10)
    rings = [
        np.column_stack(
            [
                radius * math.sin(t) * np.cos(angle),
                radius * math.sin(t) * np.sin(angle),
                np.full(10, FEET_M + radius * (1.0 - math.cos(t))),
            ]
        )
        for t in turn
    ]
    return [hull_of_rings(rings)]


def toys(rng: Rng) -> list[Mesh]:
    """Building blocks left on the floor."""
    parts = []
    for k in range(int(rng.integers(2, 5))):
        half = rng.uniform(0.025, 0.06)
        at = (0.14 * k - 0.2, rng.uniform(-0.1, 0.1), FEET_M + half)
        parts.append(box(at, (half, half, half), rng.uniform(0.0, 1.5)))
    return parts


def basket(rng: Rng) -> list[Mesh]:
    """A laundry basket or pouffe."""
    high, radius = rng.uniform(0.3, 0.5), rng.uniform(0.18, 0.28)
    return [cone(FEET_M, high, 0.9 * radius, radius, 12)]
