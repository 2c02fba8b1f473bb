"""Compiled flaws of the depth camera: one pass over the image in place of a dozen."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from labr_autonomy.types import Image


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _near_jumps(disparity_px: Any, jump_px: float) -> Any:
    """Pixels up to two away from a jump in disparity, across and down: half a matching window."""
    h, w = disparity_px.shape
    near = np.zeros((h, w), np.bool_)
    for v in range(h):
        for u in range(w):
            if u + 1 < w and abs(disparity_px[v, u + 1] - disparity_px[v, u]) > jump_px:
                near[v, max(u - 1, 0) : min(u + 2, w - 1) + 1] = True
            if v + 1 < h and abs(disparity_px[v + 1, u] - disparity_px[v, u]) > jump_px:
                near[max(v - 1, 0) : min(v + 2, h - 1) + 1, u] = True
    return near


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _sigma_px(z_m: float, sigma_at_px: Any) -> float:
    """Standard deviation of the disparity at a distance, straight between the camera's figures."""
    if z_m <= sigma_at_px[0, 0]:
        return float(sigma_at_px[0, 1])
    for k in range(1, len(sigma_at_px)):
        near, far = sigma_at_px[k - 1], sigma_at_px[k]
        if z_m < far[0]:
            return float(near[1] + (z_m - near[0]) / (far[0] - near[0]) * (far[1] - near[1]))
    return float(sigma_at_px[-1, 1])


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def spoil(
    depth_m: Image,
    focal_baseline_px_m: float,
    bins: float,
    edge_px: float,
    edge_loss: float,
    sigma_at_px: NDArray[np.float64],
    step_px: float,
    range_m: tuple[float, float],
    normal: Image,
    uniform: Image,
) -> Image:
    """Disparity noise, steps, dead band, shadows, holes at edges and range; see `noise`.

    Args:
        depth_m: (h, w) ideal depth [m], 0 where nothing is seen.
        focal_baseline_px_m: Focal length times baseline at the sensor's columns.
        bins: Sensor columns in one of the image's.
        edge_px: Disparity jump that a matching window does not bridge.
        edge_loss: Share of the pixels near such a jump that are lost.
        sigma_at_px: (k, 2) distance [m] and standard deviation of the disparity there; straight between.
        step_px: Disparity step.
        range_m: Nearest and farthest depth.
        normal: (h * w,) standard normal numbers.
        uniform: (h * w,) numbers in 0..1.
    """
    h, w = depth_m.shape
    disparity = np.zeros((h, w))
    for v in range(h):
        for u in range(w):
            if depth_m[v, u] > 0.0:
                disparity[v, u] = focal_baseline_px_m / depth_m[v, u]
    edge = _near_jumps(disparity, edge_px)
    out = np.zeros((h, w), np.float32)
    for v in range(h):
        nearest = math.inf  # where the right imager sees what lies further right in this row
        for u in range(w - 1, -1, -1):
            z, d = depth_m[v, u], disparity[v, u]
            right = u * bins - d
            hidden = right >= nearest
            nearest = min(nearest, right)
            lost = edge[v, u] and uniform[v * w + u] < edge_loss
            if z <= 0.0 or right < 0.0 or hidden or lost:
                continue
            sigma = _sigma_px(z, sigma_at_px)
            measured = np.rint((d + sigma * normal[v * w + u]) / step_px) * step_px
            if measured < step_px:
                continue
            seen = focal_baseline_px_m / measured
            if range_m[0] <= seen <= range_m[1]:
                out[v, u] = np.float32(np.rint(seen * 1000.0) / 1000.0)  # Z16: whole millimetres
    return out
