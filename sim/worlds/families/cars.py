"""Parked vehicles: body, cabin, wheels, mirrors. Nose along x, on the floor z = 0, each part closed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from labr_autonomy.types import Array
from sim.worlds.families.growth import sticks
from sim.worlds.families.layout import Rng
from sim.worlds.meshes import Mesh, box, hull_of_rings, merged

_SEAM_M = 1e-3  # between body and cabin: rays that count surfaces see both faces
UNDERSIDE_M = (0.15, 0.20)  # ground clearance of the body; the robot is 0.26 m high


@dataclass(frozen=True, slots=True)
class Shape:
    """A kind of vehicle. Stations run from tail to nose; x in lengths, heights in metres."""

    length_m: tuple[float, float]
    width_m: tuple[float, float]  # without mirrors
    roof_m: tuple[float, float]
    body: tuple[tuple[float, float, float], ...]  # x, height of the body there, width in widths
    cabin: (
        tuple[float, float, float, float] | None
    )  # x of its foot (rear, front) and of its roof (rear, front)


SHAPES = {
    "saloon": Shape(
        (4.35, 4.7),
        (1.76, 1.85),
        (1.42, 1.48),
        (
            (-0.5, 0.8, 0.84), (-0.46, 0.95, 0.94), (-0.2, 0.95, 1.0),
            (0.22, 0.95, 1.0), (0.43, 0.8, 0.94), (0.5, 0.6, 0.78),
        ),
        (-0.36, 0.22, -0.22, 0.06),
    ),
    "small": Shape(
        (3.5, 3.9),
        (1.60, 1.70),
        (1.46, 1.54),
        (
            (-0.5, 0.75, 0.86), (-0.47, 0.95, 0.95), (-0.2, 0.95, 1.0),
            (0.28, 0.95, 1.0), (0.44, 0.82, 0.94), (0.5, 0.6, 0.8),
        ),
        (-0.47, 0.28, -0.4, 0.1),
    ),
    "high": Shape(
        (4.2, 4.6),
        (1.80, 1.88),
        (1.62, 1.72),
        (
            (-0.5, 0.85, 0.88), (-0.47, 1.06, 0.96), (-0.2, 1.06, 1.0),
            (0.24, 1.06, 1.0), (0.44, 0.95, 0.96), (0.5, 0.7, 0.84),
        ),
        (-0.47, 0.24, -0.4, 0.08),
    ),
    "van": Shape(
        (4.5, 4.8),
        (1.86, 1.93),
        (1.85, 2.0),
        (
            (-0.5, 1.8, 0.92), (-0.48, 1.95, 0.97), (0.12, 1.95, 0.97),
            (0.3, 1.15, 1.0), (0.46, 0.95, 0.96), (0.5, 0.65, 0.86),
        ),
        None,
    ),
}  # fmt: skip
KINDS = ("saloon", "small", "high", "van")
SHARES = (0.35, 0.3, 0.22, 0.13)  # of the kinds


def _section(x_m: float, half_m: float, low_m: float, high_m: float, bevel_m: float) -> Array:
    """A rectangle across x with its corners cut, (8, 3), counter-clockwise seen from the nose."""
    w, c = half_m, min(bevel_m, 0.3 * (high_m - low_m))
    yz = [
        (c - w, low_m), (w - c, low_m), (w, low_m + c), (w, high_m - c),
        (w - c, high_m), (c - w, high_m), (-w, high_m - c), (-w, low_m + c),
    ]  # fmt: skip
    return np.array([(x_m, y, z) for y, z in yz])


def _layer(rear_m: float, front_m: float, half_m: float, z_m: float) -> Array:
    """A level rectangle with its corners cut, (8, 3), counter-clockwise from above."""
    w, c = half_m, 0.12
    xy = [
        (rear_m + c, -w), (front_m - c, -w), (front_m, c - w), (front_m, w - c),
        (front_m - c, w), (rear_m + c, w), (rear_m, w - c), (rear_m, c - w),
    ]  # fmt: skip
    return np.array([(x, y, z_m) for x, y in xy])


def car(rng: Rng, kind: str) -> tuple[Mesh, float, float]:
    """One vehicle of a kind in `SHAPES`; also its length and its width without mirrors [m]."""
    shape = SHAPES[kind]
    length, width, roof = (float(rng.uniform(*r)) for r in (shape.length_m, shape.width_m, shape.roof_m))
    low = float(rng.uniform(*UNDERSIDE_M))
    half = 0.5 * width
    tall = roof / 1.95 if shape.cabin is None else 1.0
    rings = []
    for number, (x, top, wide) in enumerate(shape.body):
        bumper = 0.12 if number in (0, len(shape.body) - 1) else 0.0
        rings.append(_section(x * length, wide * half, low + bumper, top * (tall if top > 1.5 else 1.0), 0.1))
    parts = [hull_of_rings(rings)]
    belt = max(top for _, top, _ in shape.body if top < 1.5)
    if shape.cabin is not None:
        foot_rear, foot_front, top_rear, top_front = (x * length for x in shape.cabin)
        parts.append(
            hull_of_rings(
                [
                    _layer(foot_rear, foot_front, 0.88 * half, belt + _SEAM_M),
                    _layer(top_rear - 0.08, top_front + 0.12, 0.8 * half, roof - 0.1),
                    _layer(top_rear + 0.05, top_front - 0.1, 0.68 * half, roof),
                ]
            )
        )
    parts.append(_wheels(length, half, 0.30 if kind == "small" else 0.32))
    mirror = (0.07, 0.09, 0.07)
    parts += [box((0.2 * length, side * (half + 0.06), belt + 0.02), mirror) for side in (-1.0, 1.0)]
    return merged(parts), length, width


def _wheels(length_m: float, half_m: float, radius_m: float) -> Mesh:
    """Four wheels that show a little outside the body."""
    y = half_m - 0.09
    points = np.array(
        [
            [[along * length_m, side * y + d, radius_m] for d in (-0.105, 0.105)]
            for along in (-0.31, 0.31)
            for side in (-1.0, 1.0)
        ]
    )
    return sticks(points, np.full((4, 2), radius_m), 10)
