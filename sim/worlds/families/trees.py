"""Trees that stand on the origin: broadleaf, conifer and dead ones, each one mesh of closed parts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from labr_autonomy.types import Array
from sim.worlds.families.growth import blobs, cones, sticks
from sim.worlds.families.layout import Rng
from sim.worlds.meshes import Mesh, merged

ROOT_M = 0.35  # how deep a trunk goes into the ground, so that none floats on a slope
CROWN_M = 2.5  # leaf masses of broadleaf trees begin above this
TRUNK_M = (0.10, 0.45)  # diameters at breast height
_FLARE = np.array([1.55, 1.4, 1.05, 1.0])  # radius at _FLARE_AT_M over that at breast height
_FLARE_AT_M = np.array([-ROOT_M, 0.0, 0.4, 1.3])


@dataclass(frozen=True, slots=True)
class Trunk:
    """A trunk as points and radii from root to top."""

    points_m: Array  # (k, 3)
    radii_m: Array  # (k,)

    def at(self, height_m: Array) -> tuple[Array, Array]:
        """Points (n, 3) and radii (n,) of the trunk at heights (n,)."""
        z = self.points_m[:, 2]
        point = [np.interp(height_m, z, self.points_m[:, axis]) for axis in (0, 1)]
        return np.column_stack([*point, height_m]), np.interp(height_m, z, self.radii_m)

    def mesh(self, sides: int = 7) -> Mesh:
        """The trunk alone."""
        return sticks(self.points_m[None], self.radii_m[None], sides)


def trunk(rng: Rng, diameter_m: float, top_m: float, lean: float) -> Trunk:
    """A leaning, slightly bent, tapering trunk, flared at the root.

    Args:
        rng: Random numbers.
        diameter_m: At breast height, 1.3 m.
        top_m: Height of its end.
        lean: Largest horizontal shift per height.
    """
    z = np.array([*_FLARE_AT_M, 1.3 + 0.5 * (top_m - 1.3), top_m])
    heading, bend = rng.uniform(0.0, 2.0 * math.pi, 2)
    shift = rng.uniform(0.2, 1.0) * lean * z
    sway = 0.25 * lean * top_m * np.sin(math.pi * np.clip(z, 0.0, None) / top_m)
    xy = [shift * f(heading) + sway * f(bend) for f in (math.cos, math.sin)]
    radii = 0.5 * diameter_m * np.array([*_FLARE, 0.7, 0.25])
    return Trunk(np.column_stack([*xy, z]), radii)


def branches(rng: Rng, stem: Trunk, low_m: float, high_m: float, count: int, length_m: float) -> Mesh:
    """Tapered branches that leave the trunk between two heights, slightly rising, bent upwards."""
    foot, thick = stem.at(rng.uniform(low_m, high_m, count))
    heading = rng.uniform(0.0, 2.0 * math.pi, count)
    reach = length_m * rng.uniform(0.55, 1.0, count)
    rise = rng.uniform(0.0, 0.55, count)
    out = np.column_stack([np.cos(heading), np.sin(heading), rise])
    middle = foot + out * (0.5 * reach)[:, None]
    tip = foot + out * reach[:, None] + np.column_stack([np.zeros((count, 2)), 0.2 * reach])
    base = np.minimum(0.45 * thick, 0.012 + 0.028 * reach)
    radii = np.stack([base, 0.7 * base, 0.25 * base], axis=1)
    return sticks(np.stack([foot, middle, tip], axis=1), radii, 4)


def broadleaf(rng: Rng, diameter_m: float, lean: float, low_branches: int) -> Mesh:
    """A trunk, some low branches, and a crown of two or three leaf masses above `CROWN_M`."""
    top = 3.6 + 8.0 * diameter_m + rng.uniform(0.0, 1.2)
    stem = trunk(rng, diameter_m, top, lean)
    wide = 0.75 + 2.2 * diameter_m * rng.uniform(0.8, 1.2)
    count = int(rng.integers(2, 4))
    half = wide * np.column_stack([rng.uniform(0.7, 1.0, (count, 2)), rng.uniform(0.55, 0.8, count)])
    centre, _ = stem.at(np.linspace(top, CROWN_M + 0.3 * (top - CROWN_M), count))
    centre[:, :2] += rng.uniform(-0.45, 0.45, (count, 2)) * wide
    crown = blobs(rng, centre, half, rough=0.16, sides=6)
    crown.vertices_m[:, 2] = np.maximum(crown.vertices_m[:, 2], CROWN_M + rng.uniform(0.0, 0.2))
    parts = [stem.mesh(), crown, branches(rng, stem, 2.0, CROWN_M + 0.3, 1, 0.9 * wide)]
    if low_branches:
        parts.append(branches(rng, stem, 0.5, 2.0, low_branches, 0.5 + 2.0 * diameter_m))
    return merged(parts)


def conifer(rng: Rng, diameter_m: float, lean: float, low_branches: int) -> Mesh:
    """A straight trunk in tiers of cones: skirted from 0.6 to 1 m, or bare below with dead twigs."""
    top = 4.0 + 13.0 * diameter_m + rng.uniform(0.0, 1.0)
    stem = trunk(rng, diameter_m, top - 0.4, 0.5 * lean)
    skirted = rng.random() < 0.4
    low = rng.uniform(0.6, 1.0) if skirted else rng.uniform(1.7, 2.6)
    tiers = 4 if top > 5.5 else 3
    start = np.linspace(low, top - 1.0, tiers)
    radius = (0.65 + 1.8 * diameter_m) * np.linspace(1.0, 0.45, tiers) * rng.uniform(0.9, 1.1, tiers)
    foot, _ = stem.at(start)
    tip, _ = stem.at(np.minimum(start + 1.9 * (top - low) / tiers, top))
    tip[:, 2] = np.minimum(start + 1.9 * (top - low) / tiers, top)
    parts = [stem.mesh(6), cones(rng, foot, tip, radius)]
    if low_branches and not skirted:
        parts.append(branches(rng, stem, 0.5, 1.7, low_branches + 1, 0.6))
    return merged(parts)


def dead(rng: Rng, diameter_m: float, lean: float, low_branches: int) -> Mesh:
    """A broken trunk with bare branches."""
    top = rng.uniform(2.2, 4.5)
    stem = trunk(rng, diameter_m, top, 1.6 * lean)
    blunt = Trunk(stem.points_m, np.maximum(stem.radii_m, 0.3 * diameter_m))
    return merged([blunt.mesh(6), branches(rng, blunt, 0.7, top - 0.2, 3 + low_branches, 1.0)])
