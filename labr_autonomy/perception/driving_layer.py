"""What hinders driving, in a fine plan round the robot: the floor as it rises and falls, and what is on it.

Cells of half the rolling map's edge hold two things: evidence for something between the floor and the
robot's top (log-odds, as in the rolling map), and the floor's height where it was seen. A ray's part that
runs at the robot's height frees the cells below it; a return that stands on the floor fills its cell, and so
does the place where a ray passes through where the floor should have been: a drop. Four bands of height are
kept apart, so that rays over a leg or below a drawer do not free its place. Frame: odom; metres.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from labr_autonomy.perception import driving_kernels as kernels
from labr_autonomy.perception.driving_kernels import CELL_M, HIGHEST, LOWEST, MISS, NO_FLOOR, OCCUPIED, STEP_M
from labr_autonomy.perception.fields import Field2
from labr_autonomy.perception.footing import Footing, footing
from labr_autonomy.perception.moving import Moving
from labr_autonomy.perception.raycast import apply
from labr_autonomy.perception.shift import moved
from labr_autonomy.types import Array

FADE_M = 1.0  # of way takes one unit from all evidence of obstacles: the pose drifts away from it
GRAIN = 3  # cells
FREE = -6  # rays of so many images must have passed: fewer may have missed the leg of a chair
LOOKED_THROUGH = -12  # mean log-odds of four cells, of which three are as free as can be
DODGE_M = 0.5  # round where something moved nothing is free: the way of a walker while the robot brakes


class DrivingLayer:
    """The plan round the robot.

    Args:
        side_m: Edge of the square that moves with the robot.
        top_m: Height above the floor up to which something is in the way.
    """

    def __init__(self, side_m: float, top_m: float) -> None:
        n = round(side_m / CELL_M)
        self.bands = np.zeros((n, n, kernels.BANDS), np.int8)  # evidence by height
        self.odds = np.zeros((n, n), np.int8)  # and what follows from it; `kernels.judge`
        self.heights_mm = np.full((n, n), NO_FLOOR, np.int16)
        self.spots = np.zeros((n, n, 2), np.int8)  # mean place of a cell's returns; `point_distance`
        self.moving = Moving((n, n), CELL_M, OCCUPIED)
        self._top_m = top_m
        self._corner = np.zeros(2, np.int64)  # odom, in whole cells
        self._marks = np.zeros(self.bands.size, np.int8)
        self._touched = np.zeros(self.bands.size, np.int32)
        self._faded_m: Array | None = None  # where the evidence last faded

    @property
    def origin_m(self) -> Array:
        """Lower corner (2,), odom."""
        out: Array = self._corner.astype(np.float64) * CELL_M
        return out

    def follow(self, place_m: Array) -> bool:
        """Move the square by pairs of cells so that a place (2|3,) is in its middle; new ones are unknown.

        Returns:
            Whether all evidence of obstacles faded by a unit: once every `FADE_M` of way.
        """
        n = self.odds.shape[0]
        corner = 2 * np.floor(np.asarray(place_m[:2], float) / (2.0 * CELL_M)).astype(np.int64) - n // 2
        by = corner - self._corner
        if by.any():
            self.bands, self.odds = moved(self.bands, by, 0), moved(self.odds, by, 0)
            self.heights_mm = moved(self.heights_mm, by, NO_FLOOR)
            self.spots = moved(self.spots, by, 0)
            self.moving.shift(by)
        self._corner = corner
        place = np.array(place_m[:2], float)
        if self._faded_m is None:
            self._faded_m = place
        if float(np.hypot(*(place - self._faded_m))) < FADE_M:
            return False
        self._faded_m = place
        self.bands -= self.bands > 0
        self._judge()
        return True

    def update(
        self,
        depth_m: NDArray[np.float32],
        kinds: NDArray[np.uint8],
        floors_m: NDArray[np.float32],
        *,
        optics: tuple[float, float, float, float, float],
        rotation: NDArray[np.float64],
        eye_m: Array,
        floor_z_m: float,
        sampling: tuple[int, int, int],
        range_m: float,
        stamp_s: float,
    ) -> int:
        """Take in one image and what `ground.scan` made of it; the rest as there.

        Args:
            depth_m: The image.
            kinds: Of its returns.
            floors_m: Below them.
            optics: See `ground.scan`.
            rotation: See `ground.scan`.
            eye_m: See `ground.scan`.
            floor_z_m: See `ground.scan`.
            sampling: Stride [px], first row, first column.
            range_m: Farthest return that counts.
            stamp_s: Of the image.

        Returns:
            How many cells were seen, at each height for itself.
        """
        corner = np.array([*self.origin_m, floor_z_m])
        count: int = kernels.cast(
            depth_m,
            kinds,
            floors_m,
            optics,
            rotation,
            eye_m,
            corner,
            self._top_m,
            sampling,
            range_m,
            self.heights_mm,
            self.bands.reshape(-1),
            self.odds,
            self.spots,
            self._marks,
            self._touched,
        )
        marks = self._marks.reshape(-1, kernels.BANDS)
        self.moving.watch(self.odds, marks, self._touched, count, self.origin_m, stamp_s, eye_m, optics[4])
        apply(self.bands.reshape(-1), self._marks, self._touched, count, MISS, LOWEST, HIGHEST)
        self._judge()
        self.moving.stamp(self.odds, self._touched, count, kernels.BANDS)
        return count

    def clear(self, xy_m: Array, radius_m: float) -> None:
        """Mark a disc as free: the robot stands there."""
        x, y, disc = self._disc(xy_m, radius_m)
        region = self.bands[x, y]
        region[disc] = np.minimum(region[disc], LOWEST)
        self._judge(x, y)

    def assume_free(self, xy_m: Array, radius_m: float) -> None:
        """Mark what is unknown of a disc as free, as weakly as counts; what was seen stays as it is."""
        x, y, disc = self._disc(xy_m, radius_m)
        odds = self.odds[x, y]
        region = self.bands[x, y]
        region[disc & (odds > FREE) & (odds <= 0)] = FREE
        self._judge(x, y)

    def footing(self, xy_m: Array, radius_m: float) -> Footing | None:
        """How the floor round a place (2,) odom slopes; None where too little of it has been seen."""
        x, y, _ = self._disc(xy_m, radius_m)
        part = self.heights_mm[x, y]
        heights = np.where(part == NO_FLOOR, np.nan, 1e-3 * part)
        corner = self.origin_m + np.array([x.start, y.start]) * CELL_M
        return footing(heights, corner, CELL_M, xy_m, radius_m)

    def _judge(self, x: slice = slice(None), y: slice = slice(None)) -> None:
        kernels.judge(self.bands[x, y], self.odds[x, y])

    def _disc(self, xy_m: Array, radius_m: float) -> tuple[slice, slice, NDArray[np.bool_]]:
        """Cells along x and y round a place (2,) odom, and which of them have their middle within."""
        at = (np.asarray(xy_m, float) - self.origin_m) / CELL_M
        n = self.odds.shape[0]
        low = np.clip(np.floor(at - radius_m / CELL_M).astype(int), 0, n)
        high = np.clip(np.ceil(at + radius_m / CELL_M).astype(int), 0, n)
        i, j = np.ogrid[low[0] : high[0], low[1] : high[1]]
        disc: NDArray[np.bool_] = (i + 0.5 - at[0]) ** 2 + (j + 0.5 - at[1]) ** 2 <= (radius_m / CELL_M) ** 2
        return slice(low[0], high[0]), slice(low[1], high[1]), disc

    def seen(self) -> Field2:
        """Distance to what was seen to hinder the driving body, over the whole square: for searches."""
        occupied, known = self._cells(np.s_[:, :])
        return Field2.from_points(occupied, known, self.spots, self.origin_m, CELL_M)

    def surely_free(self) -> NDArray[np.bool_]:
        """Pairs of cells, as in `seen().coarser()`, that were looked through again and again, (n/2, n/2).

        A cell in four may have been missed between rays; half a pair of them may be a wall's face.
        """
        out = np.empty((self.odds.shape[0] // 2, self.odds.shape[1] // 2), np.bool_)
        kernels.looked_through(self.odds, 4 * LOOKED_THROUGH, out)
        return out

    def room(self, place_m: Array, half_m: float) -> Field2:
        """The same near a place (2|3,), where only what was well seen counts as free: for trajectories.

        Gaps of the unknown that are narrower than `GRAIN` cells lie between rays, not behind things.
        """
        n = self.odds.shape[0]
        low = np.floor((np.asarray(place_m[:2], float) - half_m - self.origin_m) / CELL_M).astype(int)
        high = low + math.ceil(2.0 * half_m / CELL_M)
        low, high = np.clip(low, 0, n - 1), np.clip(high, 1, n)
        window = np.s_[low[0] : high[0], low[1] : high[1]]
        occupied, _ = self._cells(window)
        known = occupied | (self.odds[window] <= FREE)
        grain = np.ones((GRAIN, GRAIN), np.uint8)
        unseen = cv2.morphologyEx((~known).astype(np.uint8), cv2.MORPH_OPEN, grain)
        for x, y in (self.moving.places_m - self.origin_m) / CELL_M - low:
            cv2.circle(unseen, (round(y - 0.5), round(x - 0.5)), round(DODGE_M / CELL_M), 1, -1)
        spots = np.where(occupied[:, :, None], self.spots[window], np.int8(0))
        return Field2.from_points(occupied | (unseen > 0), known, spots, self.origin_m + low * CELL_M, CELL_M)

    def _cells(self, window: tuple[slice, slice]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which cells hinder driving, and which were seen."""
        odds = self.odds[window]
        occupied = odds >= OCCUPIED
        kernels.ledges(self.heights_mm[window], round(1000.0 * STEP_M), occupied)
        return occupied, occupied | (odds < 0)
