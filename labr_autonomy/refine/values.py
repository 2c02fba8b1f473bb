"""What goes into the refiner and what comes out of it. Frames: odom; SI units, radians."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.types import Array, Source, Trajectory

STEPS = 25  # intervals of the horizon
STEP_S = 0.1  # [s] one interval; 2.5 s see 2 m at 0.8 m/s, six times the braking distance


def grid_s(nodes: int) -> Array:
    """Stamps of nodes from 0 on, (nodes,) [s]."""
    return np.linspace(0.0, STEP_S * (nodes - 1), nodes)


class DistanceField(Protocol):
    """The part of `perception.fields` that is used here; points are (n, 2) or (n, 3)."""

    @property
    def cell_m(self) -> float:
        """Edge of a cell [m]."""
        ...

    def lookup(self, points_m: Array, /) -> Array:
        """Distance to the nearest obstacle's face, (n,) [m]; negative inside."""
        ...

    def gradient(self, points_m: Array, /) -> Array:
        """Direction in which the distance grows, (n, d)."""
        ...

    def is_known(self, points_m: Array, /) -> NDArray[Any]:
        """(n,) True where the map has seen the place; False outside the map."""
        ...

    @property
    def grain_m(self) -> float:
        """Radius of what a surface point stands for."""
        ...

    def surface_points(self) -> Array:
        """Points on the surfaces of what is solid, (m, d)."""
        ...


@dataclass(frozen=True, slots=True)
class LandState:
    """The driving robot at one instant."""

    position_xy: Array  # (2,) odom
    yaw: float  # odom
    speed: float  # [m/s] along body x, negative when backing
    yaw_rate: float  # [rad/s]
    height_m: float = 0.12  # body origin in odom; copied into the trajectory


@dataclass(frozen=True, slots=True)
class AirState:
    """The flying robot at one instant."""

    position: Array  # (3,) odom
    velocity: Array  # (3,) odom
    acceleration: Array  # (3,) odom, as commanded (a measured one is too noisy to plan from)
    yaw: float  # odom


@dataclass(frozen=True, slots=True)
class RefineResult:
    """A trajectory that may be followed, and why it is this one.

    `stopped` means that the key points were not followed: the trajectory is the rest of the previous
    plan or a brake, and the caller should look for another path.
    """

    trajectory: Trajectory
    source: Source
    clearance_m: float  # least free distance around the outline along the trajectory
    stopped: bool
    reason: str
    time_s: float  # what the call took
