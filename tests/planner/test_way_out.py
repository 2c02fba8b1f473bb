"""A robot that is walled in: it looks round, hops where it may, and says so where it may not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.modes.recovery import Action, State
from labr_autonomy.perception.driving_kernels import CELL_M
from labr_autonomy.planner.messages import Motion, PlanRequest
from labr_autonomy.planner.pipeline import Pipeline
from labr_autonomy.planner.way_out import WayOut
from labr_autonomy.types import Mode, Pose, Source

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

    def cycle(self, goal=(5.0, 0.0, 0.12), **changes):
        self.now_s += STEP_S
        self.number += 1
        pose = Pose(HERE.copy(), quaternion_from_rpy(0.0, 0.0, self.yaw))
        motion = Motion(HERE.copy(), np.zeros(3), np.zeros(3), self.yaw, 0.0, 0.0)
        request = PlanRequest(
            self.number, 0, pose, pose, self.now_s, motion, Mode.LAND, np.array(goal), False, 0.0, 1.4
        )
        result = self.pipeline.cycle(replace(request, **changes), None)
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


def test_another_goal_is_tried_anew():
    robot = Robot(walled_in(roof=True))
    robot.cycle()
    robot.pipeline._way_out.state = State(action=Action.GIVE_UP, tries=6)
    assert robot.cycle().stuck
    assert not robot.cycle(goal=(-5.0, 0.0, 0.12)).stuck


@pytest.mark.parametrize(("action", "tries"), [(Action.HOP, 4), (Action.LOOK, 3)])
def test_a_flight_in_between_does_not_make_the_tries_begin_anew(action, tries):
    """Walled in on either side it would hop to and fro until the battery is empty."""
    robot = Robot(walled_in(roof=True))
    robot.cycle()
    began = State(action=action, tries=3, trouble_m=HERE[:2], trouble_s=0.0)
    robot.pipeline._way_out.state = began
    robot.cycle(fresh=True)
    after = robot.pipeline._way_out.state
    assert (after.action, after.tries) == (Action.FOLLOW, tries)
    assert after.trouble_s == began.trouble_s


def test_it_stands_before_it_turns_to_look():
    robot = Robot(walled_in(roof=True))
    robot.run(10.0, until=lambda r: r.reason.startswith("look round"))
    rolls = Motion(HERE.copy(), np.array([0.3, 0.0, 0.0]), np.zeros(3), robot.yaw, 0.0, 0.3)
    assert robot.cycle(motion=rolls).source is Source.BRAKE
    assert robot.cycle().source is Source.TURN


class NoWays:
    """A map without a way to the goal."""

    def cost_m(self, place_m):
        return math.inf

    def path(self, place_m):
        return None


def test_it_backs_off_along_the_way_it_came_for_a_metre_and_again_if_need_be():
    way_out, ways = WayOut(), NoWays()
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    at = PlanRequest(1, 0, Pose(HERE, upright), None, 0.0, None, Mode.LAND, HERE + 9.0, False, 0.0, 1.4)

    def step(place, now_s):
        pose = Pose(np.array([*place, 0.12]), upright)
        return way_out.step(replace(at, body_pose=pose, start_s=now_s), ways, lambda _: ways, False)

    for k in range(20):  # it comes round a corner
        step((0.15 * k, 0.0), 0.1 * k)
    for k in range(10):
        step((2.85, 0.15 * k), 2.0 + 0.1 * k)
    place, now_s = np.array([2.85, 1.35]), 3.0
    for _ in range(2):
        began = place.copy()
        way_out.state = State(action=Action.BACK, since_s=now_s, from_m=began)
        while way_out.state.action is Action.BACK and now_s < 60.0:
            way = step(place, now_s)
            if way_out.state.action is Action.BACK:
                away = way[0] - place
                place = place + away * min(1.0, 0.03 / max(np.hypot(*away), 1e-9))
            now_s += 0.1
        assert np.hypot(*(place - began)) == pytest.approx(1.0, abs=0.1)
    assert place[1] == pytest.approx(0.0, abs=0.1), "along the way, not across the corner"
