"""The building of a parking garage: slabs, walls, ramp, beams, pillars, ducts, pipes, lamps and signs."""

from __future__ import annotations

import math

import numpy as np

from labr_autonomy.types import Array
from sim.worlds.families.garage_plan import SLAB_M, Deck, Plan, Ramp
from sim.worlds.families.layout import Rng
from sim.worlds.meshes import Mesh, box, hull_of_rings, prism, tube

WALL_M = 0.2
PARAPET_M = 0.9
_PARAPET_WIDE_M = 0.15
_IN_M = 0.05  # how far thin parts reach into others, so that no two faces coincide
SEAM_M = 1e-3  # between large parts side by side: rays that count surfaces see both faces


def block(low_m: tuple[float, float, float], high_m: tuple[float, float, float]) -> Mesh:
    """An upright box between two corners, half a seam narrower on each side."""
    low, high = np.array(low_m), np.array(high_m)
    half = 0.5 * (high - low) - np.array([0.5, 0.5, 0.0]) * SEAM_M
    return box((0.5 * (low + high)).tolist(), half.tolist())


def along_y(profile_m: Array, low_m: float, high_m: float) -> Mesh:
    """A convex profile (k, 2) in x and z, counter-clockwise with x right and z up, drawn out along y."""
    rings = [
        np.column_stack([profile_m[:, 0], np.full(len(profile_m), y), profile_m[:, 1]])
        for y in (high_m, low_m)
    ]
    return hull_of_rings(rings)


def shell(rng: Rng, plan: Plan) -> list[Mesh]:
    """Everything of the building that is always there."""
    x, y = plan.half_m
    bottom = min(deck.floor_m for deck in plan.decks) - SLAB_M
    top = max(deck.ceiling_m for deck in plan.decks) + SLAB_M
    parts = [
        block((-x - WALL_M, y, bottom), (x + WALL_M, y + WALL_M, top)),
        block((-x - WALL_M, -y - WALL_M, bottom), (x + WALL_M, -y, top)),
        block((-x - WALL_M, -y, bottom), (-x, y, top)),
        block((x, -y, bottom), (x + WALL_M, y, top)),
    ]
    parts += {"single": _single, "two": _two, "sunken": _sunken}[plan.kind](plan)
    if plan.ramp is not None:
        parts += _ramp(plan.ramp)
    for number, deck in enumerate(plan.decks):
        last_y = plan.half_m[1] if plan.kind == "two" and number == 1 else deck.high_m
        parts += _pillars(plan, deck) + _beams(plan, deck, last_y) + _services(rng, plan, deck)
    return parts


def _single(plan: Plan) -> list[Mesh]:
    (x, y), (deck,) = plan.half_m, plan.decks
    return [
        block((-x, -y, deck.floor_m - SLAB_M), (x, y, deck.floor_m)),
        block((-x, -y, deck.ceiling_m), (x, y, deck.ceiling_m + SLAB_M)),
    ]


def _two(plan: Plan) -> list[Mesh]:
    """Two decks; the slab between them is open over the ramp, with parapets about the hole."""
    assert plan.ramp is not None
    (x, y), (lower, upper), ramp = plan.half_m, plan.decks, plan.ramp
    z0, z1, p = lower.ceiling_m, upper.floor_m, _PARAPET_WIDE_M
    return [
        block((-x, -y, -SLAB_M), (x, y, 0.0)),
        block((-x, -y, z0), (x, ramp.low_m, z1)),
        block((-x, ramp.low_m, z0), (ramp.from_m, y, z1)),
        block((ramp.to_m, ramp.low_m, z0), (x, y, z1)),
        block((-x, -y, upper.ceiling_m), (x, y, upper.ceiling_m + SLAB_M)),
        block((ramp.from_m, ramp.low_m - p, z1 - _IN_M), (ramp.to_m, ramp.low_m, z1 + PARAPET_M)),
        block((ramp.from_m - p, ramp.low_m - p, z1 - _IN_M), (ramp.from_m, y, z1 + PARAPET_M)),
    ]


def _sunken(plan: Plan) -> list[Mesh]:
    """A main deck and a lower one beyond the ramp's lane, which has the main deck's ceiling."""
    assert plan.ramp is not None
    (x, y), (main, low), ramp = plan.half_m, plan.decks, plan.ramp
    bottom, top, p = low.floor_m - SLAB_M, main.ceiling_m + SLAB_M, _PARAPET_WIDE_M
    rail = PARAPET_M
    return [
        block((-x, -y, bottom), (x, ramp.low_m, 0.0)),
        block((-x, ramp.low_m, bottom), (ramp.to_m, y, low.floor_m)),
        block((ramp.to_m, ramp.low_m, bottom), (x, ramp.high_m, 0.0)),  # landing at the head
        block((ramp.to_m, ramp.high_m, bottom), (x, y, low.floor_m)),
        block((-x, -y, main.ceiling_m), (x, ramp.high_m, top)),
        block((-x, ramp.high_m, low.ceiling_m), (x, y, top)),
        block((-x, ramp.low_m - p, -_IN_M), (ramp.to_m, ramp.low_m, rail)),
        block((ramp.to_m, ramp.high_m - p, -_IN_M), (x, ramp.high_m, rail)),
    ]


def _ramp(ramp: Ramp) -> list[Mesh]:
    """A solid wedge, with a wall along each side that does not lean on another."""
    a, b, z0, z1 = ramp.from_m, ramp.to_m, ramp.bottom_m, ramp.top_m
    foot, head = z0 + SEAM_M, b - 0.5 * SEAM_M
    wedge = np.array([[a, foot], [head, foot], [head, z1]])
    wall = np.array([[a, z0 - _IN_M], [b, z0 - _IN_M], [b, z1 + PARAPET_M], [a, z0 + PARAPET_M]])
    kerb = np.array([[a, z0 - _IN_M], [b, z0 - _IN_M], [b, z1 + 0.12], [a, z0 + 0.12]])
    p = _PARAPET_WIDE_M
    parts = [along_y(wedge, ramp.low_m + p + SEAM_M, ramp.high_m - p - SEAM_M)]
    if ramp.bottom_m < 0.0:  # beside a deck on the low side, open on the other
        return [
            *parts,
            along_y(wall, ramp.high_m - p, ramp.high_m),
            along_y(kerb, ramp.low_m, ramp.low_m + p),
        ]
    return [*parts, along_y(wall, ramp.low_m, ramp.low_m + p), along_y(kerb, ramp.high_m - p, ramp.high_m)]


def _pillars(plan: Plan, deck: Deck) -> list[Mesh]:
    sides = 12 if plan.is_round else 4
    turn = 0.0 if plan.is_round else 0.25 * math.pi
    radius = 0.5 * plan.pillar_m * (1.0 if plan.is_round else math.sqrt(2.0))
    angle = np.arange(sides) * (2.0 * math.pi / sides) + turn
    outline = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    pillar = prism(outline, deck.floor_m - _IN_M, deck.ceiling_m + _IN_M)
    return [pillar.moved(float(x), float(y)) for x, y in deck.pillars_m]


def _beams(plan: Plan, deck: Deck, last_y_m: float) -> list[Mesh]:
    """A beam across the deck on every line of pillars, and at its ends."""
    under = deck.floor_m + plan.beam_m
    wide = 0.5 * min(plan.pillar_m, 0.4)
    lines = np.unique(deck.pillars_m[:, 0]) if len(deck.pillars_m) else np.array([-5.0, 0.0, 5.0])
    return [
        block((x - wide, deck.low_m, under), (x + wide, last_y_m, deck.ceiling_m + _IN_M))
        for x in lines.tolist()
    ]


def _services(rng: Rng, plan: Plan, deck: Deck) -> list[Mesh]:
    """Under the ceiling: a duct, pipes, lamps, and signs that hang low over the aisles."""
    parts: list[Mesh] = []
    x, top = plan.half_m[0], deck.ceiling_m
    for strip in deck.strips:
        if strip.kind == "A":
            low, high = strip.middle_m - 0.08, strip.middle_m + 0.08
            lamps = np.arange(-x + 2.5, x - 2.0, 4.5).tolist()
            parts += [block((at - 0.6, low, top - 0.09), (at + 0.6, high, top + _IN_M)) for at in lamps]
            if rng.random() < 0.6:
                at, under = float(rng.uniform(-0.7, 0.7)) * x, deck.floor_m + float(rng.uniform(1.9, 2.1))
                y = strip.middle_m
                parts.append(block((at - 0.04, y - 0.75, under), (at + 0.04, y + 0.75, under + 0.22)))
                parts += [
                    tube(np.array([[at, y + d, under + 0.1], [at, y + d, top + _IN_M]]), [0.015, 0.015], 5)
                    for d in (-0.5, 0.5)
                ]
        elif strip.kind == "B":
            y = float(rng.uniform(strip.low_m + 0.8, strip.high_m - 0.8))
            if rng.random() < 0.45:
                high = float(rng.uniform(0.2, 0.32))
                parts.append(block((-x + 0.1, y - 0.28, top - high), (x - 0.1, y + 0.28, top + _IN_M)))
            else:
                for d, radius in ((0.0, 0.08), (0.28, 0.05)):
                    z = top - 0.12
                    line = np.array([[-x - _IN_M, y + d, z], [x + _IN_M, y + d, z]])
                    parts.append(tube(line, [radius, radius], 8))
    return parts
