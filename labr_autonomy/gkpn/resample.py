"""A depth image of any pinhole camera as the network's camera would see it (160x90, 90 x 59 degrees).

Area resampling: each network pixel is the mean of the valid depths in the rectangle it covers of the
source image. Invalid pixels (0, not finite, out of range) take no part; what the source does not see is 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.types import Array, Image, Intrinsics

WIDTH, HEIGHT = 160, 90
FX, FY, CX, CY = 80.0, 79.5, 80.0, 45.0  # the D435i at 424x240 (config.Camera) resized to 160x90 [px]
RANGE_M = 10.0
VALID_SHARE = 0.25  # of a network pixel's area that must be valid


def _edges(out: int, out_focal: float, out_centre: float, focal_px: float, centre_px: float) -> Array:
    """Borders (out + 1,) of the network's pixels in the source image [px]."""
    edges: Array = (np.arange(out + 1, dtype=np.float64) - out_centre) * (focal_px / out_focal) + centre_px
    return edges


def _sums(image: Array, edges: Array) -> Array:
    """Integrals (out, k) over the strips between edges along the first axis of (n, k); 0 outside.

    Running sums and no matrix product: BLAS would wake its threads for this, which costs more than it saves.
    """
    running = np.zeros((len(image) + 1, image.shape[1]))
    np.cumsum(image, axis=0, out=running[1:])
    at = np.clip(edges, 0.0, len(image))
    low = np.minimum(at.astype(int), len(image) - 1)
    share = (at - low)[:, None]
    values: Array = np.diff(running[low] * (1.0 - share) + running[low + 1] * share, axis=0)
    return values


def network_image(depth_m: Image, intrinsics: Intrinsics) -> NDArray[np.float32]:
    """Depth (h, w) [m] to (90, 160) [m], 0 = invalid."""
    h, w = depth_m.shape
    # An image of another size than its intrinsics say is the same view, scaled.
    sx, sy = w / intrinsics.width, h / intrinsics.height
    columns = _edges(WIDTH, FX, CX, intrinsics.fx * sx, intrinsics.cx * sx)
    rows = _edges(HEIGHT, FY, CY, intrinsics.fy * sy, intrinsics.cy * sy)
    depth = np.asarray(depth_m, dtype=np.float32)
    valid = (depth > 0.0) & (depth <= RANGE_M)  # False for nan
    total = _sums(_sums(np.where(valid, depth, np.float32(0.0)), rows).T, columns).T
    area = _sums(_sums(valid.astype(np.float32), rows).T, columns).T
    enough = area >= VALID_SHARE * np.outer(np.diff(rows), np.diff(columns))
    out: NDArray[np.float32] = np.where(enough, total / np.maximum(area, 1e-6), 0.0).astype(np.float32)
    return out
