"""The refiner: key points, map, state and previous plan to a trajectory that may be followed.

Seeds in order: the previous plan shifted to now, the reference, the previous plan as it is, a brake. Each
candidate is re-simulated and checked densely against map and limits before it may leave. Where none is free,
the robot brakes; in the air it flies the rest of the previous plan instead if that stays farther away.
The caller brings the path of a search as key points of its own (`source=Source.SEARCH`).

Clearance is judged at the body's centre. On land the outline is the circle of `body.radius_m`; in the air
it is the sphere that encloses the body's cylinder (0.33 m by default), so that flying under or through
something needs 0.68 m of height: more than the body has, but exact enough for doors.
"""

from __future__ import annotations

from labr_autonomy.clock import Clock, SystemClock
from labr_autonomy.config import RobotConfig
from labr_autonomy.refine.air_planner import AirPlanner
from labr_autonomy.refine.land_planner import LandPlanner


class Refiner:
    """Both planners behind the names that the rest uses; built once, used by one thread.

    `land` and `air` return a `RefineResult`; `brake_land`, `brake_air` and `turn` a `Trajectory`.
    """

    def __init__(self, config: RobotConfig, clock: Clock | None = None) -> None:
        clock = clock or SystemClock()
        land, air = LandPlanner(config, clock), AirPlanner(config, clock)
        self.land_hard_m, self.air_hard_m = (
            land.hard_m,
            air.hard_m,
        )  # least distance of the centre to obstacles
        self.land = land.plan
        self.brake_land = land.brake
        self.turn = land.turn
        self.air = air.plan
        self.brake_air = air.brake
