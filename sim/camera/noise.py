"""What a D435i makes of a depth image.

An active stereo pair measures disparity, so its flaws are laid in disparity, at the sensor's 848 columns:

- noise of 0.08 px at 0.5 m, 0.13 px at 1.8 m and 0.2 px from 2.3 m on, hence sigma_z = sigma z^2 / (f B).
  Between two pictures of a recorded D435 at rest: 0.08 px below 0.8 m, 0.12 px at 1 m, 0.13 px at 1.2 to
  2.1 m, 0.21 px at 2.1 to 2.6 m;
- steps of 1/32 px (the D4 chip's subpixel), then whole millimetres (Z16);
- a dead band at the left, where the right imager does not look: u < f B / z (20 px at 1 m);
- shadows: background at the left of a near object is hidden from the right imager;
- holes where a matching window straddles a depth edge;
- nothing nearer or farther than the range.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.config import Camera
from labr_autonomy.types import Image, Intrinsics

SENSOR_COLUMNS = 848  # the stream of which the images are a binned version


@dataclass(frozen=True, slots=True)
class D435i:
    """Figures of the camera."""

    baseline_m: float = 0.050  # D435i datasheet; 50.17 mm in a recorded unit
    sigma_at_px: tuple[tuple[float, float], ...] = ((0.5, 0.08), (1.8, 0.13), (2.3, 0.2))  # depth [m], sigma
    disparity_step_px: float = 1.0 / 32.0
    edge_px: float = 1.0  # disparity jump between neighbours that a matching window does not bridge
    edge_loss: float = 0.6  # share of the pixels near such a jump that come out invalid
    range_min_m: float = Camera().range_min_m
    range_max_m: float = Camera().range_max_m


def flawed_depth(depth_m: Image, intrinsics: Intrinsics, seed: int, camera: D435i | None = None) -> Image:
    """The depth image as the camera would give it.

    Args:
        depth_m: (h, w) ideal depth [m], 0 where nothing is seen.
        intrinsics: Its camera.
        seed: Same seed, same noise; one per frame.
        camera: Figures of the camera.
    """
    c = camera or D435i()
    rng = np.random.Generator(np.random.SFC64(seed))
    bins = np.float32(SENSOR_COLUMNS / intrinsics.width)
    fb = np.float32(intrinsics.fx * c.baseline_m) * bins  # [px m]
    seen = depth_m > np.float32(0.0)
    disparity = np.divide(fb, depth_m, out=np.zeros_like(depth_m), where=seen)  # [sensor px]
    column = np.arange(intrinsics.width, dtype=np.float32) * bins
    right = column - disparity  # where the right imager sees the same point
    valid = seen & (right >= 0.0)
    # A point is hidden when a point further right in this image lands at or left of it in the other one.
    nearest = np.minimum.accumulate(right[:, ::-1], axis=1)[:, ::-1]
    valid[:, :-1] &= right[:, :-1] < nearest[:, 1:]
    edges = np.flatnonzero(_edges(disparity, c.edge_px))
    valid.ravel()[edges[rng.random(len(edges), dtype=np.float32) < c.edge_loss]] = False
    noise = _noise(depth_m.shape, rng) * _sigma_px(depth_m, c)
    step = np.float32(c.disparity_step_px)
    measured = np.rint((disparity + noise) / step) * step
    valid &= measured >= step
    out = np.divide(fb, measured, out=np.zeros_like(depth_m), where=valid)
    out[(out < np.float32(c.range_min_m)) | (out > np.float32(c.range_max_m))] = 0.0
    rounded: Image = np.rint(out * np.float32(1000.0)) / np.float32(1000.0)
    return rounded


def _sigma_px(depth_m: Image, camera: D435i) -> Image:
    """Standard deviation of the disparity at each pixel, straight between the camera's figures."""
    (last_m, value), *rest = camera.sigma_at_px
    sigma = np.full(depth_m.shape, value, dtype=np.float32)
    for next_m, next_value in rest:
        share = np.clip((depth_m - np.float32(last_m)) / np.float32(next_m - last_m), 0.0, 1.0)
        sigma += share * np.float32(next_value - value)
        last_m, value = next_m, next_value
    return sigma


@functools.cache
def _noise_table() -> Image:
    """Standard normal numbers, drawn once; each frame takes a stretch, at a tenth of the cost of drawing."""
    return np.random.Generator(np.random.SFC64(848)).standard_normal(1 << 20, dtype=np.float32)


def _noise(shape: tuple[int, ...], rng: np.random.Generator) -> Image:
    """Standard normal numbers in the given shape, from a random place of the table."""
    table, count = _noise_table(), math.prod(shape)
    if count > len(table) // 2:
        return rng.standard_normal(shape, dtype=np.float32)
    start = int(rng.integers(len(table) - count))
    return table[start : start + count].reshape(shape)


def _edges(disparity_px: Image, jump_px: float) -> NDArray[np.bool_]:
    """Pixels up to two away from a jump in disparity, across and down: half a matching window."""
    edge = np.zeros(disparity_px.shape, dtype=bool)
    across = np.abs(np.diff(disparity_px, axis=1)) > jump_px
    down = np.abs(np.diff(disparity_px, axis=0)) > jump_px
    edge[:, 1:] |= across
    edge[:, 2:] |= across[:, :-1]
    edge[:, :-1] |= across
    edge[:, :-2] |= across[:, 1:]
    edge[1:] |= down
    edge[2:] |= down[:-1]
    edge[:-1] |= down
    edge[:-2] |= down[1:]
    return edge
