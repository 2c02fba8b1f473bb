import math

import numpy as np
import pytest

from labr_autonomy.config import LandLimits, RobotConfig
from labr_autonomy.types import Mode, Source
from sim.bench.iplanner.fear import FRAMES, Fear, leads_forward, step
from sim.bench.iplanner.follower import LONGEST_S, FollowerLimits, roll_out

LIMITS = FollowerLimits.of(RobotConfig())
U = np.linspace(0.0, 1.0, 51)
BEND = np.stack([6.0 * U, 1.5 * np.sin(3.0 * U)], axis=1)
STRAIGHT = np.stack([5.0 * U, np.zeros(51)], axis=1)


def roll(path, x=0.0, y=0.0, yaw=0.0, speed=0.0, rate=0.0, limits=LIMITS):
    return roll_out(path, np.array([x, y, yaw, speed, rate]), limits, 3.0, 0.12, Source.GKPN)


@pytest.mark.parametrize("yaw", [0.0, 0.4, 1.5, 3.1, -2.5])
@pytest.mark.parametrize("path", [STRAIGHT, BEND])
def test_follower_reaches_the_paths_end_and_rests_there_within_the_wheels_limits(path, yaw):
    plan, land = roll(path, yaw=yaw, speed=0.3), RobotConfig().land
    assert plan.mode is Mode.LAND
    assert math.dist(plan.position_m[-1, :2], path[-1]) < LIMITS.stop_m
    assert plan.speed_mps[-1] == plan.yaw_rate_rps[-1] == 0.0
    assert plan.speed_mps.min() >= 0.0
    assert plan.speed_mps.max() <= land.speed_mps + 1e-9
    assert np.abs(plan.yaw_rate_rps).max() <= land.yaw_rate_rps + 1e-9
    assert np.abs(np.diff(plan.speed_mps)).max() <= land.acceleration_mps2 * plan.step_s + 1e-9
    assert np.abs(np.diff(plan.yaw_rate_rps)).max() <= land.yaw_acceleration_rps2 * plan.step_s + 1e-9


def test_follower_keeps_to_the_path():
    at = roll(BEND).position_m[:, :2]
    assert np.linalg.norm(at[:, None] - BEND[None], axis=2).min(axis=1).max() < 0.08


def test_trajectory_is_the_motion_of_a_unicycle():
    plan = roll(BEND, yaw=1.0)
    moved = np.diff(plan.position_m, axis=0)
    middle = 0.5 * (plan.velocity_mps[1:] + plan.velocity_mps[:-1]) * plan.step_s
    np.testing.assert_allclose(moved[:-1], middle[:-1], atol=5e-4)  # the last step ends before its time
    turned = 0.5 * (plan.yaw_rate_rps[1:] + plan.yaw_rate_rps[:-1]) * plan.step_s
    np.testing.assert_allclose(np.diff(plan.yaw_rad)[:-1], turned[:-1], atol=2e-3)
    assert (plan.position_m[:, 2] == 0.12).all()


def test_follower_turns_on_the_spot_before_it_drives_off_the_other_way():
    plan = roll(STRAIGHT, yaw=math.pi - 0.1)
    turning = np.abs((plan.yaw_rad + math.pi) % (2 * math.pi) - math.pi) > 0.5
    assert turning[0]
    assert np.abs(plan.position_m[turning, :2]).max() < 0.01


def test_look_ahead_is_a_quarter_metre_and_the_cameras_offset():
    assert pytest.approx(0.39) == LIMITS.look_ahead_m
    # at the corner of an L the heading changes once the corner is nearer than that
    corner = np.concatenate([np.stack([2 * U, 0 * U], 1), np.stack([2 + 0 * U, 2 * U], 1)])
    plan = roll(corner)
    began = plan.position_m[np.argmax(plan.yaw_rad > 0.02), 0]
    assert 2.0 - 0.39 - 0.02 < began < 2.0 - 0.39 + 0.12


def test_a_single_point_means_stop_as_fast_as_the_wheels_may():
    plan = roll(np.zeros((1, 2)), speed=0.8, rate=1.0)
    assert plan.end_s - plan.start_s == pytest.approx(0.8, abs=0.06)
    assert plan.position_m[-1, 0] == pytest.approx(0.8**2 / 2, abs=0.1)
    assert plan.speed_mps[-1] == plan.yaw_rate_rps[-1] == 0.0


def test_a_path_too_long_for_the_horizon_is_left_at_rest():
    plan = roll(np.stack([40.0 * U, np.zeros(51)], axis=1))
    assert plan.end_s - plan.start_s == pytest.approx(LONGEST_S + 0.8, abs=0.1)
    assert plan.speed_mps[-1] == 0.0
    assert 14.0 < plan.position_m[-1, 0] < 16.0


def test_published_limits_hold_where_the_robot_could_do_more():
    land = LandLimits(speed_mps=3.0, acceleration_mps2=9.0, yaw_rate_rps=9.0)
    quick = FollowerLimits.of(RobotConfig(land=land))
    assert (quick.speed_mps, quick.acceleration_mps2) == (1.5, 2.5)
    assert quick.yaw_rate_rps == pytest.approx(math.radians(90.0))


def test_follower_repeats_itself():
    a, b = roll(BEND, yaw=0.3), roll(BEND, yaw=0.3)
    np.testing.assert_array_equal(a.position_m, b.position_m)


# ---------------------------------------------------------------- fear
def after(*frames, state=None):
    state = state or Fear()
    for fear, forward in frames:
        state = step(state, fear, forward)
    return state


def test_the_robot_stops_after_more_than_three_feared_frames_and_not_before():
    assert FRAMES == 3
    assert not after(*[(0.9, True)] * 3).stopped
    assert after(*[(0.9, True)] * 4).stopped


def test_a_path_that_leads_aside_and_fear_at_the_threshold_do_not_count():
    assert after(*[(0.9, False)] * 20) == Fear()
    assert after(*[(0.5, True)] * 20) == Fear()


def test_good_frames_are_forgotten_while_it_drives_and_count_down_while_it_stands():
    assert after((0.9, True), (0.1, True), (0.9, True)).count == 2
    standing = after(*[(0.9, True)] * 4)
    assert after(*[(0.9, True)] * 9, state=standing) == standing
    assert after(*[(0.1, True)] * 3, state=standing) == Fear(1, True)
    assert after(*[(0.1, True)] * 4, state=standing) == Fear(0, False)


def test_direction_of_a_path_is_that_of_its_first_point_beyond_half_a_metre():
    out = np.linspace(0.0, 3.0, 51)[:, None]
    for bearing, forward in ((0.0, True), (1.0, True), (1.1, False), (3.0, False), (-1.1, False)):
        assert leads_forward(out * [math.cos(bearing), math.sin(bearing), 0.0]) is forward
    assert leads_forward(np.zeros((51, 3)))
