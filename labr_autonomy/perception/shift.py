"""Grids that follow the robot by whole cells."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def moved(values: NDArray[Any], by: NDArray[np.int64], new: float) -> NDArray[Any]:
    """The contents of a grid whose corner moves by whole cells along its first axes; `new` comes in."""
    out = np.full_like(values, new)
    moves = [(int(d), n) for d, n in zip(by, values.shape, strict=False)]
    if all(abs(d) < n for d, n in moves):
        source = tuple(slice(max(0, d), n + min(0, d)) for d, n in moves)
        target = tuple(slice(max(0, -d), n - max(0, d)) for d, n in moves)
        out[target] = values[source]
    return out
