"""What garage and forest have in common: repeatable, closed, floored, free to move in, within budget."""

import numpy as np
import pytest
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from labr_autonomy.errors import BadInput
from sim.worlds.build import build_world, rebuild_world
from sim.worlds.families.draw import SIZES, family_of
from sim.worlds.families.layout import CLEAR_M
from sim.worlds.meshes import merged
from sim.worlds.surface import Surface
from sim.worlds.world import make_world

FAMILIES = ("garage", "forest")
TRIANGLES_MAX = {"garage": 30_000, "forest": 60_000}
NOWHERE = np.zeros((0, 3))
FLOORS_BELOW_M = {"garage": 0.6, "forest": 5.0}  # under the beams of a half-deck; over the hills
STAND_M = 0.12  # body origin over the floor


def layout(family, seed, difficulty=0.5, size_m=None):
    rng = np.random.default_rng([seed, *family.encode()])
    return family_of(family)(rng, size_m or SIZES[family], difficulty)


def edge_counts(faces):
    """How often each directed edge occurs, and how often its reverse does."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    n = int(faces.max()) + 1
    there, back = edges[:, 0] * n + edges[:, 1], edges[:, 1] * n + edges[:, 0]
    _, counts = np.unique(there, return_counts=True)
    return counts, np.array_equal(np.sort(there), np.sort(back))


def volumes(mesh):
    """Signed volume of every connected part; positive where faces are wound outwards."""
    n = len(mesh.vertices_m)
    a, b, c = mesh.faces.T
    graph = coo_array((np.ones(2 * len(a)), (np.r_[a, b], np.r_[b, c])), shape=(n, n))
    count, part = connected_components(graph, directed=False)
    corners = mesh.vertices_m[mesh.faces] - mesh.vertices_m.mean(axis=0)
    six = (corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])).sum(axis=1)
    return np.bincount(part[a], six, count) / 6.0


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_same_seed_same_bytes_and_another_seed_another_world(family):
    a, b, c = (build_world({"family": family}, seed=seed) for seed in (3, 3, 4))
    again = rebuild_world(a.spec)
    for other in (b, again):
        assert a.vertices_m.tobytes() == other.vertices_m.tobytes()
        assert a.faces.tobytes() == other.faces.tobytes()
        assert np.array_equal(a.region_m, other.region_m)
    assert a.vertices_m.tobytes() != c.vertices_m.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("seed", range(6))
def test_every_piece_is_closed_and_wound_outwards(family, seed):
    drawn = layout(family, seed, 1.0)
    for mesh in drawn.structure + drawn.furnishings:
        counts, paired = edge_counts(mesh.faces)
        assert counts.max() == 1
        assert paired
        assert volumes(mesh).min() > 0.0
        assert np.isfinite(mesh.vertices_m).all()


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("difficulty", [0.0, 0.5, 1.0])
def test_triangles_stay_within_the_budget(family, difficulty):
    for seed in range(6):
        faces = layout(family, seed, difficulty).mesh(NOWHERE).faces
        assert 1000 < len(faces) <= TRIANGLES_MAX[family]


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_a_harder_world_holds_more(family):
    counts = [sum(len(layout(family, seed, d).furnishings) for seed in range(6)) for d in (0.0, 0.5, 1.0)]
    assert counts[0] * 1.2 < counts[1]
    assert counts[1] * 1.1 < counts[2]


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("seed", range(4))
def test_there_is_a_floor_under_the_whole_region(family, seed):
    world = build_world({"family": family}, seed=seed)
    surface = Surface(world)
    (x0, y0, z0), (x1, y1, z1) = world.region_m
    assert (world.region_m[0] > world.lower_m).all()
    assert (world.region_m[1] < world.upper_m).all()
    floors = [surface.floor_below(x, y, z1) for x in np.linspace(x0, x1, 25) for y in np.linspace(y0, y1, 25)]
    assert min(floors) >= z0 - 1e-4
    assert max(floors) <= z1 + 2e-3


def free_ground(drawn, cell_m, from_m):
    """Whether the robot can stand at places of a grid over the region, on the floor that the structure is."""
    whole, bare = (
        Surface(make_world("", *mesh, {})) for mesh in (drawn.mesh(NOWHERE), merged(drawn.structure))
    )
    lower, upper = drawn.region_m[0] + 0.3, drawn.region_m[1] - 0.3
    x, y = np.arange(lower[0], upper[0], cell_m), np.arange(lower[1], upper[1], cell_m)
    free = np.zeros((len(x), len(y)), dtype=bool)
    for i, a in enumerate(x):
        for j, b in enumerate(y):
            place = np.array([a, b, bare.floor_below(a, b, from_m) + STAND_M])
            touches = whole.clearance(place, on_floor=True, reach_m=0.05) <= 0.0
            free[i, j] = not touches and not whole.inside(place)
    return free


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("seed", [0, 1, 2, 4])
def test_most_of_the_ground_is_free_and_connected(family, seed):
    free = free_ground(layout(family, seed, 0.4), 0.35, FLOORS_BELOW_M[family])
    labels, count = ndimage.label(free)
    assert count
    assert np.bincount(labels.ravel())[1:].max() >= 0.85 * free.sum()
    assert free.mean() >= 0.45


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("seed", range(4))
def test_furnishings_make_way_for_kept_places(family, seed):
    drawn = layout(family, seed, 1.0)
    corners = [(f.vertices_m.min(axis=0), f.vertices_m.max(axis=0)) for f in drawn.furnishings[::9]]
    kept = np.array([[*(0.5 * (low + high))[:2], low[2]] for low, high in corners])
    before, after = drawn.mesh(NOWHERE), drawn.mesh(kept)
    assert len(after.faces) < len(before.faces)
    fixed = sum(len(m.faces) for m in drawn.structure)
    rest = after.vertices_m[after.faces[fixed:]].reshape(-1, 3)
    for place in kept:
        beside = np.hypot(*(rest[:, :2] - place[:2]).T)
        level = (rest[:, 2] > place[2] - 0.5) & (rest[:, 2] < place[2] + 2.0)
        assert beside[level].min() >= CLEAR_M


@pytest.mark.parametrize("family", FAMILIES)
def test_other_sizes_fill_their_extents_and_too_small_ones_are_refused(family):
    drawn = layout(family, 1, size_m=(20.0, 16.0))
    assert (drawn.region_m[1, :2] - drawn.region_m[0, :2] >= [15.0, 11.0]).all()
    with pytest.raises(BadInput, match="has no room"):
        layout(family, 1, size_m=(6.0, 6.0))
