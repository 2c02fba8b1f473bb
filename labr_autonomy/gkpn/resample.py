"""A depth image of any pinhole camera as the network's camera would see it (GKPN: 160x90, 90 x 59 degrees).

Area resampling: each network pixel is the mean of the valid depths in the rectangle it covers of the
source image. Invalid pixels (0, not finite, out of range) take no part; what the source does not see is 0.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from labr_autonomy.types import Array, Image, Intrinsics

WIDTH, HEIGHT = 160, 90
FX, FY, CX, CY = 80.0, 79.5, 80.0, 45.0  # the D435i at 424x240 (config.Camera) resized to 160x90 [px]
RANGE_M = 10.0
VALID_SHARE = 0.25  # of a network pixel's area that must be valid


def _edges(out: int, out_focal: float, out_centre: float, focal_px: float, centre_px: float) -> Array:
    """Borders (out + 1,) of the network's pixels in the source image [px]."""
    edges: Array = (np.arange(out + 1, dtype=np.float64) - out_centre) * (focal_px / out_focal) + centre_px
    return edges


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _means(depth_m: Image, rows: Array, columns: Array, range_m: float, least: float) -> Image:
    """Mean of the valid depths in each rectangle between the borders; 0 where too few are valid."""
    h, w = depth_m.shape
    out = np.zeros((len(rows) - 1, len(columns) - 1), np.float32)
    for i in range(len(rows) - 1):
        top, bottom = max(rows[i], 0.0), min(rows[i + 1], float(h))
        for j in range(len(columns) - 1):
            left, right = max(columns[j], 0.0), min(columns[j + 1], float(w))
            total = area = 0.0
            for v in range(int(top), math.ceil(bottom)):
                tall = min(bottom, v + 1.0) - max(top, float(v))
                for u in range(int(left), math.ceil(right)):
                    z = depth_m[v, u]
                    if 0.0 < z <= range_m:  # False for nan
                        share = tall * (min(right, u + 1.0) - max(left, float(u)))
                        total += share * z
                        area += share
            if area > 0.0 and area >= least * (rows[i + 1] - rows[i]) * (columns[j + 1] - columns[j]):
                out[i, j] = total / area
    return out


def network_image(depth_m: Image, intrinsics: Intrinsics, width: int = WIDTH, height: int = HEIGHT) -> Image:
    """Depth (h, w) [m] to (height, width) [m] of the same view, 0 = invalid."""
    h, w = depth_m.shape
    kx, ky = width / WIDTH, height / HEIGHT
    # An image of another size than its intrinsics say is the same view, scaled.
    sx, sy = w / intrinsics.width, h / intrinsics.height
    columns = _edges(width, FX * kx, CX * kx, intrinsics.fx * sx, intrinsics.cx * sx)
    rows = _edges(height, FY * ky, CY * ky, intrinsics.fy * sy, intrinsics.cy * sy)
    out: Image = _means(np.ascontiguousarray(depth_m, np.float32), rows, columns, RANGE_M, VALID_SHARE)
    return out
