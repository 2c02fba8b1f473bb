import math

import numpy as np
import pytest

from labr_autonomy.config import RobotConfig
from sim.dataset import HEIGHT, WIDTH, Caster, DataConfig, build, degrade
from sim.worlds.primitives import Scene, box

ROBOT = RobotConfig()
EMPTY = Scene(np.zeros((0, 8)))


@pytest.fixture(scope="module")
def data():
    return build(DataConfig(scenes=4, views=8, goals=8, seed=11), ROBOT)


def test_same_seed_same_data(data):
    again = build(DataConfig(scenes=4, views=8, goals=8, seed=11), ROBOT)
    for name, values in data.items():
        np.testing.assert_array_equal(values, again[name])


def test_shapes_and_ranges(data):
    assert data["images_m"].shape == (32, 90, 160)
    images = data["images_m"].astype(np.float32)
    valid = images > 0
    assert 0.2 < valid.mean() < 0.98
    assert images[valid].min() >= ROBOT.camera.range_min_m - 1e-3
    assert images.max() <= ROBOT.camera.range_max_m + 1e-3


def test_starts_and_goals_are_free_and_half_of_the_goals_are_in_the_air(data):
    for i, pose in enumerate(data["poses"].astype(float)):
        rows = data["solids"][data["scene"][i]].astype(float)
        scene = Scene(rows[np.abs(rows[:, 1]) < 500])
        assert scene.distance(pose[:3]) > 0.37
        c, s = math.cos(pose[3]), math.sin(pose[3])
        goals = data["goals_m"][i].astype(float)
        odom = goals @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]]) + pose[:3]
        assert scene.distance(odom).min() > 0.36
        height = odom[:, 2]
        assert (height[:4] <= ROBOT.body.below_m + 1e-5).all()
        assert (height[4:] > ROBOT.body.below_m + 0.3).all()


def test_robots_on_wheels_stand_nearly_level_and_flying_ones_may_tilt(data):
    flying = data["poses"][:, 2] > 0.2
    assert flying.any()
    assert (~flying).sum() > flying.sum()
    tilt = np.degrees(np.abs(data["poses"][:, 4:]))
    assert tilt[~flying].max() <= 3.0 + 1e-4
    assert tilt[flying].max() <= 12.0 + 1e-4
    np.testing.assert_allclose(data["poses"][~flying, 2], ROBOT.body.below_m)


def test_a_wall_ahead_is_seen_at_its_distance_from_the_camera():
    wall = Scene(box([3.0, 0.0, 1.0], [0.5, 2.0, 1.0])[None])
    image = Caster(wall, ROBOT).depth(np.array([0.0, 0.0, 0.12]), np.zeros(3))
    assert image.shape == (HEIGHT, WIDTH)
    assert image[40, 80] == pytest.approx(2.5 - ROBOT.camera.x_m, abs=1e-3)
    left = Caster(wall, ROBOT).depth(np.array([0.0, 0.0, 0.12]), np.array([0.0, 0.0, 0.5]))
    assert left[40, 140] > 0 > left[40, 20] - 1e-6  # turned left, the wall is on the right


def test_the_floor_is_seen_below_the_horizon_where_geometry_says():
    image = Caster(EMPTY, ROBOT).depth(np.array([0.0, 0.0, 0.12]), np.zeros(3))
    slope = (60 + 0.5 - 45.0) / 79.5
    assert image[60, 80] == pytest.approx((0.12 + ROBOT.camera.z_m) / slope, rel=1e-3)
    assert not image[:45].any()


def test_noise_grows_with_the_square_of_depth_and_makes_holes():
    rng = np.random.default_rng(0)
    spread = []
    for depth in (1.0, 4.0):
        seen = [degrade(np.full((HEIGHT, WIDTH), depth, np.float32), ROBOT, rng) for _ in range(12)]
        values = np.concatenate([s[s > 0] for s in seen])
        assert abs(np.median(values) - depth) < 0.01 * depth
        spread.append(values.std())
        assert all((s == 0).mean() < 0.25 for s in seen)
    assert 4.0 < spread[1] / spread[0] < 20.0


def test_a_near_edge_throws_a_stereo_shadow_on_its_left():
    depth = np.full((HEIGHT, WIDTH), 5.0, np.float32)
    depth[:, 80:] = 0.6
    images = [degrade(depth, ROBOT, np.random.default_rng(i)) for i in range(8)]
    lost = np.mean([img == 0 for img in images], axis=(0, 1))
    assert lost[75:79].min() > 0.9
    assert lost[60:72].mean() < 0.3
    assert lost[82:95].mean() < 0.3
