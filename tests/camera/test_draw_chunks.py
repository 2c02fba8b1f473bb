from __future__ import annotations

import numpy as np
import pytest

from sim.camera import chunks
from sim.camera.chunks import cut
from sim.worlds.world import make_world


@pytest.fixture
def world():
    """Triangles of about a centimetre strewn over 6 x 6 x 6 m, and one large one."""
    rng = np.random.default_rng(3)
    corners = rng.uniform(0, 6, (2000, 1, 3)) + rng.uniform(-0.01, 0.01, (2000, 3, 3))
    big = np.array([[[0, 0, 0], [6, 0, 0], [0, 6, 0]]], float)
    return make_world(
        "dust", np.concatenate([corners, big]).reshape(-1, 3), np.arange(6003).reshape(-1, 3), {}
    )


def rows(faces):
    return sorted(map(tuple, faces.tolist()))


def test_every_triangle_is_in_one_chunk_that_holds_it(world):
    parts = cut(world)
    assert len(parts.levels) == 1
    assert rows(parts.large) == [(6000, 6001, 6002)]
    level = parts.levels[0]
    assert rows(level.faces) == rows(world.faces[:-1])
    assert level.firsts[-1] == 2000
    for k in range(len(parts.lower_m)):
        held = world.vertices_m[level.faces[level.firsts[k] : level.firsts[k + 1]]].reshape(-1, 3)
        assert (held >= parts.lower_m[k] - 1e-6).all()
        assert (held <= parts.upper_m[k] + 1e-6).all()
        assert np.ptp(held, axis=0).max() < chunks.CHUNK_M + 0.05


def test_far_levels_move_nothing_farther_than_their_cell_and_drop_what_collapses(world, monkeypatch):
    monkeypatch.setattr(chunks, "WORTH", 100)
    parts = cut(world)
    assert [level.from_m for level in parts.levels] == pytest.approx([0.0, 2.0, 4.0])
    fine, *merged = parts.levels
    last = len(fine.faces)
    for level, cell in zip(merged, chunks.CELLS_M, strict=True):
        assert 0 < len(level.faces) < last
        last = len(level.faces)
        assert level.firsts[-1] == last
        cells = np.floor(world.vertices_m.astype(float) / cell).astype(int)
        centres = (np.unique(cells, axis=0) + 0.5) * cell
        assert np.abs(level.vertices_m - centres).max() <= 0.5 * cell + 1e-6
        for k in range(len(parts.lower_m)):
            held = level.vertices_m[level.faces[level.firsts[k] : level.firsts[k + 1]]].reshape(-1, 3)
            assert (held >= parts.lower_m[k] - cell).all()
            assert (held <= parts.upper_m[k] + cell).all()


def test_the_level_follows_the_distance_and_each_chunk_is_drawn_once(world, monkeypatch):
    monkeypatch.setattr(chunks, "WORTH", 100)
    parts = cut(world)
    every = np.arange(len(parts.lower_m))
    lens = np.array([1.0, 1.0, 1.0])
    wanted = parts.level_of(every, lens)
    assert set(wanted.tolist()) == {0, 1, 2}
    for k in every.tolist():
        gap = np.linalg.norm(np.clip(lens, parts.lower_m[k], parts.upper_m[k]) - lens)
        assert wanted[k] == int(gap >= 2.0) + int(gap >= 4.0)
    for number, level in enumerate(parts.levels):
        drawn = [f for first, last in parts.runs(level, every[wanted == number]) for f in range(first, last)]
        held = [f for k in every[wanted == number] for f in range(level.firsts[k], level.firsts[k + 1])]
        assert drawn == held
    assert parts.runs(parts.levels[0], every) == [(0, 2000)]


def test_a_world_of_large_triangles_has_no_chunks(world):
    parts = cut(make_world("big", world.vertices_m[-3:], np.array([[0, 1, 2]]), {}))
    assert parts.levels == ()
    assert len(parts.corners_m) == 0
