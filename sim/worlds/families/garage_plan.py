"""Where things are in a parking garage: decks, rows of bays, aisles, pillars, the ramp.

Drawn in one fixed sense, the ramp's lane along x at the far side in y; `garage.draw` mirrors the whole.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from labr_autonomy.errors import BadInput
from labr_autonomy.types import Array
from sim.worlds.families.layout import Rng

SMALLEST_M = (14.0, 11.0)
CEILING_M = (2.3, 2.8)  # above each deck
SLAB_M = 0.22
SINK_M = (1.05, 1.25)  # depth of a half-deck
LANE_M = 3.4  # width of the ramp with its side walls
CROSS_M = 4.4  # aisle across the ends of the rows, and the landings of a ramp
AISLE_M = (5.0, 6.0)
PARALLEL_M = 2.1  # least width of a strip for cars along a wall
SLOPE = (0.10, 0.125)  # wanted; at most `SLOPE_MAX` where the building is short
SLOPE_MAX = 0.15
_PATTERNS = [  # rows of bays (B) and aisles (A) from one side to the other
    *("BA" * n for n in range(1, 6)),
    *("AB" * n for n in range(1, 6)),
    *(("BAB" * n)[i : 3 * n - j] for n in range(1, 6) for i in (0, 1) for j in (0, 1)),
]


@dataclass(frozen=True, slots=True)
class Strip:
    """A band of a deck along x: a row of bays "B", an aisle "A", parking along a wall "P", a footway "W"."""

    kind: str
    low_m: float  # y
    high_m: float

    @property
    def middle_m(self) -> float:
        """Its middle in y."""
        return 0.5 * (self.low_m + self.high_m)


@dataclass(frozen=True, slots=True)
class Deck:
    """A level floor under a level ceiling, over the whole length in x."""

    floor_m: float
    ceiling_m: float
    low_m: float  # y
    high_m: float
    strips: tuple[Strip, ...]
    pillars_m: Array  # (k, 2)


@dataclass(frozen=True, slots=True)
class Ramp:
    """A straight ramp along x, rising with x, its lane from `low_m` to the far side of the lane in y."""

    from_m: float  # x of its foot
    to_m: float  # x of its head
    bottom_m: float  # heights
    top_m: float
    low_m: float  # y
    high_m: float

    @property
    def slope(self) -> float:
        """Rise over run."""
        return (self.top_m - self.bottom_m) / (self.to_m - self.from_m)


@dataclass(frozen=True, slots=True)
class Plan:
    """One garage."""

    kind: str  # "single", "two" decks, or a "sunken" half-deck
    half_m: tuple[float, float]  # inner faces of the outer walls
    decks: tuple[Deck, ...]  # the lowest first; a sunken half-deck last
    ramp: Ramp | None
    bay_m: float  # width of a bay
    bay_rad: float  # angle of bays to the aisle; a right angle is pi / 2
    pillar_m: float  # width of a pillar
    is_round: bool
    pitch_m: float  # of pillars along x
    beam_m: float  # underside of beams above the deck

    @property
    def bay_pitch_m(self) -> float:
        """Distance of bays along x."""
        return self.bay_m / math.sin(self.bay_rad)


def plan(rng: Rng, size_m: tuple[float, float], difficulty: float) -> Plan:
    """Draw a garage's plan."""
    if size_m[0] < SMALLEST_M[0] or size_m[1] < SMALLEST_M[1]:
        raise BadInput(
            f"a garage of {size_m[0]:g} x {size_m[1]:g} m has no room for bays and aisles",
            f"Give at least {SMALLEST_M[0]:g} x {SMALLEST_M[1]:g} m.",
        )
    half = (0.5 * size_m[0], 0.5 * size_m[1])
    kind = str(rng.choice(["single", "two", "two", "sunken"]))
    angle = math.radians(float(rng.choice([90.0, 90.0, 75.0, 60.0])))
    bay = float(rng.uniform(2.45, 2.65))
    depth = 4.5 * math.sin(angle) + 0.8 * bay * math.cos(angle) + 0.2
    ceiling = float(rng.uniform(CEILING_M[0], 2.5 if kind == "two" else CEILING_M[1]))
    rise = ceiling + SLAB_M if kind == "two" else float(rng.uniform(*SINK_M))
    longest = size_m[0] - 2.0 * CROSS_M
    if kind == "two" and rise > SLOPE_MAX * longest:
        kind, rise = "sunken", SINK_M[0]
    if kind == "sunken" and rise > SLOPE_MAX * longest:
        kind = "single"
    bays_each = int(rng.choice([2, 3]))
    pillar = float(rng.uniform(0.3, 0.6))
    pitch = bays_each * bay / math.sin(angle)
    spine = bool(rng.random() < 0.4)

    def deck(floor_m: float, height_m: float, low_m: float, high_m: float) -> Deck:
        strips = _strips(rng, low_m, high_m, depth)
        return Deck(
            floor_m,
            floor_m + height_m,
            low_m,
            high_m,
            strips,
            _pillars(strips, half, low_m, high_m, pitch, spine),
        )

    ramp = None
    run = min(longest, rise / float(rng.uniform(*SLOPE)))
    head = half[0] - CROSS_M
    if kind == "two":
        edge = half[1] - LANE_M
        ramp = Ramp(head - run, head, 0.0, rise, edge, half[1])
        decks = [deck(0.0, ceiling, -half[1], edge)]
        decks.append(
            Deck(
                rise,
                rise + float(rng.uniform(*CEILING_M)),
                -half[1],
                edge,
                decks[0].strips,
                decks[0].pillars_m,
            )
        )
    elif kind == "sunken":
        split = half[1] - LANE_M - float(rng.choice([0.25, 0.45])) * size_m[1]
        ramp = Ramp(head - run, head, -rise, 0.0, split, split + LANE_M)
        decks = [
            deck(0.0, ceiling, -half[1], split),
            deck(-rise, float(rng.uniform(*CEILING_M)), split + LANE_M, half[1]),
        ]
    else:
        decks = [deck(0.0, ceiling, -half[1], half[1])]
    return Plan(
        kind=kind,
        half_m=half,
        decks=tuple(decks),
        ramp=ramp,
        bay_m=bay,
        bay_rad=angle * (1.0 if rng.random() < 0.5 else -1.0) % math.pi,
        pillar_m=pillar,
        is_round=bool(rng.random() < 0.4),
        pitch_m=pitch,
        beam_m=2.2 - 0.3 * float(rng.beta(1.0 + 2.0 * difficulty, 2.0)),
    )


def _strips(rng: Rng, low_m: float, high_m: float, depth_m: float) -> tuple[Strip, ...]:
    """Bands that fill a width; what is left widens the aisles, then is for parking at a wall or walking."""
    width = high_m - low_m
    need = {p: p.count("B") * depth_m + p.count("A") * AISLE_M[0] for p in _PATTERNS}
    fits = [p for p in _PATTERNS if need[p] <= width]
    if not fits:
        return (Strip("A", low_m, high_m),)
    most = max(need[p] for p in fits)
    pattern = str(rng.choice([p for p in fits if need[p] > most - 1.0]))
    aisles = max(pattern.count("A"), 1)
    spare = width - need[pattern]
    aisle = AISLE_M[0] + min(spare / aisles, AISLE_M[1] - AISLE_M[0])
    spare -= aisles * (aisle - AISLE_M[0])
    strips, y = [], low_m
    if spare > 0.3:
        strips.append(Strip("P" if spare > PARALLEL_M else "W", low_m, low_m + spare))
        y += spare
    for kind in pattern:
        wide = depth_m if kind == "B" else aisle
        strips.append(Strip(kind, y, y + wide))
        y += wide
    return tuple(strips)


def _pillars(
    strips: tuple[Strip, ...],
    half_m: tuple[float, float],
    low_m: float,
    high_m: float,
    pitch_m: float,
    spine: bool,
) -> Array:
    """Places of pillars (k, 2): along the aisles' edges, or down the middle of the rows between aisles."""
    edges, middles = [], []
    for number, strip in enumerate(strips):
        if strip.kind != "B":
            continue
        before = strips[number - 1].kind if number else "-"
        after = strips[number + 1].kind if number + 1 < len(strips) else "-"
        edges += [strip.low_m + 0.7] if before == "A" else []
        edges += [strip.high_m - 0.7] if after == "A" else []
        middles += [strip.high_m] if after == "B" else []
        middles += [strip.middle_m] if before == after == "A" else []
    lines = middles if spine and middles else edges
    lines = [y for y in lines if low_m + 1.0 < y < high_m - 0.5]
    count = int((2.0 * half_m[0] - 2.4) // pitch_m)
    x = (np.arange(count + 1) - 0.5 * count) * pitch_m
    return np.array([(a, b) for a in x for b in lines]).reshape(-1, 2)
