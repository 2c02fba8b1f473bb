"""Depth image in, trajectory out: the whole planner in closed loop with an ideal robot, no processes."""

import math
from dataclasses import replace

import numpy as np
import pytest

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.perception.fields import Field2
from labr_autonomy.planner.messages import Motion, PlanRequest
from labr_autonomy.planner.pipeline import Pipeline
from labr_autonomy.types import DepthFrame, KeyPoints, Mode, Pose, Source
from sim.camera.process import Eye
from sim.camera.renderer import make_renderer
from sim.worlds.solids import generate
from sim.worlds.surface import Surface

CONFIG = RobotConfig()
START, LAND_GOAL, AIR_GOAL = (-4.0, 0.0, 0.12), (1.5, 1.5, 0.12), (1.0, -1.0, 1.4)
PERIOD_S = 0.1


@pytest.fixture(scope="module")
def world():
    return generate("hall", 5, (12.0, 9.0), np.array([START, LAND_GOAL, AIR_GOAL]))


@pytest.fixture(scope="module")
def eye(world):
    renderer = make_renderer(world, CONFIG.camera.intrinsics, CONFIG.camera.range_max_m, kind="rays")
    return Eye(renderer, CONFIG.camera, seed=1)


@pytest.fixture
def pipeline():
    return Pipeline(CONFIG)


class Ideal:
    """A robot that is where its trajectory says."""

    def __init__(self, position, yaw=0.0):
        self.position = np.array(position, float)
        self.velocity = np.zeros(3)
        self.acceleration = np.zeros(3)
        self.yaw, self.yaw_rate, self.speed = yaw, 0.0, 0.0

    @property
    def pose(self):
        return Pose(self.position.copy(), quaternion_from_rpy(0.0, 0.0, self.yaw))

    def request(self, k, now_s, mode, goal, in_air):
        motion = Motion(
            self.position.copy(), self.velocity, self.acceleration, self.yaw, self.yaw_rate, self.speed
        )
        return PlanRequest(
            k, k, self.pose, self.pose, now_s, motion, mode, np.array(goal, float), in_air, 0.0, 1.4,
        )  # fmt: skip

    def follow(self, trajectory, now_s):
        s = trajectory.sample(now_s)
        z = self.position[2] if trajectory.mode is Mode.LAND else s.position_m[2]
        self.position = np.array([s.position_m[0], s.position_m[1], z])
        self.velocity, self.acceleration = s.velocity_mps, s.acceleration_mps2
        self.yaw, self.yaw_rate, self.speed = s.yaw_rad, s.yaw_rate_rps, s.speed_mps


def fly(pipeline, eye, robot, mode, goal, in_air, seconds, arrived, watch):
    results = []
    for k in range(1, int(seconds / PERIOD_S)):
        now_s = k * PERIOD_S
        frame = DepthFrame(k, now_s, eye.look(robot.pose), CONFIG.camera.intrinsics)
        result = pipeline.cycle(robot.request(k, now_s, mode, goal, in_air), frame)
        results.append(result)
        robot.follow(result.trajectory, now_s + PERIOD_S)
        watch(robot)
        if arrived(robot):
            return results
    raise AssertionError(f"not there after {seconds} s: {robot.position}, {results[-1].reason}")


@pytest.mark.slow
def test_it_drives_to_a_goal_without_touching_anything(world, eye, pipeline):
    surface, robot = Surface(world), Ideal(START)
    clearances = []
    results = fly(
        pipeline, eye, robot, Mode.LAND, LAND_GOAL, False, 25.0,
        lambda r: math.dist(r.position[:2], LAND_GOAL[:2]) < 0.15 and abs(r.speed) < 0.1,
        lambda r: clearances.append(surface.clearance(r.position, on_floor=True)),
    )  # fmt: skip
    assert min(clearances) > 0.0
    assert {r.source for r in results} & {Source.GKPN, Source.SEARCH}
    assert all(abs(r.trajectory.speed_mps).max() <= CONFIG.land.speed_mps + 1e-6 for r in results)


@pytest.mark.slow
def test_on_land_an_air_goal_is_approached_and_the_lift_off_comes_near(world, eye, pipeline):
    robot = Ideal(START)
    results = fly(
        pipeline, eye, robot, Mode.LAND, AIR_GOAL, True, 25.0,
        lambda r: math.dist(r.position[:2], AIR_GOAL[:2]) < 0.9, lambda r: None,
    )  # fmt: skip
    assert results[0].lift_off_m > 1.5
    assert results[-1].lift_off_m < 1.5
    assert results[-1].take_off_clear


@pytest.mark.slow
def test_in_the_air_it_flies_to_the_goal(world, eye, pipeline):
    surface, robot = Surface(world), Ideal((-4.0, 0.0, 1.4))
    clearances = []
    fly(
        pipeline, eye, robot, Mode.AIR, AIR_GOAL, True, 25.0,
        lambda r: math.dist(r.position, AIR_GOAL) < 0.1,
        lambda r: clearances.append(surface.clearance(r.position)),
    )  # fmt: skip
    assert min(clearances) > 0.0


@pytest.mark.slow
def test_a_path_with_mu_of_one_half_is_not_used(eye, pipeline, monkeypatch):
    robot = Ideal(START)
    frame = DepthFrame(1, 0.0, eye.look(robot.pose), CONFIG.camera.intrinsics)
    points = np.linspace([0.4, 0.0, 0.0], [2.0, 0.0, 0.0], 5)
    monkeypatch.setattr(pipeline._first._network, "predict", lambda *_: (points, 0.5, 0.001))
    result = pipeline.cycle(robot.request(1, 1.0, Mode.LAND, LAND_GOAL, False), frame)
    assert result.followed is None or result.followed.source is not Source.GKPN
    assert "mu 0.50" in result.reason


@pytest.mark.slow
def test_while_wheels_and_rotors_change_over_the_map_grows_and_no_path_is_looked_for(eye, pipeline):
    robot = Ideal(START)
    request = replace(robot.request(1, 0.1, Mode.AIR, AIR_GOAL, True), follow=False)
    result = pipeline.cycle(request, DepthFrame(1, 0.1, eye.look(robot.pose), CONFIG.camera.intrinsics))
    assert (result.followed, result.source) == (None, Source.BRAKE)
    assert result.take_off_clear
    assert pipeline._map.frames == 1
    away = np.subtract(AIR_GOAL, START)
    assert result.depart_rad == pytest.approx(math.atan2(away[1], away[0]), abs=0.5)
    assert pipeline.cycle(replace(request, follow=True), None).followed is not None


def test_a_flight_goes_straight_where_the_map_has_seen_all_of_the_way(eye, pipeline, monkeypatch):
    """Whatever the network would do."""
    aside = KeyPoints(np.array([[-3.0, 1.5, 1.0], [-2.0, 1.0, 1.0]]), np.ones(2, bool), 0.0, Source.GKPN)
    monkeypatch.setattr(pipeline._first, "ask", lambda *_: aside)
    robot = Ideal((*START[:2], 1.0))
    image = eye.look(robot.pose)
    for k in range(1, 6):
        frame = DepthFrame(k, 0.1 * k, image, CONFIG.camera.intrinsics)
        near = pipeline.cycle(robot.request(k, 0.1 * k, Mode.AIR, (-2.5, 0.0, 1.0), True), frame)
    far = pipeline.cycle(robot.request(6, 0.6, Mode.AIR, (-2.5, 4.0, 1.0), True), None)
    assert near.source is Source.DIRECT
    assert "seen to be free" in near.reason
    assert "seen to be free" not in far.reason


def test_a_flight_that_is_held_up_says_so(pipeline):
    """Close to its goal at once, so that it counts as there; farther off when it has waited long enough."""
    robot = Ideal((*START[:2], 1.0))
    pipeline._map.clear_robot(robot.pose)
    pipeline._map.log_odds[:] = 60
    said = []
    for k in range(130):
        result = pipeline.cycle(robot.request(k, 0.1 * k, Mode.AIR, (-3.0, 0.0, 1.0), True), None)
        said.append((result.nearest, result.stuck))
    assert said[:9] == [(False, False)] * 9
    assert said[15:95] == [(True, False)] * 80
    assert said[105] == (True, True)
    pipeline._map.log_odds[:] = -20
    free = pipeline.cycle(robot.request(131, 13.1, Mode.AIR, (-3.0, 0.0, 1.0), True), None)
    assert (free.nearest, free.stuck) == (False, False)


def test_without_a_frame_the_network_is_not_used(pipeline):
    robot = Ideal(START)
    result = pipeline.cycle(robot.request(1, 1.0, Mode.LAND, LAND_GOAL, False), None)
    assert result.network.mu == 1.0
    assert result.followed is None or result.followed.source is Source.SEARCH


def blocks(*boxes):
    """A plan of 10 m by 10 m about (0, 0), known all over, with solid boxes (x0, y0, x1, y1)."""
    occupied = np.zeros((100, 100), bool)
    for box in boxes:
        x0, y0, x1, y1 = (round((v + 5.0) / 0.1) for v in box)
        occupied[x0:x1, y0:y1] = True
    return Field2.from_occupied(occupied, np.ones_like(occupied), np.array([-5.0, -5.0]), 0.1)


ROOM = ((1.0, -2.0, 4.0, -1.8), (1.0, 1.8, 4.0, 2.0), (1.0, -2.0, 1.2, 2.0), (3.8, -2.0, 4.0, 2.0))


@pytest.mark.parametrize(
    ("plan", "place", "answer"),
    [
        (blocks(), (3.0, 2.0), ""),
        (blocks((1.0, -2.0, 4.0, 2.0)), (2.5, 0.0), "the place is in an obstacle, more than 0.5 m"),
        (blocks(*ROOM), (2.5, 0.0), "the map shows no way there"),
        (blocks(*ROOM), (-3.0, 2.0), ""),
    ],
)
def test_a_place_is_looked_up_before_anybody_drives_there(pipeline, monkeypatch, plan, place, answer):
    ways = pipeline._ways
    monkeypatch.setattr(ways, "_plan", lambda goal_m: (plan.coarser(), None))
    request = Ideal((0.0, 0.0, 0.12)).request(1, 10.0, Mode.LAND, (1.0, 0.0, 0.12), False)
    asked = replace(request, probe_m=np.array([*place, 0.0]))
    assert ways.probe(request) is None
    found = ways.probe(asked)
    assert found.startswith(answer)
    assert bool(found) == bool(answer)


def test_without_the_network_the_map_alone_leads(eye):
    robot = Ideal(START)
    frame = DepthFrame(1, 0.0, eye.look(robot.pose), CONFIG.camera.intrinsics)
    request = robot.request(1, 0.0, Mode.LAND, LAND_GOAL, False)
    result = Pipeline(CONFIG, network=False, memory=False).cycle(request, frame)
    assert result.network.mu == 1.0
    assert result.followed is not None
    assert result.followed.source is Source.SEARCH
