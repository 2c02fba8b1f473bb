import numpy as np
import pytest

from sim.worlds.families.floor_plan import OUTSIDE, Rect, borders_of, spanning_doors, weighted_cuts
from sim.worlds.families.furnish import Piece, Room
from sim.worlds.families.furniture import block, table
from sim.worlds.families.walls import Opening, door_leaf, opening, slab, wall
from sim.worlds.meshes import merged

# Two rooms on the left, one on the right.
PLAN = [Rect(0.0, 0.0, 3.0, 2.0), Rect(0.0, 2.0, 3.0, 5.0), Rect(3.0, 0.0, 7.0, 5.0)]


def rng():
    return np.random.default_rng(7)


def test_borders_between_rooms_and_to_the_outside():
    borders = borders_of(PLAN)
    inner = {(b.first, b.second, b.along, b.at_m, b.low_m, b.high_m) for b in borders if b.second != OUTSIDE}
    assert inner == {(0, 1, 0, 2.0, 0.0, 3.0), (0, 2, 1, 3.0, 0.0, 2.0), (1, 2, 1, 3.0, 2.0, 5.0)}
    assert sum(b.length_m for b in borders if b.second == OUTSIDE) == pytest.approx(24.0)


def test_doors_reach_each_room_once_and_shun_short_borders():
    borders = borders_of(PLAN)
    doors = spanning_doors(rng(), borders, {2}, lambda a, b: 1.0, 2.5)
    assert sorted((d.first, d.second) for d in doors) == [(0, 1), (1, 2)]  # 0 to 2 is only 2 m long
    assert spanning_doors(rng(), borders, {2}, lambda a, b: 1.0, 3.5) == []
    assert spanning_doors(rng(), borders, {2}, lambda a, b: 0.0, 1.0) == []


def test_cuts_are_uneven_and_in_order():
    cuts = weighted_cuts(rng(), 1.0, 9.0, 4, 0.3)
    widths = np.diff([1.0, *cuts, 9.0])
    assert len(cuts) == 3
    assert widths.min() > 1.0
    assert widths.max() - widths.min() > 0.05


def test_a_wall_is_open_at_its_door_and_solid_over_it():
    border = borders_of(PLAN)[1]  # between 0 and 2
    hole = opening(rng(), border, 1.0, 0.0, 2.1)
    assert border.low_m + 0.25 <= hole.low_m < hole.high_m <= border.high_m - 0.25
    parts = wall(border, [hole], Rect(0.0, 0.0, 7.0, 5.0), 0.06, 2.7)
    bounds = np.array([[p.vertices_m.min(axis=0), p.vertices_m.max(axis=0)] for p in parts])
    assert bounds[:, :, 0] == pytest.approx(np.tile([2.94, 3.06], (3, 1)))
    in_door = (bounds[:, 0, 1] < hole.high_m - 0.01) & (bounds[:, 1, 1] > hole.low_m + 0.01)
    assert bounds[in_door, 0, 2].tolist() == [2.1]


@pytest.mark.parametrize("into", [0, 2])
def test_a_door_leaf_leaves_its_opening_and_stands_on_the_side_it_was_swung_to(into):
    border = borders_of(PLAN)[1]
    hole = Opening(border, 0.5, 1.5, 0.0, 2.1)
    for seed in range(20):
        leaf = door_leaf(np.random.default_rng(seed), hole, 0.06, into)
        x, y = leaf.vertices_m[:, 0], leaf.vertices_m[:, 1]
        assert x.max() < 3.0 if into == 0 else x.min() > 3.0
        in_front = (y > 0.62) & (y < 1.38)
        assert not in_front.any()
        assert abs(x - 3.0).max() > 0.8


def test_a_slab_fills_its_box():
    mesh = slab(Rect(-3.0, -2.5, 3.0, 2.5), -0.2, 0.0)
    p, q, r = (mesh.vertices_m[mesh.faces[:, k]] for k in range(3))
    assert (p * np.cross(q, r)).sum() / 6.0 == pytest.approx(6.0 * 5.0 * 0.2)
    assert np.linalg.norm(q - p, axis=1).max() < 3.0


def room(width_m=4.0):
    border = borders_of([Rect(0.0, 0.0, width_m, 4.0), Rect(0.0, 4.0, width_m, 8.0)])[0]
    return Room(Rect(0.0, 0.0, width_m, 4.0), [Opening(border, 1.5, 2.5, 0.0, 2.1)], 2.6)


def test_furniture_keeps_off_doorways_walls_and_other_furniture():
    here, chest = room(), Piece([block(0.0, 0.0, 0.01, 0.8, 1.0, 0.5)])
    assert not here.put(chest, 2.0, 3.6)  # before the door
    assert not here.put(chest, 0.4, 1.0)  # through the wall
    assert here.put(chest, 2.0, 0.3)
    assert not here.put(chest, 2.5, 0.5)  # through the first
    assert len(here.placed) == 1


def test_furniture_does_not_cut_the_floor_in_two_but_a_table_spans_it():
    bar = Piece([block(0.0, 0.0, 0.01, 1.0, 3.9, 0.3)])
    assert not room().put(bar, 2.0, 1.6)
    assert room().put(Piece([block(0.0, 0.0, 0.9, 1.0, 3.9, 0.3)]), 2.0, 1.6)  # driven under
    assert room().put(Piece([block(0.0, 0.0, 0.003, 0.03, 3.9, 0.3)]), 2.0, 1.6)  # driven over
    assert room().put(Piece(table(3.6, 0.9, 0.75)), 2.0, 1.6)
    assert not room(1.3).put(Piece(table(0.8, 0.5, 0.75)), 0.65, 1.6)  # too narrow between its legs


def test_a_piece_at_a_wall_turns_its_back_to_it():
    backed = Piece([block(0.0, 0.0, 0.01, 0.4, 0.8, 0.4), block(0.0, -0.15, 0.4, 0.8, 0.8, 0.1)])
    for seed in range(12):
        here = room()
        assert here.at_wall(np.random.default_rng(seed), backed, 20) is not None
        back = merged(here.placed).vertices_m
        rest = back[back[:, 2] > 0.5]
        gap = min(rest[:, 0].min(), rest[:, 1].min(), 4.0 - rest[:, 0].max(), 4.0 - rest[:, 1].max())
        assert gap == pytest.approx(0.02, abs=1e-6)
