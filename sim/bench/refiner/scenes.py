"""Random surroundings: boxes on a floor, exact for the judge and as the map's cells for the refiner."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.perception.fields import Field2, Field3
from labr_autonomy.types import Array

SIDE_M, HEIGHT_M = 8.0, 3.0
CELL_M = {2: 0.05, 3: 0.1}  # of the plan for driving, and of the space for flying
BOXES, LEGS = 9, 6  # large ones, and posts of one cell's width
POP_UP_M = 0.15  # half width of a box that appears


@dataclass(frozen=True, slots=True)
class Scene:
    """Boxes on whole cells of a square with walls, and what the map makes of them."""

    boxes_m: Array  # (n, 2, d) lower and upper corners
    occupied: NDArray[np.bool_]
    known: NDArray[np.bool_]
    field: Field2 | Field3

    @property
    def dimensions(self) -> int:
        """2 for driving, 3 for flying."""
        return int(self.boxes_m.shape[2])

    def gap_m(self, points_m: Array) -> Array:
        """Exact distance of points (k, d) to the nearest solid thing, 0 inside, (k,)."""
        away = np.maximum(self.boxes_m[:, 0] - points_m[:, None], points_m[:, None] - self.boxes_m[:, 1])
        out: Array = np.linalg.norm(np.maximum(away, 0.0), axis=2).min(axis=1)
        return out

    def with_box(self, centre_m: Array) -> Scene:
        """The same scene with one thing more in it."""
        d, cell = self.dimensions, CELL_M[self.dimensions]
        low = np.floor((centre_m[:d] - POP_UP_M) / cell) * cell
        return _scene(np.concatenate([self.boxes_m, [[low, low + 2.0 * POP_UP_M]]]), self.known)


def draw(rng: np.random.Generator, dimensions: int) -> Scene:
    """A scene; parts of one for driving were never seen."""
    cell = CELL_M[dimensions]
    size = np.array([SIDE_M, SIDE_M, HEIGHT_M])[:dimensions]
    low = rng.uniform(0.0, 1.0, (BOXES + LEGS, dimensions)) * size
    edges = np.vstack([rng.uniform(0.2, 1.4, (BOXES, dimensions)), np.full((LEGS, dimensions), 1.01 * cell)])
    if dimensions == 3:
        stands = rng.random(BOXES + LEGS) < 0.7
        low[stands, 2] = 0.0
        edges[BOXES:, 2] = HEIGHT_M
    low, high = np.floor(low / cell) * cell, np.ceil((low + edges) / cell) * cell
    walls = []
    for axis in range(2):
        for at in (0.0, SIDE_M - cell):
            a, b = np.zeros(dimensions), size.copy()
            a[axis], b[axis] = at, at + cell
            walls.append([a, b])
    if dimensions == 3:
        walls.append([np.array([0.0, 0.0, -cell]), np.array([SIDE_M, SIDE_M, 0.0])])
    known = np.ones(tuple(np.round(size / cell).astype(int) + np.array([0, 0, 1])[:dimensions]), np.bool_)
    if dimensions == 2 and rng.random() < 0.5:
        i, j = rng.integers(0, known.shape[0], 2)
        known[i : i + 30, j : j + 40] = False
    return _scene(np.concatenate([np.stack([low, high], axis=1), np.array(walls)]), known)


def _scene(boxes_m: Array, known: NDArray[np.bool_]) -> Scene:
    """Cells of the boxes; in a plan the unknown counts as solid for the field, as in flight."""
    d = boxes_m.shape[2]
    cell = CELL_M[d]
    origin = np.zeros(d) if d == 2 else np.array([0.0, 0.0, -cell])
    occupied = np.zeros(known.shape, np.bool_)
    for low, high in boxes_m:
        a, b = (np.clip(np.round((p - origin) / cell).astype(int), 0, known.shape) for p in (low, high))
        occupied[tuple(slice(i, j) for i, j in zip(a, b, strict=True))] = True
    field: Field2 | Field3
    if d == 2:
        field = Field2.from_occupied(occupied | ~known, known | occupied, origin, cell)
    else:
        field = Field3.from_occupied(occupied, known, origin, cell)
    return Scene(boxes_m, occupied, known, field)
