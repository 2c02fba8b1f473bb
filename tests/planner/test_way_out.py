"""A robot that is walled in: it looks round, hops where it may, and says so where it may not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.perception.driving_kernels import CELL_M
from labr_autonomy.planner.messages import Motion, PlanRequest
from labr_autonomy.planner.pipeline import Pipeline
from labr_autonomy.types import Mode, Pose

STEP_S = 0.5
HERE = np.array([0.0, 0.0, 0.12])


def walled_in(gap_m=0.0, roof=False):
    """A pipeline whose map is a ring of 1.2 m radius round the robot, perhaps with a gap towards the goal."""
    pipeline = Pipeline(RobotConfig())
    grid = pipeline._map
    grid.clear_robot(Pose(HERE, np.array([1.0, 0.0, 0.0, 0.0])))
    layer = grid.driving
    layer.bands[:], layer.odds[:] = -20, -20
    n = len(layer.odds)
    x, y = ((np.arange(n) + 0.5) * CELL_M + layer.origin_m[k] for k in (0, 1))
    away = np.hypot(x[:, None], y[None])
    ring = (away > 1.2) & (away < 1.35) & ~((np.abs(y)[None] < 0.5 * gap_m) & (x > 0.0)[:, None])
    layer.bands[ring], layer.odds[ring] = 60, 60
    if roof:
        grid.log_odds[:, :, 10:14] = 60
    return pipeline


class Robot:
    """One that turns as it is told, and otherwise stays where it is."""

    def __init__(self, pipeline):
        self.pipeline, self.yaw, self.now_s, self.number = pipeline, 0.0, 0.0, 0

    def cycle(self):
        self.now_s += STEP_S
        self.number += 1
        pose = Pose(HERE.copy(), quaternion_from_rpy(0.0, 0.0, self.yaw))
        motion = Motion(HERE.copy(), np.zeros(3), np.zeros(3), self.yaw, 0.0, 0.0)
        goal = np.array([5.0, 0.0, 0.12])
        request = PlanRequest(
            self.number, 0, pose, pose, self.now_s, motion, Mode.LAND, goal, False, 0.0, 1.4
        )
        result = self.pipeline.cycle(request, None)
        sample = result.trajectory.sample(self.now_s + STEP_S)
        self.yaw = sample.yaw_rad
        return result

    def run(self, seconds, until=lambda _: False):
        turned, reasons = 0.0, []
        for _ in range(round(seconds / STEP_S)):
            before = self.yaw
            result = self.cycle()
            turned += abs(math.remainder(self.yaw - before, 2.0 * math.pi))
            reasons.append(result.reason.partition(";")[0])
            if until(result):
                break
        return result, turned, reasons


def test_it_looks_all_round_and_then_hops():
    result, turned, reasons = Robot(walled_in()).run(60.0, until=lambda r: r.hop)
    assert result.hop
    assert result.land_path_ends  # so that the pilot takes off, however far the goal
    assert turned > 1.5 * math.pi
    assert reasons.index("look round") < reasons.index("hop over")
    assert not result.stuck


@pytest.mark.slow
def test_under_a_roof_it_gives_up_and_says_so():
    result, _, reasons = Robot(walled_in(roof=True)).run(240.0, until=lambda r: r.stuck)
    assert result.stuck
    assert not result.hop
    assert "look round" in reasons
    assert reasons[-1] == "give up"


def test_a_tight_gap_is_approached_before_anything_is_flown_over():
    result, _, reasons = Robot(walled_in(gap_m=0.5)).run(60.0, until=lambda r: "squeeze" in r.reason)
    assert "squeeze through" in reasons
    assert "hop over" not in reasons
    assert result.followed is None
