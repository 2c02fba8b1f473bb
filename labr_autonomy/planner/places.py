"""Places to take off and land by the rolling map, and how near below an air goal the wheels have to get.

A place must be clear all round and overhead, and its floor no steeper than `clearance.landing_slope`. What
was seen speaks against a place; what was not seen does not: a robot cannot look below itself.
"""

from __future__ import annotations

import math

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import rotation_matrix
from labr_autonomy.perception.fields import Field2
from labr_autonomy.perception.rolling_map import RollingMap
from labr_autonomy.planner.messages import PlanRequest
from labr_autonomy.types import Mode, Pose

AT_END_M = 0.35
UNDER_M = 0.1  # so far below the body the slice for a level flight begins
FLOOR_M = 0.1  # the column begins this high above the floor
FLOOR_NOISE_M = 0.085  # returns of a floor seen from the air lie up to so much above its fitted plane
RISEN_M = 0.01  # a floor that lies higher than this above where the robot took off has risen


def column_clear(seen: RollingMap, config: RobotConfig, request: PlanRequest, up_to_m: float) -> bool:
    """Whether the robot may take off or land where it is: a free column over a floor that is not too steep.

    On its wheels the robot is as inclined as the floor. In the air the heights that were seen tell the slope;
    where the floor was not seen it counts as level and as high as where the robot took off. What stands on a
    floor that rises is looked for from the floor's highest point on.

    Args:
        seen: The map.
        config: Outline, the free ring about it, and the steepest floor.
        request: Where the robot is, and its floor.
        up_to_m: Height of the body at the upper end of the vertical flight, odom.
    """
    pose, radius_m = request.body_pose, column_radius_m(config)
    xy_m = pose.position_m[:2]
    from_m, top_m = column_m(config, request, up_to_m)
    floor = None if request.mode is Mode.LAND else seen.driving.footing(xy_m, radius_m)
    rise = wheels_rise(pose) if request.mode is Mode.LAND else 0.0
    if floor is not None:
        rise = floor.rise
        highest_m = floor.height_m + rise * radius_m
        if highest_m > request.floor_z_m + RISEN_M:
            from_m = math.ceil((highest_m + FLOOR_NOISE_M) / seen.cell_m) * seen.cell_m
    if rise > config.clearance.landing_slope:
        return False
    return seen.column_clear(xy_m, radius_m, from_m, top_m).clear


def column_radius_m(config: RobotConfig) -> float:
    """Free radius that a vertical flight needs."""
    return config.body.radius_m + config.clearance.landing_m


def column_m(config: RobotConfig, request: PlanRequest, up_to_m: float) -> tuple[float, float]:
    """Heights (odom) between which the column of a vertical flight has to be free, over a level floor."""
    return request.floor_z_m + FLOOR_M, up_to_m + config.body.above_m + config.clearance.landing_m


def wheels_rise(pose: Pose) -> float:
    """Rise over run of the floor on which a robot in this pose stands."""
    up = float(rotation_matrix(pose.quaternion)[2, 2])
    return math.tan(math.acos(min(up, 1.0))) if up > 0.0 else math.inf


def column_field(
    seen: RollingMap, config: RobotConfig, request: PlanRequest, up_to_m: float
) -> tuple[Field2, float]:
    """For many places at once: distance to what stands in the way of vertical flights.

    Returns:
        The field, and the free radius [m] that a vertical flight needs at a cell's middle.
    """
    field = seen.column_field(*column_m(config, request, up_to_m))
    return field, column_radius_m(config) + seen.cell_m * math.sqrt(0.5)


def flight_layer(seen: RollingMap, config: RobotConfig, pose: Pose, height_m: float) -> Field2:
    """The slice of the map for level flights with the body at a height, odom."""
    return seen.slice_field(pose, height_m - config.body.below_m - UNDER_M)
