"""What stands about in a parking garage besides cars: cones, trolleys, barriers, posts, kerbs, stops."""

from __future__ import annotations

import numpy as np

from sim.worlds.families.layout import Rng
from sim.worlds.meshes import Mesh, box, hull_of_rings, merged, tube

KERB_M = (0.05, 0.12)  # heights; the wheels climb 0.04


def _upright(x_m: float, y_m: float, low_m: float, high_m: float, radius_m: float, sides: int = 6) -> Mesh:
    return tube(np.array([[x_m, y_m, low_m], [x_m, y_m, high_m]]), [radius_m, radius_m], sides)


def cone(rng: Rng) -> Mesh:
    """A traffic cone."""
    tall = float(rng.uniform(0.5, 0.75))
    body = tube(np.array([[0.0, 0.0, 0.02], [0.0, 0.0, tall]]), [0.13, 0.03], 9)
    return merged([box((0.0, 0.0, 0.02), (0.18, 0.18, 0.02)), body])


def trolley(rng: Rng) -> Mesh:
    """A shopping trolley: basket, frame, handle, castors."""
    tall = float(rng.uniform(0.95, 1.02))
    rings = [
        np.array([[-a, -w, z], [b, -w, z], [b, w, z], [-a, w, z]])
        for a, b, w, z in ((0.32, 0.36, 0.2, 0.5), (0.42, 0.48, 0.27, tall - 0.1))
    ]
    parts = [hull_of_rings(rings), box((0.0, 0.0, 0.2), (0.42, 0.22, 0.02))]
    for y in (-0.2, 0.2):
        parts.append(tube(np.array([[-0.36, y, 0.2], [-0.36, y, 0.6], [-0.52, y, tall]]), [0.015] * 3, 5))
        parts += [_upright(x, y, 0.0, 0.2, 0.04) for x in (-0.38, 0.38)]
    parts.append(tube(np.array([[-0.52, -0.26, tall], [-0.52, 0.26, tall]]), [0.02, 0.02], 6))
    return merged(parts)


def barrier_board(rng: Rng) -> Mesh:
    """A works barrier: two boards on two feet, along y."""
    half = float(rng.uniform(0.6, 1.0))
    parts = [box((0.0, 0.0, z), (0.02, half, 0.1)) for z in (0.45, 0.9)]
    for y in (-half + 0.12, half - 0.12):
        parts += [box((0.0, y, 0.52), (0.035, 0.035, 0.5)), box((0.0, y, 0.03), (0.3, 0.06, 0.03))]
    return merged(parts)


def boom(rng: Rng, reach_m: float) -> Mesh:
    """An entrance: a cabinet with a lowered boom along y, and a ticket post on a kerbed island."""
    kerb = float(rng.uniform(*KERB_M))
    arm = float(rng.uniform(0.85, 1.0))
    return merged(
        [
            box((0.0, 0.0, 0.5 * kerb), (1.1, 0.35, 0.5 * kerb)),
            box((0.3, 0.0, 0.55), (0.16, 0.14, 0.55)),
            tube(np.array([[0.5, -0.2, arm], [0.5, reach_m, arm]]), [0.045, 0.03], 7),
            ticket_post().moved(-0.7, 0.0),
        ]
    )


def ticket_post() -> Mesh:
    """A ticket machine on a foot."""
    return merged([_upright(0.0, 0.0, 0.0, 0.9, 0.07, 8), box((0.0, 0.0, 1.1), (0.17, 0.15, 0.25))])


def bollard(rng: Rng) -> Mesh:
    """A post that keeps cars off."""
    return _upright(0.0, 0.0, 0.0, float(rng.uniform(0.8, 1.0)), 0.06, 8)


def pallet(rng: Rng) -> Mesh:
    """A pallet with boxes."""
    parts = [box((0.0, 0.0, 0.07), (0.6, 0.4, 0.07))]
    z = 0.14
    for _ in range(int(rng.integers(1, 4))):
        half = rng.uniform((0.25, 0.2, 0.1), (0.5, 0.36, 0.25))
        parts.append(box((0.0, 0.0, z + half[2] - 0.005), half.tolist(), float(rng.uniform(-0.2, 0.2))))
        z += 2.0 * float(half[2]) - 0.01
    return merged(parts)


def kerb(rng: Rng, half_x_m: float, half_y_m: float) -> Mesh:
    """A kerbed island with bevelled edges."""
    tall = float(rng.uniform(*KERB_M))
    rings = [
        np.array([[-a, -b, z], [a, -b, z], [a, b, z], [-a, b, z]])
        for a, b, z in (
            (half_x_m, half_y_m, -0.02),
            (half_x_m, half_y_m, 0.7 * tall),
            (half_x_m - 0.03, half_y_m - 0.03, tall),
        )
    ]
    return hull_of_rings(rings)


def wheel_stop(yaw_rad: float) -> Mesh:
    """A bar at the end of a bay, for a bay along `yaw_rad`."""
    rings = [
        np.array([[-a, -0.8, z], [a, -0.8, z], [a, 0.8, z], [-a, 0.8, z]])
        for a, z in ((0.075, 0.0), (0.045, 0.1))
    ]
    return hull_of_rings(rings).moved(0.0, 0.0, 0.0, yaw_rad)
