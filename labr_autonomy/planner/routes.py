"""Which path is followed: the network's while it can be, else the shortest one on the map. Pure.

The network's path is not used when its collision probability is 0.5 or more (paper, fear loss), when the
goal lies outside the camera's view, when the map contradicts it, or when it leads into a detour that the
map knows to be a dead end. After a change to the map's path the network has to be good for a while.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from labr_autonomy.types import Array, Source

MU_MAX = 0.5  # paper: only paths with mu < 0.5 are output
VIEW_RAD = 0.70  # just inside half of the D435i's 87 degrees
STAY_S = 2.0  # the map's path is followed at least this long
GOOD_CYCLES = 4  # and until the network has been usable this often in a row
DETOUR_RATIO = 1.3  # longer than the map's shortest way by this and DETOUR_M: a dead end
DETOUR_M = 1.0


@dataclass(frozen=True, slots=True)
class Evidence:
    """What speaks for and against the network's path."""

    mu: float
    goal_bearing_rad: float  # of the goal from the robot's heading, 0 ahead
    clearance_m: float  # least free distance around the outline along the path, on the map
    path_m: float  # length of the network's path
    after_path_m: float  # shortest way from its end to the goal, on the map; inf when there is none
    shortest_m: float  # shortest way from the robot to the goal, on the map; inf when there is none


@dataclass(frozen=True, slots=True)
class State:
    """Memory of the choice."""

    source: Source = Source.GKPN
    since_s: float = -1e9
    good: int = 0


def objection(e: Evidence) -> str:
    """Why the network's path is not usable, "" when it is."""
    if e.mu >= MU_MAX:
        return f"mu {e.mu:.2f}"
    if abs(e.goal_bearing_rad) > VIEW_RAD:
        return f"goal {np.degrees(abs(e.goal_bearing_rad)):.0f} deg out of view"
    if e.clearance_m < 0.0:
        return f"path enters an obstacle on the map by {-e.clearance_m:.2f} m"
    total = e.path_m + e.after_path_m
    if np.isfinite(e.shortest_m) and total > DETOUR_RATIO * e.shortest_m + DETOUR_M:
        return f"detour of {total - e.shortest_m:.1f} m"
    return ""


def choose(state: State, evidence: Evidence, now_s: float) -> tuple[State, str]:
    """The source to follow now and the reason against the network, if any."""
    against = objection(evidence)
    if against:
        since_s = state.since_s if state.source is Source.SEARCH else now_s
        return State(Source.SEARCH, since_s, 0), against
    if state.source is Source.GKPN:
        return state, ""
    good = state.good + 1
    if good >= GOOD_CYCLES and now_s - state.since_s >= STAY_S:
        return State(Source.GKPN, now_s, good), ""
    return State(Source.SEARCH, state.since_s, good), "staying with the map's path"


def length_m(points_m: Array) -> float:
    """Length of a polyline (n, d) [m]."""
    return float(np.linalg.norm(np.diff(points_m, axis=0), axis=1).sum()) if len(points_m) > 1 else 0.0


def densify(points_m: Array, spacing_m: float = 0.1) -> Array:
    """The polyline with points at most `spacing_m` apart, (k, d)."""
    pieces = [points_m[:1]]
    for a, b in itertools.pairwise(points_m):
        n = max(1, int(np.ceil(np.linalg.norm(b - a) / spacing_m)))
        pieces.append(a + (b - a) * np.linspace(0.0, 1.0, n + 1)[1:, None])
    return np.vstack(pieces)
