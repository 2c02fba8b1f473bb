"""Tasks by seed: where a robot starts and what it is asked to reach, verified by the world's truth.

Starts lie on floors, not on platforms. The straight distance is drawn evenly from what the world offers, then
a start and a goal that far apart. Half of the goals are in the air; nine in ten land goals can be driven to,
the rest need a hop where the world has floors that only flight joins; six in ten goals are out of the
camera's sight at the start, the others in sight, as far as the world allows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput
from labr_autonomy.frames import body_to_odom, odom_to_level, quaternion_from_rpy
from labr_autonomy.types import Array, Pose
from sim.bench.known import Known, know
from sim.lockstep.trial import Task
from sim.movers.place import movers_for

DISTANCE_M = (4.0, 25.0)
HEIGHT_M = (0.8, 2.2)  # of an air goal above the floor below
LAND_CLEAR_M = 0.15
AIR_CLEAR_M = 0.25
HOVER_M = 0.36  # of the middle of an air goal to any surface: the sphere about the outline and some
FACE_M = 0.6  # nothing nearer in front of the camera at the start
AIR_SHARE = 0.5
HIDDEN_SHARE = 0.6
DRIVEN_SHARE = 0.9
STOREY_M = 0.6  # a floor this much higher or lower than any that can be driven to is another storey
BAND_M = 0.4  # half width of the ring in which a goal of a drawn distance is looked for
STARTS, DRAWS = 60, 20
INSIST = 20  # starts that are tried for a goal in sight, or out of it, as drawn
LOOSE_AFTER = 40  # starts without a goal at the drawn distance; then any distance will do
_STREAM = 71  # of random numbers, so that tasks share none with worlds or noise

Start = tuple[float, float, float, float]  # x, y [m], yaw [rad], floor z [m], odom
Goal = tuple[Array, bool]  # body origin (3,) odom, in the air


@dataclass(frozen=True, slots=True)
class _Wish:
    """What was drawn before a place was looked for."""

    distance_m: float | None  # None: any
    in_air: bool
    hidden: bool
    driven: bool


def sample_task(spec: Mapping[str, Any], seed: int, robot: RobotConfig) -> Task:
    """The task of a seed.

    Args:
        spec: What `build_world` takes. A family without "seed" is drawn from the task's own. A mesh may say
            "start" [x, y, yaw in degrees] or [x, y, yaw in radians, floor z], "goals" [[x, y] on the floor or
            [x, y, z] in the air, ...] and "bounds"; goals are taken in turn by seed. Any may say "movers",
            how many people and boxes walk across the way: task and world are the same with and without.
        seed: Of the trial.
        robot: Its outline, camera and powers.

    Raises:
        BadInput: when the world offers no task.
    """
    wanted = {key: value for key, value in spec.items() if key != "movers"}
    if "family" in spec:
        wanted["seed"] = spec.get("seed", seed)
    known = know(wanted, robot)
    task = _sample(known, seed, robot)
    begin = (task.start[0], task.start[1], task.start[3] + robot.body.below_m)
    count, places = int(spec.get("movers", 0)), (begin, task.goal_m)
    movers = movers_for(count, seed, places, known.world, known.surface, robot, free=known.free)
    return replace(task, movers=tuple(mover.as_dict() for mover in movers)) if movers else task


def _sample(known: Known, seed: int, robot: RobotConfig) -> Task:
    """The task of a seed in a world, without movers."""
    rng = np.random.default_rng([seed, _STREAM])
    said = known.world.spec
    if not len(known.free.land.column):
        raise BadInput(
            f"the world '{known.world.name}' has no place to stand on", "Check its scale and its up axis."
        )
    wish = _draw_wish(known, rng)
    spare: list[tuple[Start, Goal]] = []  # possible, but not in sight, or not out of it, as drawn
    for turn in range(1 if "start" in said and "goals" in said else STARTS):
        start = _said_start(known, said["start"]) if "start" in said else _draw_start(known, rng, robot)
        if start is None:
            continue
        goal: Goal | None
        if "goals" in said:
            goal = _said_goal(known, start, said["goals"], seed)
        else:
            if turn == LOOSE_AFTER or ("start" in said and turn > 0):
                wish = replace(wish, distance_m=None)
            goal = _draw_goal(known, start, wish, rng, robot)
        if goal is None:
            continue
        fits = "goals" in said or in_sight(known, start, goal[0], robot) is not wish.hidden
        if not fits and turn < INSIST:
            spare.append((start, goal))
            continue
        task = _task(known, seed, start, goal, robot)
        if task is not None:
            return task
    for start, goal in spare:
        task = _task(known, seed, start, goal, robot)
        if task is not None:
            return task
    raise BadInput(
        f"the world '{known.world.name}' offers no goal that a robot can reach from its starts",
        f"Give it free floor over more than {DISTANCE_M[0]:g} m, or other bounds, start and goals.",
    )


def in_sight(known: Known, start: Start, goal_m: Array, robot: RobotConfig) -> bool:
    """Whether the camera of the robot at its start looks at the goal, and nothing stands between."""
    seen = _in_view(start, np.asarray(goal_m, dtype=np.float64)[None], robot)[0]
    return bool(seen) and known.surface.sees(_eye(start, robot), goal_m)


def _in_view(start: Start, points_m: Array, robot: RobotConfig) -> NDArray[np.bool_]:
    """Which points (n, 3) lie in the camera's frustum at the start, (n,)."""
    camera = robot.camera
    x, y, z = odom_to_level(points_m, Pose(_eye(start, robot), _facing(start))).T
    wide, high = 0.5 * camera.width / camera.fx, 0.5 * camera.height / camera.fy
    out: NDArray[np.bool_] = (x > 0.0) & (np.abs(y) <= x * wide) & (np.abs(z) <= x * high)
    return out


def _facing(start: Start) -> Array:
    return quaternion_from_rpy(0.0, 0.0, start[2])


def _eye(start: Start, robot: RobotConfig) -> Array:
    body = np.array([start[0], start[1], start[3] + robot.body.below_m])
    lens = np.array([[robot.camera.x_m, 0.0, robot.camera.z_m]])
    eye: Array = body_to_odom(lens, Pose(body, _facing(start)))[0]
    return eye


def _task(known: Known, seed: int, start: Start, goal: Goal, robot: RobotConfig) -> Task | None:
    """The task with the oracle's figures; None when there is no way."""
    goal_m, in_air = goal
    begin = np.array([start[0], start[1], start[3] + robot.body.below_m])
    route = known.router.route(begin, goal_m, goal_in_air=in_air)
    if route is None:
        return None
    shortest = min(route.length_m, known.router.shortest_m(begin, goal_m, goal_in_air=in_air))
    return Task(
        world=known.world.spec,
        seed=seed,
        start=start,
        goal_m=(float(goal_m[0]), float(goal_m[1]), float(goal_m[2])),
        in_air=in_air,
        in_sight=in_sight(known, start, goal_m, robot),
        distance_m=float(np.linalg.norm(goal_m - begin)),
        shortest_m=shortest,
        bound_j=route.bound_j,
        bound_s=route.bound_s,
    )


# ---------------------------------------------------------------------- drawn
def _draw_start(known: Known, rng: np.random.Generator, robot: RobotConfig) -> Start | None:
    """A place on a floor with room to turn, looking where something can be seen."""
    land = known.free.land
    floor = np.flatnonzero(known.free.land.ground)
    number = int(rng.choice(floor))
    place = known.places_m[number]
    if not _stands(known, place):
        return None
    for yaw in rng.uniform(-math.pi, math.pi, 8):
        start = (float(place[0]), float(place[1]), float(yaw), float(land.floor_z_m[number]))
        eye = _eye(start, robot)
        rays = yaw + np.array([-0.2, 0.0, 0.2])
        ahead = eye + FACE_M * np.column_stack([np.cos(rays), np.sin(rays), np.zeros(3)])
        if all(known.surface.sees(eye, to) for to in ahead):
            return start
    return None


def _draw_wish(known: Known, rng: np.random.Generator) -> _Wish:
    land = known.free.land
    turn = np.linspace(0.0, math.pi, 8, endpoint=False)
    spread = np.ptp(known.places_m[land.ground, :2] @ np.stack([np.cos(turn), np.sin(turn)]), axis=0)
    most = min(DISTANCE_M[1] - BAND_M, max(DISTANCE_M[0] + 2.0 * BAND_M, float(spread.max()) - 1.0))
    flying, hidden, driven = rng.random(3) < np.array([AIR_SHARE, HIDDEN_SHARE, DRIVEN_SHARE])
    return _Wish(float(rng.uniform(DISTANCE_M[0] + BAND_M, most)), bool(flying), bool(hidden), bool(driven))


def _draw_goal(
    known: Known, start: Start, wish: _Wish, rng: np.random.Generator, robot: RobotConfig
) -> Goal | None:
    """A goal as wished for, of the other kind once the distance does not matter any more."""
    for in_air in (wish.in_air, not wish.in_air):
        candidates = _in_air(known, start) if in_air else _on_land(known, start, wish.driven)
        found = _pick(known, start, candidates, in_air, wish, rng, robot)
        if found is not None:
            return found, in_air
        if wish.distance_m is not None:
            return None
    return None


def _pick(
    known: Known,
    start: Start,
    candidates_m: Array,
    in_air: bool,
    wish: _Wish,
    rng: np.random.Generator,
    robot: RobotConfig,
) -> Array | None:
    """One of the candidates (n, 3) at the wished distance, in sight or not as wished where one is."""
    begin = np.array([start[0], start[1], start[3] + robot.body.below_m])
    away = np.linalg.norm(candidates_m - begin, axis=1)
    low, high = DISTANCE_M
    if wish.distance_m is not None:
        low, high = wish.distance_m - BAND_M, wish.distance_m + BAND_M
    fits = np.flatnonzero((away >= low) & (away <= high))
    if not wish.hidden:
        looked_at = fits[_in_view(start, candidates_m[fits], robot)]
        fits = looked_at if len(looked_at) else fits
    spare: Array | None = None
    for number in rng.choice(fits, min(DRAWS, len(fits)), replace=False):
        goal: Array = candidates_m[number]
        if not _roomy(known, goal, in_air):
            continue
        if in_sight(known, start, goal, robot) is not wish.hidden:
            return goal
        spare = goal
    return spare


def _roomy(known: Known, goal_m: Array, in_air: bool) -> bool:
    """Exactly: the clearance that a goal must have."""
    surface = known.surface
    if not in_air:
        return _stands(known, goal_m)
    return bool(surface.clear(goal_m[None], AIR_CLEAR_M)[0] and surface.away(goal_m[None], HOVER_M)[0])


def _stands(known: Known, place_m: Array) -> bool:
    """Exactly: whether the robot can stand at a place (3,) with room to spare, on the floor as it slopes."""
    slope = np.array([known.surface.floor_slope(*(float(v) for v in place_m))])
    return bool(known.surface.clear(place_m[None], LAND_CLEAR_M, on_floor=True, slopes=slope)[0])


def _on_land(known: Known, start: Start, driven: bool) -> Array:
    """Places that can be driven to; or those that need a hop, where there are any."""
    land = known.free.land
    here = _place(known, start)
    if here is None:
        return np.zeros((0, 3))
    near = land.island == land.island[here]
    hop = land.ground & ~near & (land.reach == land.reach[here])
    hop &= _flown_over(land.floor_z_m, land.floor_z_m[near])
    out: Array = known.places_m[near if driven or not hop.any() else hop]
    return out


def _in_air(known: Known, start: Start) -> Array:
    """Cells that can be flown to, at the heights of goals."""
    here = _place(known, start)
    if here is None:
        return np.zeros((0, 3))
    land, height = known.free.land, known.cells_height_m
    fit = (height >= HEIGHT_M[0]) & (height <= HEIGHT_M[1]) & (known.cells_reach == land.reach[here])
    driven = land.floor_z_m[land.island == land.island[here]]
    fit &= _flown_over(known.cells_m[:, 2] - height, driven)
    out: Array = known.cells_m[fit]
    return out


def _flown_over(floor_z_m: Array, driven_z_m: Array) -> NDArray[np.bool_]:
    """Floors (n,) as high as those that can be driven to: a flight is bounded from where it began."""
    low, high = float(driven_z_m.min()) - STOREY_M, float(driven_z_m.max()) + STOREY_M
    within: NDArray[np.bool_] = (floor_z_m >= low) & (floor_z_m <= high)
    return within


def _place(known: Known, start: Start) -> int | None:
    return known.free.land.nearest(np.array(start[:2]), start[3], 0.2)


# ---------------------------------------------------------------------- given
def _said_start(known: Known, said: Sequence[float]) -> Start:
    """The start that a spec names; without a height on the lowest floor there."""
    name, land = known.world.name, known.free.land
    if len(said) not in (3, 4):
        raise BadInput(f"the start of '{name}' is {list(said)}", "Give [x, y, yaw_deg].")
    x, y = float(said[0]), float(said[1])
    if len(said) == 4:
        yaw, floors = float(said[2]), [float(said[3])]
    else:
        yaw = math.radians(float(said[2]))
        floors = sorted(_floors(known, x, y))
    places = [land.nearest(np.array([x, y]), z, 0.2) for z in floors]
    found = [place for place in places if place is not None]
    if not found:
        raise BadInput(f"the robot cannot stand at the start ({x:g}, {y:g}) of '{name}'", "Move the start.")
    return x, y, yaw, float(land.floor_z_m[found[0]])


def _said_goal(known: Known, start: Start, goals: Sequence[Sequence[float]], seed: int) -> Goal:
    """The goal whose turn it is; on land on the floor nearest in height to the start's."""
    goal, name = [float(v) for v in goals[seed % len(goals)]], known.world.name
    if len(goal) == 3:
        point = np.array(goal)
        if known.router.node(point, in_air=True) is None:
            raise BadInput(f"the robot cannot fly at the goal {goal} of '{name}'", "Move the goal.")
        return point, True
    floors = sorted(_floors(known, goal[0], goal[1]), key=lambda z: abs(z - start[3]))
    if not floors:
        raise BadInput(f"the robot cannot stand at the goal {goal} of '{name}'", "Move the goal.")
    return np.array([goal[0], goal[1], floors[0] + known.free.config.body.below_m]), False


def _floors(known: Known, x_m: float, y_m: float) -> list[float]:
    """Heights of the places at a point."""
    land = known.free.land
    near = np.hypot(*(known.places_m[:, :2] - np.array([x_m, y_m])).T) <= land.cell_m
    return [float(z) for z in land.floor_z_m[near]]
