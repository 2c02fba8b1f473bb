"""Free convex neighbourhoods of a seed: four half-spaces at every fourth node, shared by its neighbours."""

from __future__ import annotations

import numpy as np

from labr_autonomy.refine.problem import FREE_OFFSET, PLANES
from labr_autonomy.refine.values import STEPS, DistanceField
from labr_autonomy.types import Array

EVERY = 4  # nodes that share a polytope
REACH_M = 1.4  # obstacle points farther from the node are not looked at
THIN_3D_M = 0.2  # down-sampling of 3D surface points; in 2D all are used


class Polytopes:
    """Half-spaces against the obstacle points of one map.

    Args:
        field: The map.
        aim_m: Distance that the body's centre should keep from obstacle faces [m].
    """

    def __init__(self, field: DistanceField, aim_m: float) -> None:
        self._aim_m = aim_m
        self._half_m = field.grain_m
        points = field.surface_points()
        if points.shape[1] == 3 and len(points):
            points = _thinned(points, THIN_3D_M)
            self._half_m = THIN_3D_M / 2.0
        self._points = points

    def planes(self, seed: Array) -> Array:
        """(STEPS, PLANES * (d + 1)) rows (n, b) for `n p + slack >= b` around the (STEPS + 1, d) seed."""
        d = seed.shape[1]
        nodes = np.arange(EVERY // 2, STEPS, EVERY)
        p = seed[nodes]
        out = np.zeros((len(nodes), PLANES * (d + 1)))
        out[:, d :: d + 1] = FREE_OFFSET
        near = self._points
        if len(near):
            near = near[((near > p.min(0) - REACH_M) & (near < p.max(0) + REACH_M)).all(axis=1)]
        if len(near):
            self._fill(out, p, near)
        return out[np.minimum(np.arange(STEPS) // EVERY, len(nodes) - 1)]

    def _fill(self, out: Array, p: Array, near: Array) -> None:
        d = p.shape[1]
        offset = near[None] - p[:, None]
        length = np.sqrt(np.einsum("ijk,ijk->ij", offset, offset))
        left = np.where(length < REACH_M, length, np.inf)
        row = np.arange(len(p))
        for m in range(PLANES):
            j = left.argmin(axis=1)
            nearest = left[row, j]
            found = np.isfinite(nearest)
            if not found.any():
                return
            normal = offset[row, j] / np.maximum(length[row, j], 1e-3)[:, None]
            room = nearest[found] - self._half_m - self._aim_m
            at = m * (d + 1)
            out[found, at : at + d] = -normal[found]
            out[found, at + d] = -room - np.einsum("ij,ij->i", normal[found], p[found])
            behind = np.einsum("ijk,ik->ij", offset, normal) >= (length[row, j] - 1e-6)[:, None]
            left[behind & found[:, None]] = np.inf


def _thinned(points: Array, pitch_m: float) -> Array:
    """One point of each cube of `pitch_m`."""
    cube = np.floor((points - points.min(axis=0)) / pitch_m).astype(np.int64)
    size = cube.max(axis=0) + 1
    key = (cube[:, 0] * size[1] + cube[:, 1]) * size[2] + cube[:, 2]
    _, first = np.unique(key, return_index=True)
    out: Array = points[first]
    return out
