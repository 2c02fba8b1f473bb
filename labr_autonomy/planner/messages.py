"""What the executive asks of the planner process, and what comes back. Plain values, picklable."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.types import Array, KeyPoints, Mode, Pose, Source, Trajectory


@dataclass(frozen=True, slots=True)
class Motion:
    """Motion that a new trajectory starts from."""

    position_m: Array  # (3,) odom
    velocity_mps: Array  # (3,) odom
    acceleration_mps2: Array  # (3,) odom
    yaw_rad: float  # odom
    yaw_rate_rps: float
    speed_mps: float  # along body x, signed


@dataclass(frozen=True, slots=True)
class PlanRequest:
    """One planning cycle to do."""

    sequence: int
    frame_sequence: int  # depth frame to look at
    frame_pose: Pose  # body in odom when that frame was taken
    body_pose: Pose  # body in odom now
    start_s: float  # when the new trajectory shall begin
    motion: Motion  # where the robot will be then
    mode: Mode
    goal_m: Array  # (3,) odom; z is used when goal_in_air
    goal_in_air: bool
    floor_z_m: float  # floor below the robot, odom
    lift_to_m: float  # height in odom that a take-off here would climb to
    fresh: bool = False  # forget the previous trajectory (after a hold or a mode change)
    may_hop: bool = True  # policy and battery allow flying over what is in the way of a goal on land
    follow: bool = True  # a trajectory is wanted; while wheels and rotors change over it is not
    probe_m: Array | None = None  # (3,) odom, a place on the floor: could the robot drive there?


@dataclass(frozen=True, slots=True)
class Timings:
    """Where one cycle's time went [s]."""

    map_s: float = 0.0
    network_s: float = 0.0
    route_s: float = 0.0  # with the fields that the refiner looks things up in
    refine_s: float = 0.0  # the refiner's own
    total_s: float = 0.0


@dataclass(frozen=True, slots=True)
class PlanResult:
    """Outcome of one cycle."""

    sequence: int
    frame_stamp_s: float  # exposure of the depth frame behind this plan
    trajectory: Trajectory | None
    network: KeyPoints  # what the network said
    followed: KeyPoints | None  # what the trajectory was made from
    source: Source
    clearance_m: float  # least of the trajectory's outline to what was seen; NaN where none was looked for
    reason: str  # why the trajectory is what it is, when it is not the network's
    lift_off_m: float  # along the way that is followed to where it leaves the floor; inf if it does not
    land_path_ends: bool  # driving on costs more than it saves
    take_off_clear: bool  # room to go straight up from here
    landing_clear: bool  # room to come straight down here, and nothing to gain by flying on
    timings: Timings
    depart_rad: float = math.nan  # odom, where a flight from here would begin to go; while it takes off
    hop: bool = False  # the way to a goal on land leaves the floor, or that to one in the air comes down
    nearest: bool = False  # it gets no nearer: there is no room for it beyond
    stuck: bool = False  # everything was tried: it gets no farther
    depth_fault: str = ""  # why depth images cannot be believed
    probe: str | None = None  # why there is no way to the request's `probe_m`, "" when there is one
    map_xy_m: NDArray[np.float32] | None = field(default=None)  # (n, 2) obstacle cells, now and then


@dataclass(frozen=True, slots=True)
class Ready:
    """The planner process has loaded everything."""

    versions: dict[str, str]
    load_s: float
