from __future__ import annotations

import numpy as np

from labr_autonomy.perception.fields import Field2
from labr_autonomy.perception.memory import Memory


def around(x, y, *, wall_x=None, side=200):
    """What is seen round a place: all of it, and a wall across."""
    origin = np.floor(np.array([x, y]) / 0.1) * 0.1 - 0.05 * side
    occupied = np.zeros((side, side), bool)
    if wall_x is not None:
        i = round((wall_x - origin[0]) / 0.1)
        if 0 <= i < side:
            occupied[i] = True
    return Field2.from_occupied(occupied, np.ones_like(occupied), origin, 0.1)


def test_what_left_the_map_is_still_planned_with():
    memory = Memory(0.1)
    memory.remember(around(0.0, 0.0, wall_x=3.0), np.zeros(2))
    memory.remember(around(16.0, 0.0), np.array([16.0, 0.0]))
    plan, _ = memory.plan(np.array([20.0, 2.0]))
    places = np.array([[3.05, 0.0], [2.0, 0.0], [16.0, 0.0]])
    assert plan.lookup(places)[0] < 0.0 < plan.lookup(places)[1]
    assert plan.is_known(places).all()
    assert plan.contains(np.array([[20.0, 2.0], [22.9, 4.9]])).all()


def test_what_is_seen_anew_counts_and_what_is_unknown_again_does_not():
    memory = Memory(0.1)
    memory.remember(around(0.0, 0.0, wall_x=3.0), np.zeros(2))
    forgotten = around(0.0, 0.0)
    unknown = Field2(forgotten.distance_m, np.zeros_like(forgotten.known), forgotten.origin_m, 0.1)
    memory.remember(unknown, np.zeros(2))
    at_wall = np.array([[3.05, 0.0]])
    assert memory.plan(np.zeros(2))[0].lookup(at_wall)[0] < 0.0
    memory.remember(around(0.0, 0.0), np.zeros(2))
    assert memory.plan(np.zeros(2))[0].lookup(at_wall)[0] > 1.0


def test_the_rim_of_the_map_is_not_believed():
    memory = Memory(0.1)
    memory.remember(around(0.0, 0.0), np.zeros(2))
    plan, _ = memory.plan(np.zeros(2))
    assert plan.is_known(np.array([[8.9, 0.0], [9.5, 0.0]])).tolist() == [True, False]


def test_it_follows_a_robot_that_goes_far():
    memory = Memory(0.1)
    for x in np.arange(0.0, 100.0, 2.0):
        memory.remember(around(x, 0.0, wall_x=50.0), np.array([x, 0.0]))
    plan, _ = memory.plan(np.array([105.0, 0.0]))
    assert plan.lookup(np.array([[95.0, 0.0]]))[0] > 1.0
    assert plan.origin_m[0] > 30.0
    assert plan.is_known(np.array([[80.0, 0.0]]))[0]


def test_a_wall_seen_higher_up_is_likely_solid_below_until_that_is_seen_and_moves_with_the_plan():
    memory = Memory(0.1)
    wall = np.array([[12.05, y + 0.05] for y in np.arange(-2.0, 2.0, 0.1)])
    memory.remember(around(0.0, 0.0), np.zeros(2), wall)
    for place in (np.zeros(2), np.array([0.0, 20.0])):
        memory.remember(around(*place), place)
        plan, likely = memory.plan(np.array([13.0, 0.0]))
        cells = np.floor((wall - plan.origin_m) / 0.1).astype(int)
        assert likely[tuple(cells.T)].all()
        assert likely.sum() == len(wall)
    memory.remember(around(6.0, 0.0), np.array([6.0, 0.0]))
    assert not memory.plan(np.zeros(2))[1].any()


def test_what_stood_there_is_gone_only_where_the_floor_was_seen_long_enough():
    memory, at_wall, beside = Memory(0.1), np.array([[3.05, 1.05]]), np.array([[2.55, 1.05]])
    memory.remember(around(0.0, 0.0, wall_x=3.0), np.zeros(2))
    free = around(0.0, 0.0)
    memory.remember(free, np.zeros(2), None, np.zeros_like(free.known))
    plan, _ = memory.plan(np.zeros(2))
    assert plan.lookup(at_wall)[0] < 0.1, "the floor round it was seen again, it was not yet"
    assert plan.lookup(beside)[0] > 1.0
    memory.remember(free, np.zeros(2), None, np.ones_like(free.known))
    assert memory.plan(np.zeros(2))[0].lookup(at_wall)[0] > 1.0
