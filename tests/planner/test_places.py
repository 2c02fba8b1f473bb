"""Places to take off and land: room all round, room overhead, and a floor that is not too steep."""

from __future__ import annotations

import math

import numpy as np
import pytest

from labr_autonomy.config import Clearance, RobotConfig
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.perception.footing import footing
from labr_autonomy.perception.rolling_map import RollingMap
from labr_autonomy.planner.messages import Motion, PlanRequest
from labr_autonomy.planner.places import column_clear, wheels_rise
from labr_autonomy.types import DepthFrame, Mode, Pose
from sim.camera.process import Eye
from sim.camera.rays import RayRenderer
from sim.worlds.world import make_world

CONFIG = RobotConfig()
BELOW_M = CONFIG.body.below_m
HEIGHT_M = 1.2


def request(pose, floor_z_m, mode=Mode.AIR):
    still = np.zeros(3)
    return PlanRequest(
        sequence=1,
        frame_sequence=1,
        frame_pose=pose,
        body_pose=pose,
        start_s=0.0,
        motion=Motion(pose.position_m, still, still, 0.0, 0.0, 0.0),
        mode=mode,
        goal_m=pose.position_m,
        goal_in_air=False,
        floor_z_m=floor_z_m,
        lift_to_m=floor_z_m + BELOW_M + HEIGHT_M,
    )


def ground(rise, extra=()):
    """Floor that rises along x by `rise` per metre from x = 0 on, level before; and boxes' tops."""
    strips = [(-30.0, 0.0, 0.0, 0.0), (0.0, 30.0, 0.0, 30.0 * rise)]
    vertices, faces = [], []
    for x0, x1, z0, z1 in strips:
        n = len(vertices)
        vertices += [(x0, -30, z0), (x1, -30, z1), (x1, 30, z1), (x0, 30, z0)]
        faces += [(n, n + 1, n + 2), (n, n + 2, n + 3)]
    for (x0, y0), (x1, y1), z in extra:
        n = len(vertices)
        vertices += [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]
        faces += [(n, n + 1, n + 2), (n, n + 2, n + 3)]
    return make_world("ground", np.array(vertices, float), np.array(faces), {})


def flown_over(world, to_m=1.5, seed=3):
    """The map of a robot that has flown from over the level part to a place, with the camera's noise."""
    renderer = RayRenderer(world, CONFIG.camera.intrinsics, CONFIG.camera.range_max_m)
    eye, grid = Eye(renderer, CONFIG.camera, seed=seed), RollingMap(CONFIG)
    way = np.linspace(-3.0, to_m, 45)
    for k, x in enumerate(way):
        pose = Pose(np.array([x, 0.0, BELOW_M + HEIGHT_M]), quaternion_from_rpy(0.0, 0.0, 0.0))
        grid.update(DepthFrame(k, 0.1 * k, eye.look(pose), CONFIG.camera.intrinsics), pose, 0.0)
        grid.clear_robot(pose)
    return grid, request(pose, 0.0)


def rise_below(grid, asked):
    return grid.driving.footing(asked.body_pose.position_m[:2], 0.45).rise


def lands(grid, asked, config=CONFIG):
    return column_clear(grid, config, asked, float(asked.body_pose.position_m[2]))


@pytest.mark.parametrize("rise", [0.0, 0.05, math.tan(math.radians(5.0))])
def test_a_floor_of_five_degrees_is_landed_on(rise):
    grid, asked = flown_over(ground(rise), to_m=0.9)
    assert rise_below(grid, asked) == pytest.approx(rise, abs=0.035)
    assert lands(grid, asked)


@pytest.mark.parametrize("rise", [-0.25, -0.3, 0.25])
def test_a_steep_floor_is_refused(rise):
    grid, asked = flown_over(ground(rise))
    assert not lands(grid, asked)


def test_the_limit_is_the_robots_own():
    grid, asked = flown_over(ground(-0.23))
    assert rise_below(grid, asked) == pytest.approx(0.23, abs=0.04)
    bolder = CONFIG.model_copy(update={"clearance": Clearance(landing_slope=0.35)})
    assert not lands(grid, asked)
    assert lands(grid, asked, bolder)


def test_what_was_not_seen_is_not_held_against_a_place():
    grid = RollingMap(CONFIG)
    pose = Pose(np.array([0.0, 0.0, BELOW_M + HEIGHT_M]), quaternion_from_rpy(0.0, 0.0, 0.0))
    grid.clear_robot(pose)
    assert lands(grid, request(pose, 0.0))


@pytest.mark.parametrize(("tilt_deg", "starts"), [(0.0, True), (5.0, True), (12.0, False)])
@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_a_robot_on_its_wheels_takes_off_where_it_is_not_too_inclined(tilt_deg, starts, axis):
    grid = RollingMap(CONFIG)
    roll, pitch = (math.radians(tilt_deg), 0.0) if axis == "roll" else (0.0, math.radians(-tilt_deg))
    pose = Pose(np.array([0.0, 0.0, BELOW_M]), quaternion_from_rpy(roll, pitch, 0.4))
    grid.clear_robot(pose)
    asked = request(pose, 0.0, Mode.LAND)
    assert wheels_rise(pose) == pytest.approx(math.tan(math.radians(tilt_deg)), abs=1e-9)
    assert column_clear(grid, CONFIG, asked, asked.lift_to_m) is starts


def test_a_table_below_and_a_beam_overhead_are_refused():
    table = [((1.3, -0.4), (2.2, 0.4), 0.7)]
    grid, asked = flown_over(ground(0.0, table))
    assert not lands(grid, asked)
    grid, asked = flown_over(ground(0.0, [((1.3, -0.4), (2.2, 0.4), HEIGHT_M + 0.5)]), to_m=1.5)
    on_wheels = request(Pose(np.array([1.5, 0.0, BELOW_M]), quaternion_from_rpy(0, 0, 0)), 0.0, Mode.LAND)
    assert not column_clear(grid, CONFIG, on_wheels, BELOW_M + 2.0)
    assert column_clear(grid, CONFIG, on_wheels, BELOW_M + 0.8)


@pytest.mark.parametrize("rise", [0.0, 0.08])
def test_a_low_thing_on_a_slope_is_refused_and_the_same_slope_without_it_is_not(rise):
    top = rise * 1.0 + 0.2
    grid, asked = flown_over(ground(rise, [((0.8, -0.2), (1.2, 0.2), top)]), to_m=1.0)
    assert not lands(grid, asked)
    grid, asked = flown_over(ground(rise), to_m=1.0)
    assert lands(grid, asked)


def plane(rise_x, rise_y, n=24):
    i, j = np.indices((n, n))
    return 0.05 * (i + 0.5) * rise_x + 0.05 * (j + 0.5) * rise_y


def test_a_plane_is_fitted_exactly_and_unevenness_is_what_is_left():
    found = footing(plane(0.1, -0.05), np.zeros(2), 0.05, np.array([0.6, 0.6]), 0.375)
    assert found.rise == pytest.approx(math.hypot(0.1, 0.05))
    assert found.uneven_m == pytest.approx(0.0, abs=1e-12)
    assert found.seen == pytest.approx(1.0, abs=0.05)
    rough = plane(0.0, 0.0) + 0.03 * np.where(np.indices((24, 24)).sum(axis=0) % 2, 1.0, -1.0)
    assert footing(rough, np.zeros(2), 0.05, np.array([0.6, 0.6]), 0.375).uneven_m == pytest.approx(
        0.03, rel=0.1
    )


def test_too_few_heights_or_a_mere_line_of_them_tell_nothing():
    heights = np.full((24, 24), np.nan)
    place = np.array([0.6, 0.6])
    assert footing(heights, np.zeros(2), 0.05, place, 0.375) is None
    heights[:, 12] = 0.3
    assert footing(heights, np.zeros(2), 0.05, place, 0.375) is None
    heights[:] = plane(0.2, 0.0)
    heights[:13] = np.nan  # one side alone
    heights[16:] = np.nan
    assert footing(heights, np.zeros(2), 0.05, place, 0.375) is None
