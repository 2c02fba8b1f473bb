"""Rooms with boxes, for the tests of this folder: occupancy, fields and perfect execution of trajectories."""

from __future__ import annotations

import numpy as np

from labr_autonomy.perception.fields import Field2, Field3
from labr_autonomy.refine.search import CostToGo

CELL_M = 0.1


def boxes2(boxes, size_m=(10.0, 10.0), walls=True, unknown=()):
    """Field2 of axis-aligned boxes (x0, y0, x1, y1); `unknown` are boxes the map has not seen."""
    shape = tuple(round(s / CELL_M) for s in size_m)
    occupied, known = np.zeros(shape, bool), np.ones(shape, bool)
    if walls:
        occupied[[0, -1], :] = occupied[:, [0, -1]] = True
    for x0, y0, x1, y1 in boxes:
        a = np.maximum(np.round(np.array([x0, y0, x1, y1]) / CELL_M).astype(int), 0)
        occupied[a[0] : a[2], a[1] : a[3]] = True
    for x0, y0, x1, y1 in unknown:
        a = np.maximum(np.round(np.array([x0, y0, x1, y1]) / CELL_M).astype(int), 0)
        known[a[0] : a[2], a[1] : a[3]] = False
    return Field2.from_occupied(occupied, known, np.zeros(2), CELL_M)


def boxes3(boxes, size_m=(10.0, 10.0, 3.0)):
    """Field3 of boxes (x0, y0, z0, x1, y1, z1) over a floor cell layer."""
    shape = tuple(round(s / CELL_M) for s in size_m)
    occupied = np.zeros(shape, bool)
    occupied[:, :, 0] = True
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    for box in boxes:
        a = np.clip(np.round(np.array(box) / CELL_M).astype(int), 0, [*shape, *shape])
        occupied[a[0] : a[3], a[1] : a[4], a[2] : a[5]] = True
    # the floor cells lie below z = 0
    return Field3.from_occupied(occupied, np.ones(shape, bool), np.array([0.0, 0.0, -CELL_M]), CELL_M)


def random_boxes(seed, start, goal, count=10):
    """Boxes (x0, y0, x1, y1) in a 10 m room that leave 0.9 m around start and goal."""
    rng = np.random.default_rng(seed)
    out = []
    while len(out) < count:
        centre, half = rng.uniform([1.5, 1.0], [8.5, 9.0]), rng.uniform(0.15, 0.6, 2)
        gap = [np.linalg.norm(np.maximum(np.abs(np.array(p) - centre) - half, 0.0)) for p in (start, goal)]
        if min(gap) > 0.9:
            out.append((*(centre - half), *(centre + half)))
    return out


def shortest_way(field, start_xy, goal_xy, radius_m, **how):
    """One shortest drivable path (k, 2), None without one."""
    return CostToGo(field, goal_xy, radius_m, **how).path(start_xy)
