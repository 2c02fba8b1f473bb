"""Land or air, decided from the key points and the energy model. Pure, with hysteresis.

The paper's rule is that the robot drives until it is close to an air goal and the key points reach a
certain height. Here the height comes from the key points and "close" from energy: it goes on driving
while that still saves more than `SAVING_MIN_J`, and while it still rolls towards the end of its way: the last
decimetres cost next to nothing on wheels, and a second of flight.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from labr_autonomy.modes.energy import EnergyModel
from labr_autonomy.types import Array, Mode

AIR_HEIGHT_M = 0.25  # a key point higher than this above driving height is flown to
SAVING_MIN_J = 150.0  # driving on must save at least this; about 0.4 m with the default powers
CONFIRM_S = 0.3  # the same wish must last this long
ROLLS_MPS, ROLLS_TO_M = 0.3, 0.05  # faster than this and farther from it, it has not come to its way's end
DWELL_S = 2.0  # and the last switch must be this long ago


@dataclass(frozen=True, slots=True)
class Facts:
    """What the decision may look at."""

    mode: Mode
    goal_in_air: bool
    goal_distance_xy_m: float
    lift_off_m: float  # along the path to the first key point in the air; inf when there is none
    land_path_ends: bool  # no way on by land towards the place under the goal
    take_off_clear: bool  # room for the rotors here and above
    landing_clear: bool  # room to come down here
    speed_mps: float = 0.0  # over the floor
    hop: bool = False  # the planned way changes the mode again before the goal


@dataclass(frozen=True, slots=True)
class State:
    """Memory of the decision."""

    wish: Mode = Mode.LAND
    wish_since_s: float = 0.0
    switched_s: float = -1e9


def classify(points_m: Array, drive_height_m: float) -> np.ndarray:
    """(n,) bool: which key points (n, 3) odom are in the air, given the body's driving height in odom [m]."""
    return np.asarray(points_m[:, 2] - drive_height_m > AIR_HEIGHT_M, dtype=np.bool_)


def lift_off_distance_m(start_m: Array, points_m: Array, air: np.ndarray) -> float:
    """Horizontal distance along the path to where it leaves the floor [m]; inf if it never does.

    The path leaves the floor at the last key point on land, or at the start if the first one is in the air.
    """
    if not air.any():
        return float("inf")
    first = int(np.argmax(air))
    path = np.vstack([start_m[:2], points_m[:first, :2]])
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) if first else 0.0


def wish(facts: Facts, energy: EnergyModel) -> Mode:
    """The mode that the facts ask for, without memory."""
    if facts.mode is Mode.AIR:
        down = facts.hop or not facts.goal_in_air
        return Mode.LAND if down and facts.landing_clear else Mode.AIR
    up = facts.hop or facts.goal_in_air
    drivable_m = min(facts.lift_off_m, facts.goal_distance_xy_m)
    rolls = facts.land_path_ends and facts.speed_mps > ROLLS_MPS and drivable_m > ROLLS_TO_M
    if not up or not facts.take_off_clear or rolls:
        return Mode.LAND
    saving_j = energy.air_j(drivable_m) - energy.land_j(drivable_m)
    return Mode.AIR if saving_j < SAVING_MIN_J or facts.land_path_ends else Mode.LAND


def step(state: State, facts: Facts, energy: EnergyModel, now_s: float) -> tuple[State, Mode]:
    """One decision: the wanted mode changes only when the wish lasted and the last change is old enough."""
    wanted = wish(facts, energy)
    since_s = state.wish_since_s if wanted is state.wish else now_s
    settled = now_s - since_s >= CONFIRM_S and now_s - state.switched_s >= DWELL_S
    if wanted is not facts.mode and settled:
        return State(wanted, since_s, now_s), wanted
    return State(wanted, since_s, state.switched_s), facts.mode
