import numpy as np
import pytest

from labr_autonomy.config import Body
from sim.worlds.families import furniture, home, office
from sim.worlds.meshes import Mesh, merged
from sim.worlds.surface import Surface
from sim.worlds.world import make_world

DRAWN = [
    furniture.chair,
    furniture.stool,
    furniture.plant,
    furniture.cartons,
    furniture.bin_,
    furniture.floor_lamp,
    home.island,
    home.fridge,
    home.bathtub,
    home.basin,
    home.tv_stand,
    home.coffee_table,
    home.wardrobe,
    home.shoe,
    home.bag,
    home.ball,
    home.toys,
    home.basket,
    office.office_chair,
    office.whiteboard,
    office.bench,
]
CLUTTER = [home.shoe, home.bag, home.ball, home.toys]


def volume_m3(mesh: Mesh) -> float:
    p, q, r = (mesh.vertices_m[mesh.faces[:, k]] - mesh.vertices_m.mean(axis=0) for k in range(3))
    return float((p * np.cross(q, r)).sum() / 6.0)


def surface_of(*meshes: Mesh) -> Surface:
    mesh = merged(meshes)
    return Surface(make_world("piece", mesh.vertices_m, mesh.faces, {}))


@pytest.mark.parametrize("make", DRAWN, ids=lambda make: make.__name__)
def test_a_piece_stands_on_the_floor_about_its_origin_in_parts_wound_outwards(make):
    for seed in range(3):
        parts = make(np.random.default_rng(seed))
        assert min(volume_m3(part) for part in parts) > 0.0
        whole = merged(parts)
        assert 0.0 < whole.vertices_m[:, 2].min() < 0.01
        assert whole.vertices_m[:, 2].max() < 2.4
        assert np.abs(whole.vertices_m[:, :2].mean(axis=0)).max() < 0.35


def test_clutter_is_5_to_40_cm_high():
    highs = [
        merged(make(np.random.default_rng(s))).vertices_m[:, 2].max() for make in CLUTTER for s in range(8)
    ]
    assert min(highs) >= 0.05
    assert max(highs) <= 0.41


def test_chairs_have_legs_of_2_to_3_cm():
    for seed in range(5):
        parts = furniture.chair(np.random.default_rng(seed))
        widths = [np.ptp(p.vertices_m[:, 0]) for p in parts if p.vertices_m[:, 2].min() < 0.01]
        assert len(widths) == 4
        assert 0.02 <= min(widths) <= max(widths) <= 0.03


@pytest.mark.parametrize(("high_m", "under"), [(0.75, True), (0.36, True), (0.20, False)])
def test_a_robot_drives_under_a_table_that_is_high_enough(high_m, under):
    surface = surface_of(*furniture.table(1.3, 0.9, high_m))
    clearance = surface.clearance(np.array([0.0, 0.0, Body().below_m]), on_floor=True)
    assert (clearance > 0.02) == under


def test_stairs_are_one_closed_solid_of_the_right_volume_with_level_treads():
    flight = home.stairs(0.95, 0.27, 0.18, 12)
    edges = np.concatenate([flight.faces[:, [0, 1]], flight.faces[:, [1, 2]], flight.faces[:, [2, 0]]])
    pairs = {tuple(edge) for edge in edges.tolist()}
    assert len(pairs) == len(edges)
    assert pairs == {(b, a) for a, b in pairs}
    assert volume_m3(flight) == pytest.approx(0.95 * 0.27 * 0.18 * 12 * 13 / 2)
    surface = surface_of(flight)
    for step in range(12):
        x = 0.27 * (step + 0.5)
        top = furniture.FEET_M + 0.18 * (step + 1)
        assert surface.floor_below(x, 0.1, 3.0) == pytest.approx(top, abs=1e-4)
        assert surface.inside(np.array([x, 0.1, top - 0.1]))
        assert not surface.inside(np.array([x, 0.1, top + 0.1]))
