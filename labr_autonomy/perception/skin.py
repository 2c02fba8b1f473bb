"""Compiled search for the cells of solids that have a face towards a cell that is not solid."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.perception.compiled import compiled


@compiled
def _cells(distance: Any, out: Any) -> int:
    """Write the indices of the skin's cells into `out`; what lies beyond the border counts as solid."""
    nx, ny, nz = distance.shape
    count = 0
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                if distance[i, j, k] >= 0.0:
                    continue
                buried = (i == 0 or distance[i - 1, j, k] < 0.0) and (
                    i == nx - 1 or distance[i + 1, j, k] < 0.0
                )
                buried &= (j == 0 or distance[i, j - 1, k] < 0.0) and (
                    j == ny - 1 or distance[i, j + 1, k] < 0.0
                )
                buried &= (k == 0 or distance[i, j, k - 1] < 0.0) and (
                    k == nz - 1 or distance[i, j, k + 1] < 0.0
                )
                if not buried:
                    out[count, 0], out[count, 1], out[count, 2] = i, j, k
                    count += 1
    return count


def skin(distance: NDArray[np.float32]) -> NDArray[np.int32]:
    """Indices (m, 2|3) of the skin's cells of a signed distance (nx, ny[, nz]), below 0 in solids."""
    boxed = distance if distance.ndim == 3 else distance[:, :, None]
    out = np.empty((boxed.size, 3), np.int32)
    count = _cells(boxed, out)
    return out[:count, : distance.ndim]
