"""Distance to points, one in each marked cell of a plan, compiled.

Like `edt`, but the sources lie anywhere in their cells. Along the rows the nearer of the two neighbouring
sources is taken, along the columns the lower envelope of parabolas whose vertices are the sources' own
places. A source that is nearest only by its place across the row is missed: an error of a few per cent of a
cell, beside the half cell that counting whole cells as solid costs.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.perception.compiled import compiled

FAR = 1e9  # squared distance where there is no source
SPOT = 200.0  # units of a spot in one cell's edge


@compiled
def _rows(source: Any, spots: Any, squared: Any, across: Any) -> None:
    """Squared distance to the nearest source of the same row, and where across the row it lies."""
    nx, ny = source.shape
    for x in range(nx):
        for sweep in range(2):
            found = False
            at, aside = 0.0, 0.0
            for step in range(ny):
                y = step if sweep == 0 else ny - 1 - step
                if source[x, y]:
                    found = True
                    at, aside = y + spots[x, y, 1] / SPOT, spots[x, y, 0] / SPOT
                if found:
                    away = (y - at) * (y - at)
                    if sweep == 0 or away < squared[x, y]:
                        squared[x, y], across[x, y] = away, aside
                elif sweep == 0:
                    squared[x, y] = FAR


@compiled
def _columns(squared: Any, across: Any) -> None:
    """Lower envelopes along the columns; `squared` becomes the distance."""
    nx, ny = squared.shape
    place, height, start = np.empty(nx), np.empty(nx), np.empty(nx + 1)
    for y in range(ny):
        k = -1
        for x in range(nx):
            here = squared[x, y]
            if here >= FAR:
                continue
            vertex = x + across[x, y]
            cut = -FAR
            while k >= 0:
                gap = max(vertex - place[k], 1e-6)
                cut = 0.5 * ((here - height[k]) / gap + vertex + place[k])
                if cut > start[k]:
                    break
                k -= 1
            k += 1
            place[k], height[k] = vertex, here
            start[k] = -FAR if k == 0 else cut
        if k < 0:
            for x in range(nx):
                squared[x, y] = math.sqrt(FAR)
            continue
        start[k + 1] = FAR
        k = 0
        for x in range(nx):
            while start[k + 1] < x:
                k += 1
            away = x - place[k]
            squared[x, y] = math.sqrt(away * away + height[k])


def distance_to_points(source: NDArray[np.bool_], spots: NDArray[np.int8]) -> NDArray[np.float32]:
    """Distance in cells from every cell's centre to the nearest point.

    Args:
        source: (nx, ny) which cells hold a point; there must be one.
        spots: (nx, ny, 2) where in its cell it lies, in units of a cell's edge / `SPOT` from the centre.
    """
    squared, across = np.empty(source.shape, np.float32), np.zeros(source.shape, np.float32)
    _rows(source, spots, squared, across)
    _columns(squared, across)
    return squared
