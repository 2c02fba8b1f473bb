"""Grids that follow the robot by whole cells."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def moved(values: NDArray[Any], by: NDArray[np.int64], new: int) -> NDArray[Any]:
    """The contents of a grid whose corner moves by whole cells along each axis; `new` is what comes in."""
    out = np.full_like(values, new)
    if all(abs(int(d)) < n for d, n in zip(by, values.shape, strict=True)):
        source = tuple(
            slice(max(0, int(d)), n + min(0, int(d))) for d, n in zip(by, values.shape, strict=True)
        )
        target = tuple(
            slice(max(0, -int(d)), n - max(0, int(d))) for d, n in zip(by, values.shape, strict=True)
        )
        out[target] = values[source]
    return out
