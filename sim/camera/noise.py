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
from dataclasses import dataclass

import numpy as np

from labr_autonomy.config import Camera
from labr_autonomy.types import Image, Intrinsics
from sim.camera.noise_kernel import spoil

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
    bins = SENSOR_COLUMNS / intrinsics.width
    count = depth_m.size
    normal, uniform = _tables(count)
    out: Image = spoil(
        np.ascontiguousarray(depth_m, np.float32),
        intrinsics.fx * c.baseline_m * bins,
        bins,
        c.edge_px,
        c.edge_loss,
        np.array(c.sigma_at_px, dtype=np.float64),
        c.disparity_step_px,
        (c.range_min_m, c.range_max_m),
        _stretch(normal, count, rng),
        _stretch(uniform, count, rng),
    )
    return out


@functools.lru_cache(maxsize=4)
def _tables(count: int) -> tuple[Image, Image]:
    """Normal and uniform numbers, drawn once; each frame takes a stretch, a tenth of the cost of drawing."""
    rng = np.random.Generator(np.random.SFC64(848))
    size = max(1 << 20, 4 * count)
    return rng.standard_normal(size, dtype=np.float32), rng.random(size, dtype=np.float32)


def _stretch(table: Image, count: int, rng: np.random.Generator) -> Image:
    """A stretch of a table from a random place on."""
    start = int(rng.integers(len(table) - count))
    return table[start : start + count]
