"""What walks about: returns where the floor was surely free, away from anything that has stood for a while.

A person fills many cells at once that were seen free a moment ago. A chair's leg that was too thin to be
seen from afar fills few, and a wall that the pose drifts against fills cells beside what has long been
solid: neither counts. Where something moved, nothing is driven to for a while, so that the robot brakes
before it and stands when it comes close. Frame: odom; metres.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.perception.compiled import compiled
from labr_autonomy.perception.shift import moved
from labr_autonomy.types import Array

SURELY_FREE = -15  # log-odds of the driving layer
STOOD_S = 1.0  # what has been solid so long does not move
BESIDE, SPREAD = 3, 3.0  # so many cells from it are its own, or so many sigmas of the return
FAR_M = 4.0  # returns from farther away scatter too much; walls have long been seen when they come so near
TOGETHER, APART_M = 6, 0.3  # so many surprises so near to each other are a body
HOLD_S = 1.0  # of a place where something moved
MOST = 512  # surprises of one image that are looked at


@compiled
def _surprises(
    odds: Any,
    marks: Any,
    touched: Any,
    count: int,
    since: Any,
    solid: int,
    before_s: float,
    eye: Any,
    sigma: float,
    out: Any,
) -> int:
    """Flat indices of the cells with a return that were surely free and have nothing old beside them.

    In cells: `eye` is the camera's place and the distance up to which returns count, `sigma` the noise of a
    return one cell away.
    """
    n, m = odds.shape
    found = 0
    for k in range(count):
        index = touched[k]
        cell, level = index // marks.shape[1], index % marks.shape[1]
        i, j = cell // m, cell % m
        if marks[cell, level] <= 1 or odds[i, j] > SURELY_FREE:
            continue
        if (marks[cell, :level] > 1).any():  # counted at a lower height
            continue
        away2 = (i + 0.5 - eye[0]) ** 2 + (j + 0.5 - eye[1]) ** 2
        if away2 > eye[2] ** 2:
            continue
        old, beside = False, max(BESIDE, math.ceil(SPREAD * sigma * away2))
        for a in range(max(0, i - beside), min(n, i + beside + 1)):
            for b in range(max(0, j - beside), min(m, j + beside + 1)):
                old |= odds[a, b] >= solid and since[a, b] <= before_s
        if not old and found < len(out):
            out[found] = cell
            found += 1
    return found


@compiled
def _stamp(odds: Any, touched: Any, count: int, heights: int, since: Any, solid: int, now_s: float) -> None:
    """Note since when each touched cell has been solid; `touched` counts each of its `heights`."""
    m = odds.shape[1]
    for k in range(count):
        cell = touched[k] // heights
        i, j = cell // m, cell % m
        if odds[i, j] < solid:
            since[i, j] = np.inf
        elif since[i, j] == np.inf:
            since[i, j] = now_s


class Moving:
    """The memory of it.

    Args:
        shape: Of the driving layer.
        cell_m: Edge of its cells.
        solid: Log-odds from which a cell is solid.
    """

    def __init__(self, shape: tuple[int, int], cell_m: float, solid: int) -> None:
        self._since_s = np.full(shape, np.inf)
        self._cell_m, self._solid = cell_m, solid
        self._found = np.empty(MOST, np.int64)
        self._places_m: Array = np.zeros((0, 3))  # x, y, when
        self._now_s = -np.inf

    def shift(self, by: NDArray[np.int64]) -> None:
        """Follow the layer."""
        self._since_s = moved(self._since_s, by, np.inf)

    def watch(
        self,
        odds: NDArray[np.int8],
        marks: NDArray[np.int8],
        touched: NDArray[np.int32],
        count: int,
        origin_m: Array,
        now_s: float,
        eye_m: Array,
        sigma_1: float,
    ) -> None:
        """Look for bodies in an image's marks, before they are applied.

        Args:
            odds: (n, m) of the layer.
            marks: (n * m, heights) what the image says of the touched cells.
            touched: Their flat indices, height by height.
            count: How many.
            origin_m: (2,) lower corner, odom.
            now_s: The image's stamp.
            eye_m: (2|3,) of the camera, odom.
            sigma_1: Noise of a return at one metre; it grows with the square of the distance.
        """
        eye = (eye_m[:2] - origin_m) / self._cell_m
        k = _surprises(
            odds,
            marks,
            touched,
            count,
            self._since_s,
            self._solid,
            now_s - STOOD_S,
            (float(eye[0]), float(eye[1]), FAR_M / self._cell_m),
            sigma_1 * self._cell_m,
            self._found,
        )
        self._now_s = now_s
        young = self._places_m[self._places_m[:, 2] > now_s - HOLD_S]
        if k >= TOGETHER:
            cells = np.stack(np.unravel_index(self._found[:k], odds.shape), axis=1)
            places = origin_m + (cells + 0.5) * self._cell_m
            near = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1)) <= APART_M
            body = places[near.sum(axis=1) >= TOGETHER]
            young = np.vstack([young, np.column_stack([body, np.full(len(body), now_s)])])
        self._places_m = young

    def stamp(self, odds: NDArray[np.int8], touched: NDArray[np.int32], count: int, heights: int) -> None:
        """Note what has become solid, after the marks were applied."""
        _stamp(odds, touched, count, heights, self._since_s, self._solid, self._now_s)

    @property
    def places_m(self) -> Array:
        """(k, 2) where something moved within the last `HOLD_S`, odom."""
        return self._places_m[:, :2]
