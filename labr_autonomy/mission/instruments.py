"""From what the links report to what the pilot may know. Pure."""

from __future__ import annotations

import math

from labr_autonomy.air.telemetry import AirState
from labr_autonomy.config import RobotConfig
from labr_autonomy.estimation.filter import PoseFilter
from labr_autonomy.ground.state import GroundState
from labr_autonomy.guard.failsafe import Health
from labr_autonomy.mission.pilot import Pilot
from labr_autonomy.mission.pilot_io import Look, Order
from labr_autonomy.mission.watchers import Watchers


def look(
    pilot: Pilot,
    watchers: Watchers,
    config: RobotConfig,
    poses: PoseFilter,
    ground: GroundState,
    air: AirState,
    *,
    restarts: int = 0,
    depth_stamp_s: float | None,
    plan_age_s: float,
    order: Order,
    now_s: float,
) -> Look:
    """Everything the pilot may know at `now_s`.

    Args:
        pilot: For its mode and what it plans for.
        watchers: Tell who flies and whether the wheels have to rest.
        config: Energy reserve.
        poses: The estimate.
        ground: The land controller's word.
        air: The autopilot's word.
        restarts: How often the autopilot has restarted.
        depth_stamp_s: Exposure of the newest depth image, None before the first.
        plan_age_s: Time since the newest plan from a fresh image.
        order: What the operator asked for.
        now_s: The present.
    """
    health = Health(
        mode=pilot.mode,
        vio_age_s=poses.ages(now_s)["vio_accepted"],  # a pose that is refused is no pose
        depth_age_s=math.inf if depth_stamp_s is None else now_s - depth_stamp_s,
        ground_age_s=ground.age_s,
        air_age_s=air.heartbeat_age_s,
        plan_age_s=plan_age_s if pilot.planning_mode is not None else 0.0,
        vio_rejected=poses.vio_rejected_in_a_row,
        estop=ground.estop,
        taken_over=watchers.taken_over(pilot.transition.phase, pilot.landing_asked, air, restarts, now_s),
        battery_left=1.0 if air.battery_remaining is None else air.battery_remaining,
        battery_reserve=config.energy.reserve,
        depth_fault=pilot.depth_fault,
        wheel_fault=watchers.wheel_fault(ground.latched, now_s),
    )
    return Look(
        odometry=poses.predicted(now_s),
        wheel_speed_mps=ground.speed_mps,
        wheel_yaw_rate_rps=ground.yaw_rate_rps,
        wheel_load=ground.wheel_load,
        armed=air.armed,
        autopilot_mode=air.mode,
        landed=air.landed == "on_ground",
        health=health,
        order=order,
        lifts_by_command=air.lifts_by_command,
        in_doubt=watchers.in_doubt,  # after `taken_over` above
    )
