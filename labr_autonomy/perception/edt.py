"""Exact Euclidean distance transform of small 3D grids, compiled.

Lower envelope of parabolas, one axis after another: P. Felzenszwalb and D. Huttenlocher, "Distance
Transforms of Sampled Functions" (2012). Lines that are all sources or all empty are passed over.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Bits = NDArray[np.bool_]
FAR = 1e9  # squared distance where the grid has no source

_compiled: Callable[[Any], Any] = njit(cache=True, nogil=True, boundscheck=False)


@_compiled
def _along(f: Any, n: int, place: Any, start: Any, out: Any) -> bool:
    """Lower envelope of `f[i] + (x - i)^2` at every x of a line; False when nothing changes."""
    least, most = f[0], f[0]
    for i in range(1, n):
        least, most = min(least, f[i]), max(most, f[i])
    if most == least:
        return False
    k = -1
    for i in range(n):
        if f[i] >= FAR:
            continue
        while k >= 0:
            j = place[k]
            cut = ((f[i] + i * i) - (f[j] + j * j)) / (2.0 * (i - j))
            if cut > start[k]:
                break
            k -= 1
        k += 1
        place[k] = i
        start[k] = -FAR if k == 0 else cut
    top = k
    k = 0
    for x in range(n):
        while k < top and start[k + 1] < x:
            k += 1
        j = place[k]
        out[x] = (x - j) * (x - j) + f[j]
    return True


@_compiled
def _last_axis(source: Any, wanted: bool, d: Any) -> None:
    """Squared distances within the lines along the last axis, from `source` into `d`."""
    nx, ny, nz = source.shape
    f, out, start, place = np.empty(nz), np.empty(nz), np.empty(nz), np.empty(nz, np.int64)
    for x in range(nx):
        for y in range(ny):
            for z in range(nz):
                f[z] = 0.0 if source[x, y, z] == wanted else FAR
            changed = _along(f, nz, place, start, out)
            for z in range(nz):
                d[x, y, z] = out[z] if changed else f[z]


@_compiled
def _middle_axis(d: Any) -> None:
    """Lower envelopes along the middle axis, in place."""
    nx, ny, nz = d.shape
    f, out, start, place = np.empty(ny), np.empty(ny), np.empty(ny), np.empty(ny, np.int64)
    for x in range(nx):
        for z in range(nz):
            for y in range(ny):
                f[y] = d[x, y, z]
            if _along(f, ny, place, start, out):
                for y in range(ny):
                    d[x, y, z] = out[y]


def distance_to(source: Bits, wanted: bool) -> NDArray[np.float32]:
    """Distance in cells from every cell's centre to the nearest cell centre where `source` is `wanted`.

    Args:
        source: (nx, ny, nz) bool.
        wanted: Which value counts as a source; there must be one.
    """
    squared = np.empty(source.shape, np.float32)
    _last_axis(np.ascontiguousarray(source), wanted, squared)
    _middle_axis(squared)
    _middle_axis(squared.transpose(1, 0, 2))
    return np.sqrt(squared, out=squared)
