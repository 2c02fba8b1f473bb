from __future__ import annotations

import cv2
import numpy as np
import pytest

from sim.bench import portrait as drawing
from sim.bench.portrait import portrait
from sim.worlds.meshes import box, flat, merged
from sim.worlds.surface import Surface
from sim.worlds.world import make_world


def room(*, roof):
    parts = [flat((-5, -4), (5, 4), 0.0), box((1, 1, 0.5), (0.5, 0.5, 0.5))]
    parts += [box((x, 0, 1.5), (0.1, 4, 1.5)) for x in (-5, 5)]
    if roof:
        parts.append(flat((-5, -4), (5, 4), 3.0, down=True))
    mesh = merged(parts)
    return make_world("room", mesh.vertices_m, mesh.faces, {})


def drawn(path, world, **options):
    portrait(world, Surface(world), path, **options)
    return cv2.imread(str(path)).astype(int)


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(drawing, "SAMPLES", 1)
    monkeypatch.setattr(drawing, "_SKY", drawing._SKY[::4])


def share_of_ground(picture):
    """Pale pixels that are warm; a roof is a cold blue."""
    near = np.abs(picture - 255 * drawing.GROUND[::-1]).max(axis=2) < 40
    return (near & (picture[..., 2] > picture[..., 0] + 3)).mean()


@pytest.mark.slow
def test_roofs_come_off_and_the_picture_is_filled_and_small(tmp_path):
    shut = drawn(tmp_path / "shut.png", room(roof=True))
    assert shut.shape == (600, 900, 3)
    assert (tmp_path / "shut.png").stat().st_size < 150_000
    paper = (np.abs(shut - 255 * drawing.PAPER[::-1]).max(axis=2) < 5).mean()
    assert share_of_ground(shut) > 0.15  # the floor is seen through where the roof was
    assert 0.2 < paper < 0.6
    whole = drawn(tmp_path / "whole.png", room(roof=True), cut_m=np.inf)
    assert share_of_ground(whole) < 0.02


@pytest.mark.slow
def test_tracks_are_drawn_where_they_lead_in_the_colour_of_their_mode(tmp_path):
    track = [[0, -3, -2, 0.1, 0], [1, -1, -2, 0.1, 0], [2, -1, -2, 1.5, 1], [3, 3, -2, 1.5, 1]]
    world = room(roof=False)
    plain = drawn(tmp_path / "a.png", world)
    marked = drawn(tmp_path / "b.png", world, tracks=[track])
    for colour in (drawing.LAND, drawing.AIR):
        v, u = np.nonzero(np.abs(marked - 255 * colour[::-1]).max(axis=2) < 4)
        assert len(v) > 100
        assert not (np.abs(plain - 255 * colour[::-1]).max(axis=2) < 4).any()
        if colour is drawing.LAND:
            left = u.mean()
    assert u.mean() > left + 50  # it flies on to the right of where it drove


@pytest.mark.slow
def test_the_inset_shows_the_depth_from_the_eye(tmp_path):
    picture = drawn(tmp_path / "a.png", room(roof=False), eye=(-3.0, 1.0, 0.2, 0.0))
    edge = drawing.MARGIN_PX + 2
    inset = picture[-drawing.INSET_PX[1] - edge : -edge, -drawing.INSET_PX[0] - edge : -edge].sum(axis=2)
    assert inset[50, 106] > inset[50, 30] + 60  # the box at 3.4 m is brighter than the wall at 8 m
    assert inset[-1, 106] > inset[50, 106]  # and the floor before the wheels brighter still


def test_clipping_cuts_at_the_height():
    rng = np.random.default_rng(5)
    triangles = rng.uniform(0, 2, (500, 3, 3)).astype(np.float32)
    low = drawing._clipped(triangles, 1.2)
    assert low[..., 2].max() <= 1.2 + 1e-5
    above = triangles.copy()
    above[..., 2] *= -1
    high = drawing._clipped(above, -1.2)

    def area(t):
        return np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1).sum()

    assert area(low) + area(high) == pytest.approx(area(triangles), rel=1e-4)
