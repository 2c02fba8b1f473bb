"""The two tasks of the paper's Table III, as fixed scenes: a furnished hall, one goal each.

The paper's laboratory is not public. What it says of the tasks is kept: a goal on the floor behind obstacles,
for which its methods travel 7.5 to 10.7 m, and a goal in the air out of the camera's reach, for which they
travel 8.6 to 9.0 m.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from labr_autonomy.config import RobotConfig
from labr_autonomy.modes.energy import EnergyModel
from labr_autonomy.types import Array
from sim.lockstep.trial import Task
from sim.worlds.build import build_world
from sim.worlds.solids import OVERHEAD_M, generate_scene
from sim.worlds.surface import Surface

SIZE_M = (12.0, 8.0)
_CELL_M = 0.05
_STEPS = ((1, 0), (0, 1), (1, 1), (1, -1))


@dataclass(frozen=True, slots=True)
class SceneTask:
    """One of the two tasks."""

    name: str  # "land" or "air"
    world_seed: int  # chosen so that the way is not straight and the goal is out of sight
    start: tuple[float, float, float]  # x, y [m], yaw [rad], odom
    goal_xy_m: tuple[float, float]
    height_m: float | None  # of the body above the floor at the goal; None on the floor


SCENES = {
    "land": SceneTask("land", 23, (-3.6, -1.5, 0.0), (3.4, 0.8), None),
    "air": SceneTask("air", 32, (-3.8, 1.5, 0.0), (3.6, -1.0), 1.5),
}


def scene_task(name: str, noise_seed: int, robot: RobotConfig) -> Task:
    """One of the tasks, with the noise and disturbances of a seed.

    Args:
        name: A key of `SCENES`.
        noise_seed: Of the trial; the scene is always the same.
        robot: Its outline and its energy model.
    """
    scene = SCENES[name]
    x_m, y_m, yaw_rad = scene.start
    gx_m, gy_m = scene.goal_xy_m
    in_air = scene.height_m is not None
    z_m = scene.height_m if scene.height_m is not None else robot.body.below_m
    places = [(x_m, y_m, 0.0), (gx_m, gy_m, 0.0)]
    world = build_world({"family": "hall", "size_m": SIZE_M}, seed=scene.world_seed, clear_m=places)
    eye = np.array([x_m, y_m, robot.body.below_m + robot.camera.z_m])
    start, goal = np.array([x_m, y_m, robot.body.below_m]), np.array([gx_m, gy_m, z_m])
    turn = math.atan2(gy_m - y_m, gx_m - x_m) - yaw_rad
    half_view = math.atan(robot.camera.width / (2.0 * robot.camera.fx))
    looks_that_way = abs(math.remainder(turn, math.tau)) < half_view
    drive_m = _way(scene, robot)
    climb_m = z_m - robot.body.below_m
    model = EnergyModel.of(robot)
    bound_j = model.land_j(drive_m) + (
        model.transition_j() + model.air_j(climb_m, climb_m) if in_air else 0.0
    )
    lift_s = model.transition_s + climb_m / robot.air.climb_mps if in_air else 0.0
    return Task(
        world=world.spec,
        seed=noise_seed,
        start=(x_m, y_m, yaw_rad, 0.0),
        goal_m=(gx_m, gy_m, z_m),
        in_air=in_air,
        in_sight=looks_that_way and Surface(world, robot.body).sees(eye, goal),
        distance_m=float(np.linalg.norm(goal - start)),
        shortest_m=drive_m + climb_m,
        bound_j=bound_j,
        bound_s=drive_m / robot.land.speed_mps + lift_s,
    )


def _way(scene: SceneTask, robot: RobotConfig) -> float:
    """Shortest way on the floor for the robot's outline [m]: the grid's, pulled straight where it can be."""
    places = np.array([[*scene.start[:2], 0.0], [*scene.goal_xy_m, 0.0]])
    solids = generate_scene("hall", scene.world_seed, SIZE_M, places)
    needed_m = robot.body.radius_m + robot.clearance.hard_m
    axes = [np.arange(-0.5 * s + 0.5 * _CELL_M, 0.5 * s, _CELL_M) for s in SIZE_M]
    centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    free = solids.footprint_distance(centres, OVERHEAD_M) > needed_m
    index = np.arange(free.size).reshape(free.shape)
    rows, columns, lengths = [], [], []
    for i, j in _STEPS:
        here = np.s_[: free.shape[0] - i, max(0, -j) : free.shape[1] - max(0, j)]
        there = np.s_[i:, max(0, j) : free.shape[1] - max(0, -j)]
        both = free[here] & free[there]
        rows.append(index[here][both])
        columns.append(index[there][both])
        lengths.append(np.full(int(both.sum()), math.hypot(i, j) * _CELL_M))
    ends = np.concatenate(rows), np.concatenate(columns)
    graph = sparse.coo_array((np.concatenate(lengths), ends), shape=(free.size, free.size)).tocsr()
    low = np.array([axes[0][0], axes[1][0]])
    first, last = (int(index[tuple(np.rint((p[:2] - low) / _CELL_M).astype(int))]) for p in places)
    _, before = csgraph.dijkstra(graph, directed=False, indices=first, return_predecessors=True)
    cells = [last]
    while cells[-1] != first:  # the hall keeps its places connected
        cells.append(int(before[cells[-1]]))
    path = centres.reshape(-1, 2)[cells[::-1]]
    path[0], path[-1] = places[0, :2], places[1, :2]

    def passable(a: Array, b: Array) -> bool:
        count = int(np.linalg.norm(b - a) / (0.5 * _CELL_M)) + 2
        between = a + np.linspace(0.0, 1.0, count)[:, None] * (b - a)
        i, j = np.rint((between - low) / _CELL_M).astype(int).T
        return bool(free[i, j].all())

    return _pulled(path, passable)


def _pulled(path: Array, passable: Callable[[Array, Array], bool]) -> float:
    """Length of a path (n, 2) after every corner that is not needed has been left out [m]."""
    length, here = 0.0, 0
    while here < len(path) - 1:
        ahead = len(path) - 1
        while ahead > here + 1 and not passable(path[here], path[ahead]):
            ahead -= 1
        length += float(np.linalg.norm(path[ahead] - path[here]))
        here = ahead
    return length
