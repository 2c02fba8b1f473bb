"""Parking garage: pillars, low beams, parked cars, kerbs; often a ramp to a second deck or a half-deck."""

from __future__ import annotations

import math

import numpy as np

from labr_autonomy.types import Array
from sim.worlds.families import garage_things as things
from sim.worlds.families.cars import KINDS, SHARES, car
from sim.worlds.families.garage_plan import CROSS_M, Deck, Plan, Strip, plan
from sim.worlds.families.garage_shell import SEAM_M, block, shell
from sim.worlds.families.layout import Layout, Rng
from sim.worlds.meshes import Mesh

EDGE_M = 0.5  # from the outer walls inwards to the region in which places are asked for
HEAD_M = 0.3  # from the highest ceiling down to the top of that region
_CORE_M = (3.0, 4.2)  # stairs and lift
_CLUTTER = (things.cone, things.cone, things.trolley, things.barrier_board, things.bollard, things.pallet)


def draw(rng: Rng, size_m: tuple[float, float], difficulty: float) -> Layout:
    """One garage; see `families.draw` for the arguments."""
    drawn = plan(rng, size_m, difficulty)
    structure, furnishings = shell(rng, drawn), []
    first = drawn.decks[0].strips[0]
    core = first.kind == "B" and drawn.half_m[0] > 9.0
    if core:
        structure += _core(drawn)
    full = 0.5 + 0.35 * difficulty + float(rng.uniform(-0.1, 0.1))
    for deck in drawn.decks:
        for strip in deck.strips:
            if strip.kind == "B":
                furnishings += _row(rng, drawn, deck, strip, full, core and strip is first)
            elif strip.kind == "P":
                furnishings += _parallel(rng, drawn, deck, strip, full)
            elif strip.kind == "W":
                walk = things.kerb(rng, drawn.half_m[0] - CROSS_M, 0.5 * (strip.high_m - strip.low_m))
                structure.append(walk.moved(0.0, strip.middle_m, deck.floor_m))
        furnishings += _clutter(rng, drawn, deck, difficulty)
    mirror = rng.choice([-1.0, 1.0], 2)
    x, y = drawn.half_m
    low = min(deck.floor_m for deck in drawn.decks)
    high = max(deck.ceiling_m for deck in drawn.decks)
    region = np.array([[EDGE_M - x, EDGE_M - y, low], [x - EDGE_M, y - EDGE_M, high - HEAD_M]])
    return Layout(
        [_mirrored(part, mirror[0], mirror[1]) for part in structure],
        [_mirrored(part, mirror[0], mirror[1]) for part in furnishings],
        region,
    )


def _mirrored(part: Mesh, x: float, y: float) -> Mesh:
    """Mirrored in x and y where the sign is negative, still wound outwards."""
    faces = part.faces if x * y > 0.0 else part.faces[:, ::-1]
    return Mesh(part.vertices_m * np.array([x, y, 1.0]), np.ascontiguousarray(faces))


def _core(drawn: Plan) -> list[Mesh]:
    """Stairs and lift in a corner of every deck that has this corner."""
    x, y = drawn.half_m
    to = (-x + _CORE_M[0], -y + _CORE_M[1])
    decks = [deck for deck in drawn.decks if deck.low_m == -y]
    return [block((-x, -y, d.floor_m + SEAM_M), (*to, d.ceiling_m - SEAM_M)) for d in decks]


def _row(rng: Rng, drawn: Plan, deck: Deck, strip: Strip, full: float, core: bool) -> list[Mesh]:
    """Cars and wheel stops of one row of bays, and kerbed islands at the ends of a row between aisles."""
    at_wall = strip.low_m < 0.3 - drawn.half_m[1] or strip.high_m > drawn.half_m[1] - 0.3
    reach = drawn.half_m[0] - (0.4 if at_wall else CROSS_M)
    low, high = -reach + (_CORE_M[0] + 0.2 if core else 0.0), reach
    made: list[Mesh] = []
    if not at_wall and rng.random() < 0.8:
        half = 0.45 * (strip.high_m - strip.low_m)
        ends = (low + 0.4, high - 0.4)
        made += [things.kerb(rng, 0.4, half).moved(x, strip.middle_m, deck.floor_m) for x in ends]
        low, high = low + 1.0, high - 1.0
    pitch = drawn.bay_pitch_m
    count = math.ceil(2.0 * drawn.half_m[0] / pitch)
    centres = _bay_line(deck) + (np.arange(-count, count + 1) + 0.5) * pitch
    centres = centres[(centres - 0.5 * pitch >= low - 0.01) & (centres + 0.5 * pitch <= high + 0.01)]
    back = -1.0 if _faces_up(deck, strip) else 1.0
    for x in centres.tolist():
        yaw = drawn.bay_rad + (math.pi if rng.random() < 0.5 else 0.0) + float(rng.normal(0.0, 0.01))
        place = np.array([x, strip.middle_m]) + rng.uniform((-0.03, -0.1), (0.03, 0.1))
        taken = rng.random() < full
        for kind in (str(rng.choice(KINDS, p=SHARES)), "small"):  # the small one where a pillar is in the way
            thing, length, width = car(rng, kind)
            if taken and _clears(deck, place, yaw, length, width, drawn.pillar_m):
                made.append(thing.moved(float(place[0]), float(place[1]), deck.floor_m, yaw))
                break
        if _has_back(deck, strip):
            y = strip.middle_m + back * (0.5 * (strip.high_m - strip.low_m) - 0.5)
            along = x + (y - strip.middle_m) / math.tan(drawn.bay_rad)
            made.append(things.wheel_stop(drawn.bay_rad).moved(along, y, deck.floor_m))
    return made


def _parallel(rng: Rng, drawn: Plan, deck: Deck, strip: Strip, full: float) -> list[Mesh]:
    """Cars along a wall, nose to tail."""
    made: list[Mesh] = []
    for x in np.arange(-drawn.half_m[0] + 4.0, drawn.half_m[0] - 3.0, 5.9).tolist():
        thing, _, width = car(rng, str(rng.choice(KINDS, p=SHARES)))
        turned = math.pi if rng.random() < 0.1 else 0.0
        if rng.random() < full:
            y = strip.low_m + 0.5 * width + 0.1
            made.append(thing.moved(x + float(rng.uniform(-0.2, 0.2)), y, deck.floor_m, turned))
    return made


def _bay_line(deck: Deck) -> float:
    """An x at which a line between bays stands on a line of pillars."""
    return float(deck.pillars_m[0, 0]) if len(deck.pillars_m) else 0.0


def _beside(deck: Deck, strip: Strip) -> tuple[str, str]:
    """Kinds of the strips below and above in y; "-" for none."""
    number = deck.strips.index(strip)
    after = deck.strips[number + 1].kind if number + 1 < len(deck.strips) else "-"
    return (deck.strips[number - 1].kind if number else "-"), after


def _faces_up(deck: Deck, strip: Strip) -> bool:
    """Whether the aisle of a row lies on its side of larger y."""
    return _beside(deck, strip)[1] == "A"


def _has_back(deck: Deck, strip: Strip) -> bool:
    """Whether a row is closed on one side; between two aisles cars drive through."""
    return _beside(deck, strip) != ("A", "A")


def _clears(
    deck: Deck, place_m: Array, yaw_rad: float, length_m: float, width_m: float, pillar_m: float
) -> bool:
    """Whether a vehicle at a place (2,) stands off every pillar of its deck."""
    off = deck.pillars_m - place_m
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    along, across = np.abs(off @ [c, s]), np.abs(off @ [-s, c])
    reach = 0.5 * pillar_m
    return not bool(((along < 0.5 * length_m + reach) & (across < 0.5 * width_m + reach)).any())


def _clutter(rng: Rng, drawn: Plan, deck: Deck, difficulty: float) -> list[Mesh]:
    """Small things along the edges of the aisles, and now and then an entrance with a boom."""
    made: list[Mesh] = []
    aisles = [strip for strip in deck.strips if strip.kind == "A"]
    area = 2.0 * drawn.half_m[0] * (deck.high_m - deck.low_m)
    for _ in range(round(area / 100.0 * (0.4 + 2.2 * difficulty))):
        strip = aisles[int(rng.integers(len(aisles)))]
        side = float(rng.choice([-1.0, 1.0])) * float(rng.uniform(0.25, 0.46))
        y = strip.middle_m + side * (strip.high_m - strip.low_m)
        x = float(rng.uniform(-0.93, 0.93)) * drawn.half_m[0]
        thing = _CLUTTER[int(rng.integers(len(_CLUTTER)))](rng)
        made.append(thing.moved(x, y, deck.floor_m, float(rng.uniform(0.0, 2.0 * math.pi))))
    if rng.random() < 0.6:
        strip = aisles[int(rng.integers(len(aisles)))]
        x = float(rng.choice([-1.0, 1.0])) * (drawn.half_m[0] - CROSS_M - 1.5)
        made.append(things.boom(rng, 2.4).moved(x, strip.middle_m, deck.floor_m))
    return made
