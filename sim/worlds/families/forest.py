"""Forest: hills, trunks with low branches, crowns, undergrowth; clearings and a path by seed. No ceiling."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from labr_autonomy.errors import BadInput
from labr_autonomy.types import Array
from sim.worlds.families import trees, undergrowth
from sim.worlds.families.layout import Layout, Rng
from sim.worlds.families.terrain import Ground, hilly
from sim.worlds.meshes import Mesh

SMALLEST_M = 8.0
EDGE_M = 2.0  # from the extents inwards to the region in which places are asked for
BEYOND_M = 2.5  # ground beyond the extents, for the camera
ABOVE_M = 3.0  # top of the region over the highest ground
TREES_PER_100M2 = (6.0, 16.0)  # at difficulty 0 and 1
STEEPEST = ((0.0, 0.5, 1.0), (0.015, 0.115, 0.245))  # difficulty, rise over run of the steepest place
_LOW_PER_100M2 = {  # undergrowth at difficulty 0 and 1
    undergrowth.bush: (1.2, 3.0),
    undergrowth.log: (0.35, 1.1),
    undergrowth.stump: (0.4, 0.9),
    undergrowth.rock: (0.4, 1.8),
    undergrowth.ledge: (-0.6, 0.5),
}
_GAP_M = 0.9  # between trunks, mostly: the robot is 0.6 m wide
_LOW_GAP_M = 0.35  # between undergrowth and trunks; what is nearer has grown together


@dataclass(frozen=True, slots=True)
class Stand:
    """What makes this forest differ from another, before any tree is planted."""

    conifers: float  # share of conifers
    dead: float  # share of dead trees
    thick_m: float  # usual diameter of a trunk
    clearings_m: Array  # (k, 3) x, y, radius
    path_m: Array  # (p, 2) points along a path that no tree stands on; none when empty
    path_half_m: float

    def is_open(self, xy_m: Array) -> bool:
        """Whether a place (2,) is in a clearing or on the path."""
        if (np.hypot(*(self.clearings_m[:, :2] - xy_m).T) < self.clearings_m[:, 2]).any():
            return True
        return self.on_path(xy_m)

    def on_path(self, xy_m: Array) -> bool:
        """Whether a place (2,) is on the path."""
        return bool((np.hypot(*(self.path_m - xy_m).T) < self.path_half_m).any())


def draw(rng: Rng, size_m: tuple[float, float], difficulty: float) -> Layout:
    """One forest; see `families.draw` for the arguments."""
    if min(size_m) < SMALLEST_M:
        raise BadInput(
            f"a forest of {size_m[0]:g} x {size_m[1]:g} m has no room for trees",
            f"Give at least {SMALLEST_M:g} m each way.",
        )
    half = np.array(size_m) / 2.0
    ground = hilly(rng, (half[0] + BEYOND_M, half[1] + BEYOND_M), float(np.interp(difficulty, *STEEPEST)))
    stand = _stand(rng, half)
    things, trunks = _plant(rng, ground, stand, half + 0.6 * BEYOND_M, difficulty)
    things += _strew(rng, ground, stand, half + 0.6 * BEYOND_M, difficulty, trunks)
    inner = half - EDGE_M
    region = np.array([[*-inner, ground.z_m.min()], [*inner, ground.z_m.max() + ABOVE_M]])
    return Layout([ground.block()], things, region)


def _stand(rng: Rng, half_m: Array) -> Stand:
    mixes = ((0.05, 0.05), (0.5, 0.08), (0.9, 0.05), (0.25, 0.2))  # beech wood, mixed, spruce, old
    conifers, gone = mixes[int(rng.integers(len(mixes)))]
    count = int(rng.integers(0, 4))
    radius = rng.uniform(0.1, 0.17, count) * float(half_m.min() * 2.0)
    at = rng.uniform(-0.75, 0.75, (count, 2)) * half_m
    path = np.zeros((0, 2))
    if rng.random() < 0.65:
        s = np.linspace(-1.0, 1.0, 160)
        bend, shift = rng.uniform(-0.3, 0.3, 2) * half_m.min()
        phase, yaw = rng.uniform(0.0, 2.0 * math.pi, 2)
        long = 1.5 * float(half_m.max())
        across = shift + bend * np.sin(2.5 * s + phase)
        c, d = math.cos(yaw), math.sin(yaw)
        path = np.column_stack([c * long * s - d * across, d * long * s + c * across])
    return Stand(
        conifers=conifers,
        dead=gone,
        thick_m=float(rng.uniform(0.18, 0.3)),
        clearings_m=np.column_stack([at, radius]),
        path_m=path,
        path_half_m=float(rng.uniform(0.8, 1.2)),
    )


def _plant(
    rng: Rng, ground: Ground, stand: Stand, half_m: Array, difficulty: float
) -> tuple[list[Mesh], Array]:
    """Trees by Poisson-disc spacing; also their places and radii (n, 3)."""
    wanted = round(float(np.interp(difficulty, (0.0, 1.0), TREES_PER_100M2)) * 4e-2 * float(half_m.prod()))
    places = rng.uniform(-1.0, 1.0, (40 * wanted, 2)) * half_m
    diameters = np.clip(stand.thick_m * rng.lognormal(0.0, 0.35, len(places)), *trees.TRUNK_M)
    kept = np.zeros((wanted, 3))
    n = 0
    for xy, diameter in zip(places, diameters, strict=True):
        off = kept[:n, :2] - xy
        reach = kept[:n, 2] + (0.5 * diameter + _GAP_M)
        if ((off * off).sum(axis=1) > reach * reach).all() and not stand.is_open(xy):
            kept[n] = *xy, 0.5 * diameter
            n += 1
        if n == wanted:
            break
    kept = kept[:n]
    foot = ground.height_m(kept[:, :2])
    lean = 0.02 + 0.06 * difficulty
    things = []
    for (x, y, radius), z, draw_ in zip(kept, foot, rng.random(n), strict=True):
        low = int(rng.binomial(3, 0.15 + 0.5 * difficulty))
        kind = trees.broadleaf
        if draw_ < stand.dead:
            kind = trees.dead
        elif draw_ < stand.dead + stand.conifers * (1.0 - stand.dead):
            kind = trees.conifer
        tree = kind(rng, 2.0 * float(radius), lean, low)
        things.append(tree.moved(float(x), float(y), float(z)))
    return things, kept


def _strew(
    rng: Rng, ground: Ground, stand: Stand, half_m: Array, difficulty: float, trunks: Array
) -> list[Mesh]:
    """Undergrowth off the path, most of it clear of the trunks."""
    things = []
    for thing, density in _LOW_PER_100M2.items():
        per_100m2 = max(float(np.interp(difficulty, (0.0, 1.0), density)), 0.0) * rng.uniform(0.7, 1.3)
        for xy in rng.uniform(-1.0, 1.0, (round(per_100m2 * 4e-2 * float(half_m.prod())), 2)) * half_m:
            near = np.hypot(*(trunks[:, :2] - xy).T) - trunks[:, 2]
            if not stand.on_path(xy) and (near > _LOW_GAP_M).all():
                things.append(thing(rng, ground, float(xy[0]), float(xy[1])))
    return things
