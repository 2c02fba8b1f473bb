"""Places to take off and land by the rolling map, and how near below an air goal the wheels have to get."""

from __future__ import annotations

from labr_autonomy.config import RobotConfig
from labr_autonomy.perception.rolling_map import RollingMap
from labr_autonomy.planner.messages import PlanRequest

AT_END_M = 0.35
FLOOR_M = 0.1  # the column begins this high above the floor


def column_clear(seen: RollingMap, config: RobotConfig, request: PlanRequest, up_to_m: float) -> bool:
    """Whether no obstacle was seen in the column that a vertical flight here takes up.

    Args:
        seen: The map.
        config: Outline and the free ring about it.
        request: Where the robot is, and its floor.
        up_to_m: Height of the body at the column's upper end, odom.
    """
    low_m, high_m = column_m(config, request, up_to_m)
    return seen.column_clear(request.body_pose.position_m[:2], column_radius_m(config), low_m, high_m).clear


def column_radius_m(config: RobotConfig) -> float:
    """Free radius that a vertical flight needs."""
    return config.body.radius_m + config.clearance.landing_m


def column_m(config: RobotConfig, request: PlanRequest, up_to_m: float) -> tuple[float, float]:
    """Heights (odom) between which the column of a vertical flight has to be free."""
    return request.floor_z_m + FLOOR_M, up_to_m + config.body.above_m + config.clearance.landing_m
