"""The cubic spline through the key points, as a constant matrix: points = matrix @ [0; key points].

Cubic Hermite with finite-difference tangents on uniform knots, the interpolation of iPlanner (RSS 2023):
local and C1. It serves the losses and the pictures; in flight only the key points leave the network.
"""

from __future__ import annotations

import functools

import numpy as np

from labr_autonomy.types import Array

KEY_POINTS = 5  # n of the paper
PER_SEGMENT = 10  # m of the paper


@functools.cache
def spline_matrix(key_points: int = KEY_POINTS, per_segment: int = PER_SEGMENT) -> Array:
    """Weights (m*n + 1, n + 1) of the robot's own place and the n key points at each point of the path."""
    knots = key_points + 1
    tangent = np.zeros((knots, knots))
    inner = np.arange(1, knots - 1)
    tangent[inner, inner + 1], tangent[inner, inner - 1] = 0.5, -0.5
    tangent[0, :2] = tangent[-1, -2:] = (-1.0, 1.0)
    u = np.linspace(0.0, key_points, key_points * per_segment + 1)
    i = np.minimum(u.astype(int), key_points - 1)
    t = (u - i)[:, None]
    eye = np.eye(knots)
    out: Array = (
        (1 - 3 * t**2 + 2 * t**3) * eye[i]
        + (t - 2 * t**2 + t**3) * tangent[i]
        + (3 * t**2 - 2 * t**3) * eye[i + 1]
        + (t**3 - t**2) * tangent[i + 1]
    )
    out.flags.writeable = False
    return out


def path_points(key_points_m: Array) -> Array:
    """Points (51, 3) of the path from the origin through (5, 3) key points, in the key points' frame."""
    knots = np.concatenate([np.zeros((1, 3)), key_points_m])
    out: Array = spline_matrix(len(key_points_m)) @ knots
    return out
