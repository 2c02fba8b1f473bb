import numpy as np
import pytest
from scipy import ndimage

from labr_autonomy.errors import BadInput
from sim.worlds.solids import FAMILIES, generate, generate_scene

PLACES = np.array([[-5.5, -3.5, 0.0], [4.5, 3.0, 0.0], [0.0, -3.0, 1.5], [5.5, -3.8, 0.0]])
SIZE = (14.0, 10.0)


@pytest.mark.parametrize("family", FAMILIES)
def test_same_seed_same_world_and_another_seed_another(family):
    a, b, c = (generate(family, seed, SIZE, PLACES) for seed in (3, 3, 4))
    assert a.vertices_m.tobytes() == b.vertices_m.tobytes()
    assert a.faces.tobytes() == b.faces.tobytes()
    assert a.spec == {"family": family, "seed": 3, "size_m": [14.0, 10.0]}
    assert a.vertices_m.shape != c.vertices_m.shape or (a.vertices_m != c.vertices_m).any()


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_hall_floor_connects_all_places_for_a_wide_cylinder(seed):
    """Checked on a grid of its own, off the generator's, with the robot's own slightly smaller radius."""
    scene = generate_scene("hall", seed, SIZE, PLACES)
    cell = 0.04
    x, y = np.arange(-6.99, 7.0, cell), np.arange(-4.99, 5.0, cell)
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    labels, _ = ndimage.label(scene.footprint_distance(grid, 1.0) > 0.42)
    cells = np.rint((PLACES[:, :2] - [x[0], y[0]]) / cell).astype(int)
    found = labels[cells[:, 0], cells[:, 1]]
    assert found[0] > 0
    assert (found == found[0]).all()
    assert len(scene.rows) > 12  # four outer walls, and something to drive round


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("seed", range(3))
def test_places_keep_their_free_radius_over_the_whole_height(family, seed):
    scene = generate_scene(family, seed, SIZE, PLACES)
    assert scene.footprint_distance(PLACES[:, :2]).min() >= 0.9


def test_hall_has_outer_walls_and_low_and_high_things():
    tops = []
    for seed in range(4):
        scene = generate_scene("hall", seed, SIZE, np.zeros((0, 3)))
        assert scene.distance(np.array([[7.05, 0, 1], [-7.05, 0, 1], [0, 5.05, 1], [0, -5.05, 1]])).max() < 0
        tops += list(scene.rows[4:, 3] + scene.rows[4:, 6])
    assert min(tops) < 0.8
    assert max(tops) > 2.0


def test_an_unknown_family_and_a_place_in_the_wall_are_refused_in_a_sentence():
    with pytest.raises(BadInput, match=r"no world family 'cave'.*hall"):
        generate("cave", 1, SIZE, PLACES)
    with pytest.raises(BadInput, match=r"lies outside a hall of 14 x 10 m"):
        generate("hall", 1, SIZE, np.array([[6.9, 0.0, 0.0]]))
