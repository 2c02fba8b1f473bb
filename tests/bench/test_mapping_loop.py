"""The mapping method in closed loop with an ideal robot: it arrives, touches nothing, and repeats itself."""

import math

import numpy as np
import pytest

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.planner.messages import Motion, PlanRequest
from labr_autonomy.types import DepthFrame, Mode, Pose
from sim.bench.mapping.planner import MappingPlanner
from sim.camera.process import Eye
from sim.camera.renderer import make_renderer
from sim.worlds.build import build_world
from sim.worlds.surface import Surface

CONFIG = RobotConfig()
START, LAND_GOAL, AIR_GOAL = (-4.0, 0.0, 0.12), (1.5, 1.5, 0.12), (1.0, -1.0, 1.4)
PERIOD_S = 0.1

pytestmark = pytest.mark.timeout(90)  # the first run compiles the kernels


@pytest.fixture(scope="module")
def world():
    spec = {"family": "hall", "size_m": [12.0, 9.0]}
    return build_world(spec, seed=5, clear_m=[START, LAND_GOAL, AIR_GOAL])


@pytest.fixture(scope="module")
def surface(world):
    return Surface(world)


@pytest.fixture
def eye(world):
    renderer = make_renderer(world, CONFIG.camera.intrinsics, CONFIG.camera.range_max_m, kind="rays")
    return Eye(renderer, CONFIG.camera, seed=1)


class Loop:
    """A robot that is where its trajectory says, and its planner."""

    def __init__(self, eye, mode, place, goal, in_air):
        self.eye, self.mode, self.goal, self.in_air = eye, mode, np.array(goal), in_air
        self.planner = MappingPlanner(CONFIG)
        zero = np.zeros(3)
        self.motion = Motion(np.array(place), zero, zero, 0.0, 0.0, 0.0)
        self.count = 0

    def step(self):
        self.count += 1
        k, m, now_s = self.count, self.motion, self.count * PERIOD_S
        pose = Pose(m.position_m, quaternion_from_rpy(0.0, 0.0, m.yaw_rad))
        frame = DepthFrame(k, now_s, self.eye.look(pose), CONFIG.camera.intrinsics)
        request = PlanRequest(
            k, k, pose, pose, now_s, m, self.mode, self.goal, self.in_air, 0.0, 1.4
        )  # fmt: skip
        result = self.planner.cycle(request, frame)
        s = result.trajectory.sample(now_s + PERIOD_S)
        self.motion = Motion(
            s.position_m, s.velocity_mps, s.acceleration_mps2, s.yaw_rad, s.yaw_rate_rps, s.speed_mps
        )
        return result


@pytest.mark.slow
def test_it_drives_round_obstacles_to_a_land_goal(eye, surface):
    loop = Loop(eye, Mode.LAND, START, LAND_GOAL, False)
    clearances = []
    while math.dist(loop.motion.position_m[:2], LAND_GOAL[:2]) > 0.12:
        result = loop.step()
        assert loop.count < 150, result.reason
        assert result.lift_off_m == math.inf
        clearances.append(surface.clearance(loop.motion.position_m, on_floor=True))
    assert min(clearances) > 0.0


@pytest.mark.slow
def test_it_flies_to_an_air_goal(eye, surface):
    loop = Loop(eye, Mode.AIR, (-4.0, 0.0, 1.4), AIR_GOAL, True)
    clearances = []
    while math.dist(loop.motion.position_m, AIR_GOAL) > 0.1:
        result = loop.step()
        assert loop.count < 120, result.reason
        clearances.append(surface.clearance(loop.motion.position_m))
    assert min(clearances) > 0.0


@pytest.mark.slow
def test_an_air_goal_out_of_view_makes_it_take_off_at_once(eye):
    loop = Loop(eye, Mode.LAND, START, (-1.0, 3.0, 1.4), True)  # 45 degrees to the left
    result = loop.step()
    assert result.lift_off_m == 0.0
    assert result.take_off_clear


@pytest.mark.slow
def test_the_same_images_give_the_same_plans(world):
    runs = []
    for _ in range(2):
        renderer = make_renderer(world, CONFIG.camera.intrinsics, CONFIG.camera.range_max_m, kind="rays")
        loop = Loop(Eye(renderer, CONFIG.camera, seed=1), Mode.LAND, START, LAND_GOAL, False)
        runs.append([loop.step().trajectory for _ in range(12)])
    for a, b in zip(*runs, strict=True):
        assert np.array_equal(a.position_m, b.position_m)
        assert np.array_equal(a.yaw_rad, b.yaw_rad)
