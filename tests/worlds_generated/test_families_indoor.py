"""The families `indoor` and `rooms`: offices and flats."""

import functools

import numpy as np
import pytest
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from labr_autonomy.config import Body
from labr_autonomy.errors import BadInput
from sim.worlds.families import indoor, rooms
from sim.worlds.families.draw import SIZES, draw_world, family_of
from sim.worlds.families.layout import CLEAR_M
from sim.worlds.surface import Surface

FAMILIES = ("indoor", "rooms")
NOWHERE = np.zeros((0, 3))
MARGIN_M = 0.05


@functools.cache
def layout_of(name, seed, difficulty=0.5, size_m=None):
    """As `draw_world` draws it; drawn once for all tests, none of which changes it."""
    rng = np.random.default_rng([seed, *name.encode()])
    return family_of(name)(rng, size_m or SIZES[name], difficulty)


def open_edges(mesh):
    """Directed edges without exactly one opposite, of a mesh whose parts share no vertices."""
    a = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]).astype(np.int64)
    n = len(mesh.vertices_m)
    there, back = a[:, 0] * n + a[:, 1], a[:, 1] * n + a[:, 0]
    twice = len(there) - len(np.unique(there))
    return twice + int((~np.isin(there, back)).sum())


def volumes_m3(mesh):
    """Signed volume of each connected part."""
    n, f = len(mesh.vertices_m), mesh.faces
    links = coo_array((np.ones(2 * len(f)), (f[:, [0, 0]].ravel(), f[:, 1:].ravel())), shape=(n, n))
    _, part = connected_components(links, directed=False)
    p, q, r = (mesh.vertices_m[f[:, k]] - mesh.vertices_m.mean(axis=0) for k in range(3))
    return np.bincount(part[f[:, 0]], weights=(p * np.cross(q, r)).sum(axis=1) / 6.0)


def floor_grid(world, cell_m):
    """Which places of a driving robot are free with a margin, on a grid of cells; and the grid's lines."""
    surface, (low, high) = Surface(world), world.region_m
    x, y = (np.arange(low[k] + 0.5 * cell_m, high[k], cell_m) for k in (0, 1))
    z = Body().below_m
    free = [
        [surface.clearance(np.array([u, v, z]), on_floor=True, reach_m=0.1) > MARGIN_M for v in y] for u in x
    ]
    return np.array(free), x, y


@pytest.mark.slow
@pytest.mark.parametrize("name", FAMILIES)
def test_same_seed_same_bytes_and_another_seed_another_plan(name):
    a, b, c = (draw_world(name, seed, SIZES[name], 0.5, NOWHERE) for seed in (5, 5, 6))
    assert a.vertices_m.tobytes() == b.vertices_m.tobytes()
    assert a.faces.tobytes() == b.faces.tobytes()
    assert a.vertices_m.tobytes() != c.vertices_m.tobytes()
    walls = [len(layout_of(name, seed).structure) for seed in range(3)]
    assert len(set(walls)) > 1  # the plan itself varies


@pytest.mark.slow
@pytest.mark.parametrize("name", FAMILIES)
def test_harder_worlds_hold_more_and_stay_in_the_triangle_budget(name):
    things, triangles = [], []
    for difficulty in (0.0, 0.5, 1.0):
        drawn = [layout_of(name, seed, difficulty) for seed in range(3)]
        things.append(np.mean([len(layout.furnishings) for layout in drawn]))
        triangles += [len(layout.mesh(NOWHERE).faces) for layout in drawn]
    assert things[1] > 1.15 * things[0]
    assert things[2] > 1.15 * things[1]
    assert max(triangles) < 30_000
    assert min(triangles) > 3_000


@pytest.mark.slow
@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize("seed", range(2))
def test_the_region_is_shut_in_by_floor_ceiling_and_outer_walls(name, seed):
    layout = layout_of(name, seed)
    world = draw_world(name, seed, SIZES[name], 0.5, NOWHERE)
    low, high = world.region_m
    assert low.tolist() == [-0.5 * SIZES[name][0], -0.5 * SIZES[name][1], 0.0]
    assert high[:2].tolist() == (-low[:2]).tolist()
    assert 2.0 < high[2] <= 3.0
    assert np.array_equal(layout.region_m, world.region_m)
    surface = Surface(world)
    points = np.random.default_rng(seed).uniform(low + np.array([0.0, 0.0, 0.01]), high, (200, 3))
    for axis, sign in ((0, -1), (0, 1), (1, -1), (1, 1), (2, -1), (2, 1)):
        ahead = np.zeros(3)
        ahead[axis] = sign * 50.0
        assert not any(surface.sees(point, point + ahead) for point in points)
    assert min(surface.floor_below(x, y, high[2]) for x, y, _ in points) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", FAMILIES)
def test_every_piece_is_a_closed_solid_wound_outwards(name):
    layout = layout_of(name, 2, 1.0)
    for mesh in [*layout.structure, *layout.furnishings]:
        assert open_edges(mesh) == 0
        assert volumes_m3(mesh).min() > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", FAMILIES)
def test_the_inside_of_large_solids_is_known_and_the_rooms_are_not_inside(name):
    world = draw_world(name, 1, SIZES[name], 0.5, NOWHERE)
    surface = Surface(world)
    low, high = world.region_m
    middle = 0.5 * (low + high)
    assert surface.inside(np.array([middle[0], low[1] - 0.1, 0.3]))  # in an outer wall, below the windows
    points = np.random.default_rng(0).uniform(low, high, (300, 3))
    free = [surface.clearance(p, reach_m=0.4) > 0.3 for p in points]
    assert sum(free) > 25
    assert not any(surface.inside(p) for p, ok in zip(points, free, strict=True) if ok)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "module"), [("indoor", indoor), ("rooms", rooms)])
def test_the_floor_hangs_together_through_the_doors(name, module, monkeypatch):
    """On a grid of its own, by the simulator's own clearance, with a margin."""
    drawn = []

    class Noted(module.Room):
        def __init__(self, rect, doors, height_m):
            super().__init__(rect, doors, height_m)
            drawn.append(rect)

    monkeypatch.setattr(module, "Room", Noted)
    shares, reached = [], []
    for seed in range(3):
        drawn.clear()
        free, x, y = floor_grid(draw_world(name, seed, SIZES[name], 0.5, NOWHERE), 0.16)
        labels, _ = ndimage.label(free)
        largest = np.bincount(labels.reshape(-1))[1:].argmax() + 1
        shares.append((labels == largest).sum() / free.sum())
        for rect in drawn:
            inside = np.ix_((x > rect.x0) & (x < rect.x1), (y > rect.y0) & (y < rect.y1))
            reached.append(bool((labels[inside] == largest).any()))
    assert np.mean(shares) >= 0.85
    assert np.mean(reached) >= 0.95
    assert len(reached) > 20


@pytest.mark.slow
@pytest.mark.parametrize("name", FAMILIES)
def test_furnishings_make_way_for_kept_places_and_for_nothing_else(name):
    layout = layout_of(name, 2, 1.0)
    low, high = layout.region_m
    places = np.random.default_rng(1).uniform(low, high, (6, 3)) * [1.0, 1.0, 0.0]
    kept = layout.mesh(places)
    assert len(kept.faces) < len(layout.mesh(NOWHERE).faces)
    fixed = sum(len(mesh.faces) for mesh in layout.structure)
    loose = kept.vertices_m[kept.faces[fixed:]]  # structure comes first
    for place in places:
        gap = np.maximum(np.maximum(loose.min(axis=1) - place, place - loose.max(axis=1)), 0.0)
        assert np.hypot(gap[:, 0], gap[:, 1])[gap[:, 2] < 2.6].min() >= CLEAR_M - 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize("size_m", [(8.0, 8.0), (12.0, 30.0), (40.0, 20.0)])
def test_other_sizes_are_drawn_and_stay_within_bounds(name, size_m):
    layout = layout_of(name, 0, 0.7, size_m)
    for mesh in layout.furnishings:
        assert (mesh.vertices_m[:, :2] >= layout.region_m[0, :2]).all()
        assert (mesh.vertices_m[:, :2] <= layout.region_m[1, :2]).all()
        assert mesh.vertices_m[:, 2].min() > 0.0
    assert len(layout.furnishings) > 10


@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize("size_m", [(3.0, 12.0), (float("nan"), 12.0)])
def test_a_floor_too_small_for_a_plan_is_refused_in_a_sentence(name, size_m):
    with pytest.raises(BadInput, match=r"too small for this family"):
        layout_of(name, 0, 0.5, size_m)
