"""Places to take off and land by the rolling map, and how near below an air goal the wheels have to get."""

from __future__ import annotations

from labr_autonomy.config import RobotConfig
from labr_autonomy.perception.rolling_map import RollingMap
from labr_autonomy.planner.messages import PlanRequest

UNDER_GOAL_M = 2.5  # how far from below an air goal the drive may end
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
    body, ring_m = config.body, config.clearance.landing_m
    return seen.column_clear(
        request.body_pose.position_m[:2],
        body.radius_m + ring_m,
        request.floor_z_m + FLOOR_M,
        up_to_m + body.above_m + ring_m,
    ).clear
