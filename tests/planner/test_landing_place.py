"""A robot that is to come down above a table flies on to where there is room, and comes down there."""

from __future__ import annotations

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.planner.messages import Motion, PlanRequest
from labr_autonomy.planner.pipeline import Pipeline
from labr_autonomy.types import DepthFrame, Mode, Pose

CONFIG = RobotConfig()
PERIOD_S = 0.1
TABLE_M = 0.9  # half of its edge
UPRIGHT = quaternion_from_rpy(0.0, 0.0, 0.0)


def above_a_table(height_m):
    """A pipeline that has seen open space all round, but for a table below the robot."""
    pipeline = Pipeline(CONFIG, network=False)
    optics = CONFIG.camera.intrinsics
    nothing = DepthFrame(1, 0.0, np.zeros((optics.height, optics.width), np.float32), optics)
    grid = pipeline._map
    grid.update(nothing, Pose(np.array([0.0, 0.0, height_m]), UPRIGHT), 0.0)
    grid.driving.bands[:], grid.driving.odds[:], grid.driving.heights_mm[:] = -20, -20, 0
    grid.log_odds[:] = -40
    x, y, z = (grid.origin_m[k] + (np.arange(grid.log_odds.shape[k]) + 0.5) * grid.cell_m for k in range(3))
    top = (np.abs(x) < TABLE_M)[:, None, None] & (np.abs(y) < TABLE_M)[None, :, None]
    grid.log_odds[top & ((z > 0.6) & (z < 0.75))[None, None, :]] = 60
    grid.log_odds[:, :, z < 0.0] = 60
    return pipeline


def test_it_flies_off_the_table_before_it_may_come_down():
    pipeline = above_a_table(1.5)
    place, velocity, acceleration, yaw = np.array([0.1, 0.0, 1.5]), np.zeros(3), np.zeros(3), 0.0
    goal = np.array([0.1, 0.0, CONFIG.body.below_m])
    clear = []
    for k in range(200):
        pose = Pose(place.copy(), quaternion_from_rpy(0.0, 0.0, yaw))
        motion = Motion(place.copy(), velocity, acceleration, yaw, 0.0, 0.0)
        request = PlanRequest(k, 0, pose, pose, PERIOD_S * k, motion, Mode.AIR, goal, False, 0.0, 1.5)
        result = pipeline.cycle(request, None)
        clear.append(result.landing_clear)
        if result.landing_clear:
            break
        s = result.trajectory.sample(PERIOD_S * (k + 1))
        place, velocity, acceleration, yaw = s.position_m, s.velocity_mps, s.acceleration_mps2, s.yaw_rad
    assert not clear[0]
    assert clear[-1]
    off_m = np.abs(place[:2]).max() - TABLE_M
    assert off_m > CONFIG.body.radius_m + CONFIG.clearance.landing_m - 0.1
    assert off_m < 1.5, "and no farther than it must"
