"""Compiled look at the map's columns: what stands between two heights, what was seen, what may go on."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.perception.compiled import compiled

Bits = NDArray[np.bool_]


@compiled
def _look(log_odds: Any, low: int, high: int, solid: int, occupied: Any, known: Any) -> None:
    nx, ny, _ = log_odds.shape
    for i in range(nx):
        for j in range(ny):
            hit, free = False, 0
            for k in range(low, high):
                value = log_odds[i, j, k]
                hit |= value >= solid
                free += value < 0
            occupied[i, j] = hit
            known[i, j] = hit or (log_odds[i, j, low] < 0 and 2 * free > high - low)


def columns(log_odds: NDArray[np.int8], low: int, high: int, solid: int) -> tuple[Bits, Bits]:
    """What stands between two layers, and what is known of it.

    Args:
        log_odds: (nx, ny, nz) cells, below 0 where they were seen through.
        low: First layer.
        high: One beyond the last layer.
        solid: From which log-odds on a cell is believed solid.

    Returns:
        (nx, ny) columns with a solid cell, and (nx, ny) columns that are known: those, and where the lowest
        layer and most of the others were seen through.
    """
    shape = log_odds.shape[:2]
    occupied, known = np.empty(shape, np.bool_), np.empty(shape, np.bool_)
    _look(log_odds, low, high, solid, occupied, known)
    return occupied, known


@compiled
def _unended(log_odds: Any, low: int, high: int, solid: int, out: Any) -> None:
    nx, ny, _ = log_odds.shape
    for i in range(nx):
        for j in range(ny):
            k = high - 1
            while k >= low and 0 <= log_odds[i, j, k] < solid:
                k -= 1
            out[i, j] = k >= low and log_odds[i, j, k] >= solid


def unended(log_odds: NDArray[np.int8], low: int, high: int, solid: int) -> Bits:
    """Columns (nx, ny) of which the highest cell that was seen between two layers is solid.

    Args:
        log_odds: As for `columns`.
        low: As for `columns`.
        high: As for `columns`.
        solid: As for `columns`.
    """
    out = np.empty(log_odds.shape[:2], np.bool_)
    _unended(log_odds, low, high, solid, out)
    return out
