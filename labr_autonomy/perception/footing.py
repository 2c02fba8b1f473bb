"""How a place's floor slopes, by the heights that have been seen of it. Frame: odom; metres."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.types import Array

CELLS_MIN = 12  # fewer heights tell no plane
SPREAD_MIN = 0.25  # of the radius: heights on a line, or on one side alone, tell none either


@dataclass(frozen=True, slots=True)
class Footing:
    """The plane that fits a disc of floor best."""

    rise: float  # steepest rise over run
    height_m: float  # of the plane at the place, odom
    uneven_m: float  # rms distance of the heights from the plane
    seen: float  # share of the disc whose height is known, 0..1


def footing(
    heights_m: NDArray[np.floating], origin_m: Array, cell_m: float, xy_m: Array, radius_m: float
) -> Footing | None:
    """Fit a plane to the floor round a place; None where too little of it has been seen to tell.

    Args:
        heights_m: (nx, ny) height of the floor in each cell of a crop that holds the disc, odom; nan where
            it is not known.
        origin_m: (2,) lower corner of cell (0, 0), odom.
        cell_m: Edge of a cell.
        xy_m: (2,) the place, odom.
        radius_m: Of the disc whose cells count.
    """
    at = np.asarray(xy_m, float) - origin_m
    i, j = np.indices(heights_m.shape)
    x, y = (i + 0.5) * cell_m - at[0], (j + 0.5) * cell_m - at[1]
    known = (x * x + y * y <= radius_m * radius_m) & np.isfinite(heights_m)
    x, y, z = x[known], y[known], heights_m[known].astype(float)
    if len(z) < CELLS_MIN:
        return None
    about = np.stack([x - x.mean(), y - y.mean()])
    least = float(np.linalg.eigvalsh(about @ about.T / len(z))[0])
    if math.sqrt(max(least, 0.0)) < SPREAD_MIN * radius_m:
        return None
    columns = np.column_stack([np.ones(len(z)), x, y])
    plane, *_ = np.linalg.lstsq(columns, z, rcond=None)
    left = z - columns @ plane
    cells = math.pi * (radius_m / cell_m) ** 2
    rough = float(np.sqrt(np.mean(left**2)))
    return Footing(math.hypot(plane[1], plane[2]), float(plane[0]), rough, min(1.0, len(z) / cells))
