"""What the searches on land know of places that were left, refused, or have no room."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planner_rig import CONFIG, looked_round

from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.perception.driving_kernels import CELL_M
from labr_autonomy.planner.first_stage import FirstStage
from labr_autonomy.planner.map_ways import REFUSED_M
from labr_autonomy.planner.messages import Motion, PlanRequest
from labr_autonomy.planner.pipeline import Pipeline
from labr_autonomy.planner.refusals import WAITS_S
from labr_autonomy.types import DepthFrame, Mode, Pose

FLOOR_Z_M = 0.0


def request(x, y, goal, *, in_air=False, now_s=0.0):
    place = np.array([x, y, CONFIG.body.below_m])
    pose = Pose(place, quaternion_from_rpy(0.0, 0.0, 0.0))
    motion = Motion(place, np.zeros(3), np.zeros(3), 0.0, 0.0, 0.0)
    goal = np.array([*goal, 1.4 if in_air else CONFIG.body.below_m])
    return PlanRequest(1, 0, pose, pose, now_s, motion, Mode.LAND, goal, in_air, FLOOR_Z_M, 1.4)


def painted(pipeline, x, y, *boxes):
    """Let it see free floor all round a place, but for solid boxes (x0, y0, x1, y1)."""
    layer = looked_round(pipeline, request(x, y, (x, y)).body_pose).driving
    for x0, y0, x1, y1 in boxes:
        low = np.maximum(np.round((np.array([x0, y0]) - layer.origin_m) / CELL_M).astype(int), 0)
        high = np.maximum(np.round((np.array([x1, y1]) - layer.origin_m) / CELL_M).astype(int), 0)
        layer.bands[low[0] : high[0], low[1] : high[1]] = 60
        layer.odds[low[0] : high[0], low[1] : high[1]] = 60


def crossing_y(way, x):
    """Where a way crosses a line of constant x."""
    return float(np.interp(x, way[:, 0], way[:, 1]))


@pytest.mark.parametrize(("memory", "in_again"), [(True, False), (False, True)])
def test_a_dead_end_that_left_the_map_is_not_entered_again(memory, in_again):
    """A wall of 12 m across the way, far behind the robot by now: the rolling map has forgotten it."""
    pipeline, goal = Pipeline(CONFIG, network=False, memory=memory), (12.0, 0.0)
    painted(pipeline, 0.0, 0.0, (3.0, -6.0, 3.2, 6.0))
    pipeline._ways.on_land(request(0.0, 0.0, goal), ())
    painted(pipeline, -12.0, 0.0)
    way = pipeline._ways.on_land(request(-12.0, 0.0, goal, now_s=1.0), ()).path(np.array([-12.0, 0.0]))
    assert (abs(crossing_y(way, 3.1)) < 6.0) is in_again


def test_where_it_stood_without_room_to_take_off_another_place_is_driven_to():
    pipeline, goal = Pipeline(CONFIG, network=False), (0.0, 0.0)
    painted(pipeline, 0.0, 0.0)
    here, ways = request(0.0, 0.0, goal, in_air=True), pipeline._ways
    place = ways.on_land(here, ()).end(np.zeros(2))
    assert np.hypot(*place) < 0.3, "below the goal"
    for now_s in (0.0, 0.5 * WAITS_S, WAITS_S + 0.1):
        at = request(*place, goal, in_air=True, now_s=now_s)
        ways.refuse_take_off(at, ways.on_land(at, ()), room_above=False)
    other = ways.on_land(replace(at, start_s=now_s + 1.0), ()).end(place)
    assert np.hypot(*(other - place)) > REFUSED_M


def test_a_goal_on_land_without_room_counts_as_reached_where_it_gets_no_nearer():
    pipeline, goal = Pipeline(CONFIG, network=False), (2.0, 0.0)
    painted(pipeline, 0.0, 0.0, (2.1, -3.0, 2.4, 3.0))
    ways = pipeline._ways.on_land(request(0.0, 0.0, goal), ())
    end = ways.end(np.zeros(2))
    assert 0.15 < np.hypot(*(end - goal)) < 0.5
    assert pipeline._ways.nearest(request(*end, goal), ways)
    assert not pipeline._ways.nearest(request(1.0, 0.0, goal), ways)


@pytest.mark.parametrize("spoiled", [np.nan, np.inf, 1e6])
def test_an_answer_of_the_network_that_is_no_path_is_feared(spoiled, monkeypatch):
    """faults.md, row 7."""
    first = FirstStage(CONFIG)
    grid = Pipeline(CONFIG)._map
    grid.clear_robot(request(0.0, 0.0, (0.0, 0.0)).body_pose)
    optics = CONFIG.camera.intrinsics
    frame = DepthFrame(1, 0.0, np.full((optics.height, optics.width), 3.0, np.float32), optics)
    points = np.column_stack([np.arange(1.0, 6.0), np.zeros(5), np.zeros(5)])
    monkeypatch.setattr(first._network, "predict", lambda *_: (points, 0.1, None))
    assert first.ask(request(0.0, 0.0, (5.0, 0.0)), frame, grid).mu == pytest.approx(0.1)
    wrong = points.copy()
    wrong[2, 1] = spoiled
    monkeypatch.setattr(first._network, "predict", lambda *_: (wrong, 0.1, None))
    feared = first.ask(request(0.0, 0.0, (5.0, 0.0)), frame, grid)
    assert feared.mu == 1.0
    assert np.isfinite(feared.points_m).all()
