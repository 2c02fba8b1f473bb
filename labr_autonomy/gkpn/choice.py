"""Which of a network's paths is taken."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

MARGIN = 0.02  # paths whose mu is at most this above the lowest are as safe as the safest
AIR_TO_LAND = 10.0  # a metre flown costs about this many driven
AIR_HEIGHT_M = 0.25  # of a key point above the driving height, as `modes.decision` counts it


def chosen(points_m: NDArray[Any], mu: NDArray[Any], floor_m: NDArray[Any] | float) -> NDArray[np.int64]:
    """Number of the path that is cheapest among those about as safe as the safest, (b,).

    Args:
        points_m: (b, h, n, 3) key points, level frame.
        mu: (b, h) collision probabilities.
        floor_m: (b,) or one height at which the robot drives, level frame.
    """
    if points_m.shape[1] == 1:
        return np.zeros(len(points_m), np.int64)
    steps = np.diff(points_m, axis=2, prepend=0.0)
    length_m = np.linalg.norm(steps, axis=-1)
    flown = points_m[..., 2] > np.reshape(floor_m, (-1, 1, 1)) + AIR_HEIGHT_M
    price = (length_m * np.where(flown, AIR_TO_LAND, 1.0)).sum(axis=-1)
    price = np.where(mu <= mu.min(axis=1, keepdims=True) + MARGIN, price, np.inf)
    out: NDArray[np.int64] = price.argmin(axis=1)
    return out
