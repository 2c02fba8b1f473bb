"""Goals of a view: on land and in the air, near and far, in and out of sight, half behind something."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import odom_to_level
from labr_autonomy.perception.fields import Field2
from labr_autonomy.refine.search import CostToGo
from labr_autonomy.types import Array, Mode
from sim.bench.known import Known
from sim.training_data.fields import LandTruth
from sim.training_data.walks import Stop

DISTANCE_M = (0.8, 7.0)  # in x and y
BEARING_RAD = math.radians(80.0)
HEIGHT_M = (0.5, 3.0)  # of an air goal's body origin above its floor
STOREY_M = (-1.0, 3.0)  # and above the robot's: a flight is bounded from where it began
AIR_ROOM_M = 0.1  # beyond the sphere about the outline, by the voxels
AIR_CLEAR_M = 0.05  # beyond the outline, exactly
LAND_ERROR_M = 0.05  # by up to this a land goal's height is said too low
UNSEEN_WEIGHT = 0.6  # of a goal outside the camera's view, against one inside
BLOCKED_M = 0.02  # of clearance that a straight flight must keep
LAND_BLOCKED_M = 0.01  # that a straight drive may lack, by the field, whose cells are that coarse
STEP_M = 0.1
# A goal farther round than this is no matter of key points: it wants a search on a map, or a memory.
DETOUR, DETOUR_M = 1.5, 0.8  # of the straight line, and besides
CANDIDATES = 48  # of each kind, of which `count / 2` are taken


@dataclass(frozen=True, slots=True)
class Goals:
    """k goals of one view."""

    level_m: Array  # (k, 3)
    in_air: NDArray[np.bool_]  # (k,)
    hard: NDArray[np.bool_]  # (k,)


def draw_goals(
    known: Known,
    stop: Stop,
    land: LandTruth,
    layer: Field2 | None,
    count: int,
    rng: np.random.Generator,
    robot: RobotConfig,
) -> Goals | None:
    """Goals that can be reached from a stop without much of a detour, those on land first; None without any.

    Half are on land and half in the air, all of one kind where there is none of the other; of each kind half
    have a blocked straight line, as far as there are such.
    """
    kinds = [(_on_land(known, stop, land, robot), False), (_in_air(known, stop), True)]
    found = []
    ways = _ways(stop, land, layer, robot)
    for spots, in_air in kinds:
        spots = spots[_drawn(spots, stop, rng, robot)]
        spots = spots[_on_the_way(spots, stop, ways if in_air else ways[:1])]
        if in_air:
            spots = spots + rng.uniform(-0.08, 0.08, spots.shape)
            spots = spots[known.surface.clear(spots, AIR_CLEAR_M)]
        found.append((spots, _hard(known, stop, spots, in_air, land, robot), in_air))
    counts = _shares(count, [len(spots) for spots, _, _ in found])
    if counts is None:
        return None
    chosen, air, hard = [], [], []
    for (spots, blocked, in_air), wanted in zip(found, counts, strict=True):
        pick = _balanced(blocked, wanted, rng)
        level = odom_to_level(spots[pick], stop.pose)
        if not in_air:
            level[:, 2] -= rng.uniform(0.0, LAND_ERROR_M, len(level))
        chosen.append(level)
        hard.append(blocked[pick])
        air.append(np.full(wanted, in_air))
    return Goals(np.concatenate(chosen), np.concatenate(air), np.concatenate(hard))


def _shares(count: int, there: list[int]) -> list[int] | None:
    """How many goals of each kind."""
    if not any(there):
        return None
    if not all(there):
        return [count if n else 0 for n in there]
    return [(count + 1) // 2, count // 2]


def _on_land(known: Known, stop: Stop, land: LandTruth, robot: RobotConfig) -> Array:
    """Body origins (n, 3) at places that can be driven to on the floors around."""
    layer = known.free.land
    near = np.abs(known.places_m[:, :2] - stop.pose.position_m[:2]).max(axis=1) <= DISTANCE_M[1]
    pick = np.flatnonzero(near & (layer.reach == stop.reach))
    spots = known.places_m[pick]
    driven = land.field.lookup(spots[:, :2]) >= robot.body.radius_m
    cell = np.floor((spots[:, :2] - land.corner_m) * (1.0 / _cell_m(land))).astype(int)
    inside = ((cell >= 0) & (cell < len(land.floors_cm))).all(axis=1)
    cell = np.clip(cell, 0, len(land.floors_cm) - 1)
    floor_m = stop.floor_z_m + 0.01 * land.floors_cm[tuple(cell.T)].astype(np.float64)
    same_deck = np.abs(floor_m - layer.floor_z_m[pick]) < 0.1
    out: Array = spots[driven & inside & same_deck]
    return out


def _cell_m(land: LandTruth) -> float:
    return land.field.cell_m * round(0.1 / land.field.cell_m)


def _in_air(known: Known, stop: Stop) -> Array:
    """Middles (n, 3) of cells that can be flown to."""
    cells, air = known.cells_m, known.free.air
    near = np.abs(cells[:, :2] - stop.pose.position_m[:2]).max(axis=1) <= DISTANCE_M[1]
    near &= known.cells_reach == stop.reach
    near &= (known.cells_height_m >= HEIGHT_M[0]) & (known.cells_height_m <= HEIGHT_M[1])
    rise = cells[:, 2] - stop.floor_z_m
    spots = cells[near & (rise >= STOREY_M[0]) & (rise <= STOREY_M[1])]
    at = np.floor((spots - air.origin_m) / air.cell_m).astype(int)
    out: Array = spots[air.room_m[tuple(at.T)] >= AIR_ROOM_M]
    return out


def _ways(stop: Stop, land: LandTruth, layer: Field2 | None, robot: RobotConfig) -> list[CostToGo]:
    """How far it is from the stop to everywhere: driven, and flown in one layer of the air."""
    here = stop.pose.position_m[:2]
    ways = [CostToGo(land.coarse, here, robot.body.radius_m - LAND_BLOCKED_M)]
    if layer is not None:
        ways.append(CostToGo(layer, here, robot.body.radius_m + BLOCKED_M))
    return ways


def _on_the_way(spots: Array, stop: Stop, ways: list[CostToGo]) -> NDArray[np.bool_]:
    """Which spots (n, 3) have a way that is not much longer than the straight line, (n,)."""
    straight_m = np.hypot(*(spots[:, :2] - stop.pose.position_m[:2]).T)
    way_m = np.array([min(way.cost_m(spot[:2]) for way in ways) for spot in spots])
    out: NDArray[np.bool_] = way_m <= DETOUR * straight_m + DETOUR_M
    return out


def _drawn(spots: Array, stop: Stop, rng: np.random.Generator, robot: RobotConfig) -> NDArray[np.intp]:
    """Numbers of candidates among spots (n, 3): every distance alike, more of them within the view."""
    level = odom_to_level(spots, stop.pose)
    away = np.hypot(level[:, 0], level[:, 1])
    bearing = np.abs(np.arctan2(level[:, 1], level[:, 0]))
    weight = np.where(bearing <= math.atan(robot.camera.cx / robot.camera.fx), 1.0, UNSEEN_WEIGHT)
    weight /= np.maximum(away, 0.1)  # there is more of the far than of the near
    weight[(away < DISTANCE_M[0]) | (away > DISTANCE_M[1]) | (bearing > BEARING_RAD)] = 0.0
    total = np.cumsum(weight)
    if not len(total) or total[-1] <= 0.0:
        return np.zeros(0, np.intp)
    out: NDArray[np.intp] = np.unique(np.searchsorted(total, rng.random(CANDIDATES) * total[-1], "right"))
    return out


def _hard(
    known: Known, stop: Stop, spots: Array, in_air: bool, land: LandTruth, robot: RobotConfig
) -> NDArray[np.bool_]:
    """Whether the straight line to each spot (n, 3) is blocked, (n,)."""
    here = stop.pose.position_m
    out = np.zeros(len(spots), np.bool_)
    for n, spot in enumerate(spots):
        length = float(np.linalg.norm(spot - here))
        t = np.linspace(0.0, 1.0, math.ceil(length / STEP_M) + 1)[1:, None]
        line = here + t * (spot - here)
        if in_air or stop.mode is Mode.AIR:
            out[n] = not known.surface.clear(line, BLOCKED_M, on_floor=True).all()
        else:
            out[n] = land.field.lookup(line[:, :2]).min() < robot.body.radius_m - LAND_BLOCKED_M
    return out


def _balanced(blocked: NDArray[np.bool_], wanted: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Numbers of `wanted` spots, half of them blocked where there are enough; each once while they last."""
    hard, easy = (rng.permutation(np.flatnonzero(group)) for group in (blocked, ~blocked))
    most = (wanted + int(rng.integers(2))) // 2  # an odd one goes either way
    take_hard = min(len(hard), max(most, wanted - len(easy)))
    pick = np.concatenate([hard[:take_hard], easy[: wanted - take_hard]])
    if 0 < len(pick) < wanted:  # too few spots: some twice
        pick = np.resize(pick, wanted)
    return pick.astype(np.intp)
