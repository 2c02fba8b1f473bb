"""A world cut up for drawing: large triangles, and chunks of small ones at several levels of detail.

A software rasteriser spends its time on small triangles. Seen from afar, vertices that lie closer together
than a pixel are merged and the triangles that collapse are dropped: a furnished house of 146 000 triangles
keeps 50 000 at 1 cm and 32 000 at 2 cm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.types import Array
from sim.worlds.world import World

CHUNK_M = 2.0  # of 0.5, 1, 2, 4 m the quickest in a furnished house
LARGE_M2 = 0.3  # triangles from this area on are drawn always, whole
DETAIL = 1.0 / 200.0  # merging cell over distance [rad]; a pixel of a 424 x 240 image is 1/212
CELLS_M = (0.01, 0.02)  # merged levels, used from cell / DETAIL on: 2 m and 4 m
WORTH = 20_000  # worlds of fewer triangles have one level

Faces = NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Level:
    """The small triangles at one level of detail."""

    from_m: float  # nearest distance of a chunk from the lens at which it is used
    vertices_m: NDArray[np.float32]  # (n, 3) odom
    faces: Faces  # (m, 3), chunk by chunk
    firsts: NDArray[np.int64]  # (chunks + 1,) where each chunk's faces begin


@dataclass(frozen=True, slots=True)
class Chunks:
    """A world cut up for drawing."""

    large: Faces  # (k, 3) indices of the world's vertices
    levels: tuple[Level, ...]  # from near to far
    lower_m: Array  # (chunks, 3) bounds, odom
    upper_m: Array  # (chunks, 3)

    @property
    def corners_m(self) -> Array:
        """Corners of the bounds (chunks, 8, 3), odom."""
        pick = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=bool)
        return np.where(pick, self.upper_m[:, None], self.lower_m[:, None])

    def level_of(self, seen: NDArray[np.int64], lens_m: Array) -> NDArray[np.int64]:
        """Number of the level for chunks, by their distance from the lens (3,) odom."""
        gap = np.maximum(np.maximum(self.lower_m[seen] - lens_m, lens_m - self.upper_m[seen]), 0.0)
        starts = [level.from_m for level in self.levels[1:]]
        number: NDArray[np.int64] = np.searchsorted(starts, np.sqrt((gap * gap).sum(axis=1)), side="right")
        return number

    def runs(self, level: Level, seen: NDArray[np.int64]) -> list[tuple[int, int]]:
        """Chunks of one level, in rising order, as few stretches of faces [first, last)."""
        runs: list[tuple[int, int]] = []
        for chunk in seen:
            first, last = int(level.firsts[chunk]), int(level.firsts[chunk + 1])
            if runs and runs[-1][1] == first:
                runs[-1] = (runs[-1][0], last)
            elif first < last:
                runs.append((first, last))
        return runs


def cut(world: World) -> Chunks:
    """Cut a world into chunks of `CHUNK_M`."""
    triangles = world.triangles_m.astype(np.float64)
    edges = np.diff(triangles, axis=1)
    is_large = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) >= LARGE_M2
    small = np.flatnonzero(~is_large)
    if len(small) == 0:
        return Chunks(world.faces[is_large], (), np.zeros((0, 3)), np.zeros((0, 3)))
    cells = np.floor((triangles[small].sum(axis=1) / 3.0 - world.lower_m) / CHUNK_M).astype(np.int64)
    _, chunk = np.unique(cells, axis=0, return_inverse=True)
    chunk = chunk.reshape(-1)
    order = np.argsort(chunk, kind="stable")
    small, chunk = small[order], chunk[order]
    count = int(chunk[-1]) + 1
    faces = world.faces[small]
    levels = [Level(0.0, world.vertices_m, faces, np.searchsorted(chunk, np.arange(count + 1)))]
    if len(small) > WORTH:
        levels += [_merged(world, faces, chunk, count, cell_m) for cell_m in CELLS_M]
    firsts = levels[0].firsts[:-1]
    lower = np.minimum.reduceat(triangles[small].min(axis=1), firsts)
    upper = np.maximum.reduceat(triangles[small].max(axis=1), firsts)
    return Chunks(world.faces[is_large], tuple(levels), lower, upper)


def _merged(world: World, faces: Faces, chunk: NDArray[np.int64], count: int, cell_m: float) -> Level:
    """The faces with all vertices of a cell merged into their mean (Rossignac and Borrel's clustering)."""
    cells = np.floor(world.vertices_m.astype(np.float64) / cell_m).astype(np.int64)
    _, cluster = np.unique(cells, axis=0, return_inverse=True)
    cluster = cluster.reshape(-1)
    weight = np.bincount(cluster)
    means = np.column_stack([np.bincount(cluster, world.vertices_m[:, k]) / weight for k in range(3)])
    merged = cluster[faces]
    ordered = np.sort(merged, axis=1)
    kept = np.flatnonzero((ordered[:, 0] != ordered[:, 1]) & (ordered[:, 1] != ordered[:, 2]))
    # Of triangles that fell on one another within a chunk, one is enough.
    _, once = np.unique(np.column_stack([chunk[kept], ordered[kept]]), axis=0, return_index=True)
    kept = kept[np.sort(once)]
    firsts = np.searchsorted(chunk[kept], np.arange(count + 1))
    return Level(cell_m / DETAIL, means.astype(np.float32), merged[kept].astype(np.int32), firsts)
