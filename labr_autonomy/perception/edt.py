"""Exact Euclidean distance transform of small 2D and 3D grids, compiled.

Lower envelope of parabolas, one axis after another: P. Felzenszwalb and D. Huttenlocher, "Distance
Transforms of Sampled Functions" (2012). Along the first axis two sweeps do; lines that are all sources or
all empty are passed over. Squares of distances are whole numbers, so every run gets the same bits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.perception.compiled import compiled

Bits = NDArray[np.bool_]
FAR = 1e9  # squared distance where the grid has no source


@compiled
def _last_axis(source: Any, wanted: bool, d: Any) -> None:
    """Squared distances within the lines along the last axis, from `source` into `d`."""
    nx, ny, nz = source.shape
    for x in range(nx):
        for y in range(ny):
            away = -1.0  # no source yet
            for z in range(nz):
                if source[x, y, z] == wanted:
                    away = 0.0
                elif away >= 0.0:
                    away += 1.0
                d[x, y, z] = away * away if away >= 0.0 else FAR
            away = -1.0
            for z in range(nz - 1, -1, -1):
                if d[x, y, z] == 0.0:
                    away = 0.0
                elif away >= 0.0:
                    away += 1.0
                    d[x, y, z] = min(d[x, y, z], away * away)


@compiled
def _envelope(f: Any, n: int, halves: Any, place: Any, height: Any, start: Any) -> int:
    """Parabolas of the lower envelope of `f[i] + (x - i)^2`; returns the last one's number."""
    k = -1
    cut = -FAR
    for i in range(n):
        if f[i] >= FAR:
            continue
        rise = f[i] + i * i
        while k >= 0:
            cut = (rise - height[k]) * halves[i - place[k]]
            if cut > start[k]:
                break
            k -= 1
        k += 1
        place[k], height[k] = i, rise
        start[k] = -FAR if k == 0 else cut
    start[k + 1] = FAR
    return k


@compiled
def _middle_axis(d: Any) -> None:
    """Lower envelopes along the middle axis, in place."""
    nx, ny, nz = d.shape
    f, height, start = np.empty(ny), np.empty(ny), np.empty(ny + 1)
    place = np.empty(ny, np.int64)
    halves = np.zeros(ny + 1)
    for i in range(1, ny + 1):
        halves[i] = 0.5 / i
    for x in range(nx):
        for z in range(nz):
            least = most = d[x, 0, z]
            for y in range(ny):
                f[y] = d[x, y, z]
                least, most = min(least, f[y]), max(most, f[y])
            if most == least:  # all sources, or none
                continue
            _envelope(f, ny, halves, place, height, start)
            k = 0
            for y in range(ny):
                while start[k + 1] < y:
                    k += 1
                away = y - place[k]
                d[x, y, z] = away * away + f[place[k]]


def distance_to(source: Bits, wanted: bool) -> NDArray[np.float32]:
    """Distance in cells from every cell's centre to the nearest cell centre where `source` is `wanted`.

    Args:
        source: (nx, ny) or (nx, ny, nz) bool.
        wanted: Which value counts as a source; there must be one.
    """
    squared = np.empty(source.shape, np.float32)
    solid = source if source.ndim == 3 else source[None]
    boxed = squared if source.ndim == 3 else squared[None]
    _last_axis(np.ascontiguousarray(solid), wanted, boxed)
    _middle_axis(boxed)
    if source.ndim == 3:
        _middle_axis(boxed.transpose(1, 0, 2))
    return np.sqrt(squared, out=squared)
