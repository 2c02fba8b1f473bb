from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit

from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import LabrError
from labr_autonomy.frames import quaternion_from_rpy, rotation_matrix
from labr_autonomy.perception import raycast
from labr_autonomy.perception.rolling_map import HIT, OCCUPIED, RollingMap
from labr_autonomy.types import DepthFrame, Pose

CONFIG = RobotConfig()
OPTICS = CONFIG.camera.intrinsics
V, U = np.mgrid[0 : OPTICS.height, 0 : OPTICS.width]
# Plane by plane, and never exactly along an axis: that would divide nought by nought.
RAYS = np.stack([np.ones(U.shape), -(U + 1e-4 - OPTICS.cx) / OPTICS.fx, -(V + 1e-4 - OPTICS.cy) / OPTICS.fy])
RAYS = RAYS.astype(np.float32)


def pose(x=0.0, y=0.0, yaw=0.0, z=0.12, roll=0.0, pitch=0.0):
    return Pose(np.array([x, y, z]), quaternion_from_rpy(roll, pitch, yaw))


def depth_of(boxes, at, inside=None):
    """Exact depth image of axis-aligned boxes (lower, upper), and of the inner faces of one room."""
    rotation = rotation_matrix(at.quaternion)
    eye = at.position_m + rotation @ np.array([CONFIG.camera.x_m, 0.0, CONFIG.camera.z_m])
    rays = [sum(np.float32(rotation[k, j]) * RAYS[j] for j in range(3)) for k in range(3)]
    inverse = [1.0 / np.where(ray == 0.0, np.float32(1e-9), ray) for ray in rays]

    def slabs(lower, upper):
        pairs = [((lower[k] - eye[k]) * inverse[k], (upper[k] - eye[k]) * inverse[k]) for k in range(3)]
        near = np.maximum.reduce([np.minimum(a, b) for a, b in pairs])
        return near, np.minimum.reduce([np.maximum(a, b) for a, b in pairs])

    depth = np.full(U.shape, np.inf, np.float32)
    for box in boxes:
        near, far = slabs(*box)
        depth = np.where((near < far) & (near > 0), np.minimum(depth, near), depth)
    if inside is not None:
        depth = np.minimum(depth, slabs(*inside)[1])
    return np.where(depth < 10.0, depth, 0.0).astype(np.float32)


def frame(depth, k=0):
    return DepthFrame(k, 0.0, depth, OPTICS)


ROOM = ([-3.0, -2.5, 0.0], [4.0, 2.5, 2.8])
FLOOR = ([-20.0, -20.0, -1.0], [20.0, 20.0, 0.0])


NOTHING = np.zeros(U.shape, np.float32)


def state_at(grid, *point):
    index = np.floor((np.array(point) - grid.origin_m) / grid.cell_m).astype(int)
    value = grid.log_odds[tuple(index)]
    return "occupied" if value >= OCCUPIED else "free" if value < 0 else "unknown"


@pytest.fixture(scope="module")
def room_map():
    """A robot turns round in an empty room; the sensor has the noise of a D435."""
    grid, rng = RollingMap(CONFIG), np.random.default_rng(1)
    for k in range(48):
        at = pose(0.03, -0.02, yaw=math.radians(15 * k))
        depth = depth_of([], at, ROOM)
        noisy = depth + rng.normal(0, 1, depth.shape) * 0.1 * depth**2 / (2 * OPTICS.fx * 0.05)
        grid.update(frame(noisy.astype(np.float32), k), at, 0.0)
    return grid


@pytest.mark.slow
def test_walls_of_a_room_are_where_they_are_within_a_cell(room_map):
    cells = room_map.origin_m + (np.argwhere(room_map.occupied) + 0.5) * 0.1
    to_wall = np.minimum(cells - ROOM[0], ROOM[1] - cells)[:, [0, 1, 2]]
    off = np.minimum(np.abs(to_wall[:, 0]), np.abs(to_wall[:, 1]))
    off = np.minimum(off, np.abs(ROOM[1][2] - cells[:, 2]))
    assert len(cells) > 1000
    assert (off > 0.15 + 1e-9).sum() / len(cells) < 0.005
    assert cells[:, 2].min() > 0.0
    for y in np.arange(-2.2, 2.3, 0.2):  # no gaps at the robot's height
        assert any(state_at(room_map, x, y, 0.25) == "occupied" for x in (3.85, 3.95, 4.05))
        assert any(state_at(room_map, x, y, 0.25) == "occupied" for x in (-2.85, -2.95, -3.05))


@pytest.mark.slow
def test_inside_the_room_is_free_and_behind_its_walls_nothing_is_known(room_map):
    for x, y in ((1.5, 0.0), (-1.5, 1.0), (0.5, -2.0)):
        assert state_at(room_map, x, y, 0.25) == "free"
    for x, y in ((4.5, 0.0), (-3.5, 1.0), (0.5, -3.0)):
        assert state_at(room_map, x, y, 0.25) == "unknown"
    field = room_map.land_field(pose(), 0.0)
    points = np.array([[2.0, 0.0], [-1.0, 1.0], [5.0, 0.0]])
    assert field.is_known(points).tolist() == [True, True, False]
    assert field.lookup(np.array([[2.5, 0.3]]))[0] == pytest.approx(1.5, abs=0.25)
    assert field.lookup(np.array([[0.5, 1.5]]))[0] == pytest.approx(1.0, abs=0.25)


def play(grid, depth, at=None, frames=1, floor_z_m=0.0):
    at = at or pose()
    for _ in range(frames):
        grid.update(frame(depth), at, floor_z_m)
    return grid


def brute_force(depth, at, grid_origin, shape, cell, stride):
    """Marks by stepping along every ray in millimetres."""
    passed, hit = np.zeros(shape, bool), np.zeros(shape, bool)
    rotation = rotation_matrix(at.quaternion)
    eye = at.position_m + rotation @ np.array([CONFIG.camera.x_m, 0.0, CONFIG.camera.z_m])
    for v in range(0, depth.shape[0], stride):
        for u in range(0, depth.shape[1], stride):
            z = depth[v, u]
            ray = rotation @ RAYS[:, v, u]
            sigma = 0.1 * z * z / (2 * OPTICS.fx * 0.05)
            reach = max(0.0, z - max(0.05 / np.linalg.norm(ray), 2 * sigma))
            border = min(u, depth.shape[1] - 1 - u), min(v, depth.shape[0] - 1 - v)
            if min(border) == 0:  # only cells that are wholly in view are carved
                begin = reach
            else:
                begin = max(OPTICS.fx * cell / border[0], OPTICS.fy * cell / border[1])
            steps = eye + np.arange(begin, reach, 1e-3)[:, None] * ray
            index = np.floor((steps - grid_origin) / cell).astype(int)
            index = index[np.all((index >= 0) & (index < shape), axis=1)]
            passed[tuple(index.T)] = True
            end = np.floor((eye + z * ray - grid_origin) / cell).astype(int)
            if np.all((end >= 0) & (end < shape)):
                hit[tuple(end)] = True
    return passed, hit


@pytest.mark.slow
def test_ray_casting_equals_brute_force_on_a_wall():
    at = pose(0.013, -0.027, yaw=0.35, z=1.53, roll=0.1, pitch=-0.15)
    depth = depth_of([([2.017, -9, -9], [3, 9, 9])], at)
    stride = 12
    grid = RollingMap(CONFIG, stride=stride)
    play(grid, depth, at)
    # Leave out the floor's rule: the wall is seen well above it everywhere but at the lowest cells.
    passed, hit = brute_force(depth, at, grid.origin_m, grid.log_odds.shape, 0.1, stride)
    above = slice(4, None)
    gained, lost = (grid.log_odds > 0)[:, :, above], (grid.log_odds < 0)[:, :, above]
    assert (gained == hit[:, :, above]).all()
    # Stepping misses corners that a ray cuts by less than a millimetre.
    expected = (passed & ~hit)[:, :, above]
    assert not (expected & ~lost).any()
    assert (lost & ~expected).sum() < 0.02 * expected.sum()


def test_the_floor_is_carved_but_never_solid():
    grid = play(RollingMap(CONFIG), depth_of([FLOOR], pose()), frames=5)
    assert not grid.occupied.any()
    assert state_at(grid, 1.5, 0.0, 0.05) == "free"
    assert grid.land_field(pose(), 0.0).is_known(np.array([[1.5, 0.0]]))[0]


def test_a_low_step_is_an_obstacle_and_a_table_top_is_not():
    step, table = ([1.5, -0.5, 0.0], [1.8, 0.5, 0.09]), ([1.2, -0.5, 0.6], [2.2, 0.5, 0.65])
    grid = play(RollingMap(CONFIG), depth_of([FLOOR, step, table], pose()), frames=9)
    field = grid.land_field(pose(), 0.0)
    assert field.lookup(np.array([[1.5, 0.0]]))[0] < 0.1
    only_table = play(RollingMap(CONFIG), depth_of([FLOOR, table], pose()), frames=9)
    assert only_table.occupied.any()
    assert only_table.land_field(pose(), 0.0).lookup(np.array([[1.6, 0.0]]))[0] > 1.0
    assert only_table.air_field(np.zeros(2)).lookup(np.array([[1.3, 0.0, 0.62]]))[0] < 0.1


def test_the_floor_may_be_elsewhere():
    raised = ([-20.0, -20.0, -1.0], [20.0, 20.0, 0.43])
    at = pose(z=0.55)
    grid = play(RollingMap(CONFIG), depth_of([raised], at), at, frames=4, floor_z_m=0.43)
    assert not grid.occupied.any()
    wrong = play(RollingMap(CONFIG), depth_of([raised], at), at, frames=4, floor_z_m=0.0)
    assert wrong.occupied.any()


def test_one_noisy_return_leaves_no_obstacle():
    empty = depth_of([FLOOR, ([5.0, -9, 0], [5.5, 9, 3])], pose())
    flying = empty.copy()
    flying[115:125, 207:217] = 1.5  # a clump of wrong pixels in one frame
    grid = play(RollingMap(CONFIG), empty, frames=3)
    play(grid, flying)
    assert state_at(grid, 1.64, 0.0, 0.18) != "occupied"
    fresh = play(RollingMap(CONFIG), flying)  # also where nothing was known before
    assert not fresh.occupied.any()
    play(fresh, empty, frames=5)
    assert state_at(fresh, 1.64, 0.0, 0.18) == "free"


def test_two_sure_returns_make_an_obstacle():
    near = depth_of([FLOOR, ([1.5, -0.2, 0], [1.8, 0.2, 1.0])], pose())
    grid = play(RollingMap(CONFIG), near)
    assert not grid.occupied.any()
    play(grid, near)
    assert state_at(grid, 1.55, 0.0, 0.18) == "occupied"


@pytest.mark.slow
@pytest.mark.parametrize("distance_m", [1.23, 2.5, 2.53])
def test_a_thin_chair_leg_stays(distance_m):
    """3 cm wide: most rays that pass its cell do not hit it, some frames miss it altogether."""
    grid, rng = RollingMap(CONFIG), np.random.default_rng(2)
    leg = ([distance_m, 0.02, 0.0], [distance_m + 0.03, 0.05, 0.45])
    wall = ([4.5, -9, 0], [5, 9, 3])
    for k in range(20):
        at = pose(0.004 * k, 0.0, yaw=0.002 * rng.normal())
        depth = depth_of([FLOOR, leg, wall], at)
        if k % 3 == 2:  # the camera loses it in every third frame
            depth = depth_of([FLOOR, wall], at)
        noisy = depth + rng.normal(0, 1, depth.shape) * 0.1 * depth**2 / (2 * OPTICS.fx * 0.05)
        grid.update(frame(noisy.astype(np.float32), k), at, 0.0)
        if k >= 10:
            cells = [state_at(grid, distance_m + dx, 0.035, 0.25) for dx in (-0.03, 0.015)]
            assert "occupied" in cells


@pytest.mark.slow
def test_what_goes_away_is_no_obstacle_after_a_third_of_a_second():
    with_box = depth_of([FLOOR, ([1.5, -0.3, 0], [1.8, 0.3, 1.0]), ([4, -9, 0], [5, 9, 3])], pose())
    without = depth_of([FLOOR, ([4, -9, 0], [5, 9, 3])], pose())
    grid = play(RollingMap(CONFIG), with_box, frames=30)
    assert state_at(grid, 1.55, 0.0, 0.25) == "occupied"
    play(grid, without, frames=10)
    assert state_at(grid, 1.55, 0.0, 0.25) != "occupied"
    play(grid, without, frames=5)
    assert state_at(grid, 1.55, 0.0, 0.25) == "free"


def test_invalid_pixels_carve_nothing():
    for nothing in (0.0, np.nan, np.inf, -1.0, 50.0):
        grid = play(RollingMap(CONFIG), np.full(U.shape, nothing, np.float32), frames=2)
        assert not grid.log_odds.any()


def test_far_returns_carve_up_to_the_range_only():
    grid = play(
        RollingMap(CONFIG), depth_of([([8.0, -9, -9], [9, 9, 9])], pose(z=1.0)), pose(z=1.0), frames=3
    )
    assert state_at(grid, 5.0, 0.0, 1.06) == "free"
    assert state_at(grid, 6.6, 0.0, 1.06) == "unknown"
    assert not grid.occupied.any()


@pytest.mark.parametrize(("dx", "dy"), [(0.43, -0.31), (3.0, 2.0), (-7.7, 0.1)])
def test_rolling_keeps_what_stays_and_forgets_what_leaves(dx, dy):
    near = depth_of([FLOOR, ([1.5, -0.2, 0], [1.8, 0.2, 1.0])], pose())
    grid = play(RollingMap(CONFIG), near, frames=3)
    before = {tuple(c) for c in np.round(grid.origin_m / 0.1).astype(int) + np.argwhere(grid.occupied)}
    play(grid, NOTHING, pose(dx, dy))
    after = {tuple(c) for c in np.round(grid.origin_m / 0.1).astype(int) + np.argwhere(grid.occupied)}
    assert before == after
    assert np.abs(grid.origin_m[:2] + 10.0 - [dx, dy]).max() <= 0.1
    play(grid, NOTHING, pose(100.0))
    assert not grid.log_odds.any()


def test_a_high_flight_stays_inside_the_box():
    grid, at = RollingMap(CONFIG), pose(z=4.0)
    assert play(grid, depth_of([FLOOR, ([2, -9, 0], [3, 9, 9])], at), at, frames=3)
    assert grid.occupied.any()


def test_the_robot_itself_is_free_space():
    grid = RollingMap(CONFIG)
    grid.clear_robot(pose(0.5, 0.5))
    for point in ((0.5, 0.5, 0.05), (0.7, 0.5, 0.15), (0.5, 0.29, 0.2)):
        assert state_at(grid, *point) == "free"
    assert state_at(grid, 0.9, 0.5, 0.15) == "unknown"
    assert grid.land_field(pose(0.5, 0.5), 0.0).is_known(np.array([[0.5, 0.5]]))[0]


def test_air_field_has_a_floor():
    grid = play(RollingMap(CONFIG), depth_of([FLOOR], pose()), frames=2)
    point = np.array([[0.5, 0.2, 0.72]])
    field = grid.air_field(np.array([0.5, 0.0, 1.0]))
    assert field.lookup(point)[0] == pytest.approx(0.72, abs=1e-5)
    assert field.distance_m.shape == (60, 60, 32)
    assert field.contains(point)[0]


def test_air_field_is_clipped_to_the_box():
    grid = play(RollingMap(CONFIG), depth_of([FLOOR], pose()))
    field = grid.air_field(np.array([9.0, 0.0]))
    assert field.distance_m.shape[0] == 40
    assert field.upper_m[0] == pytest.approx(10.0)
    assert grid.air_field(np.array([30.0, 0.0])).distance_m.shape[0] == 1


def test_a_wall_whose_top_is_out_of_view_is_taken_to_go_on_and_a_crate_is_not():
    wall, crate = ([1.2, -3.0, 0], [1.3, 0.0, 3.0]), ([1.8, 0.4, 0], [2.2, 0.8, 0.5])
    grid = play(RollingMap(CONFIG), depth_of([FLOOR, wall, crate], pose()), pose(), frames=9)
    high = grid.slice_field(pose(), 1.9)
    assert high.lookup(np.array([[1.25, -0.5]]))[0] < 0.1
    assert not high.is_known(np.array([[2.0, 0.6]]))[0]


def test_asking_for_a_slice_at_flying_height_changes_nothing():
    box, lamp = ([1.5, -0.2, 0], [1.8, 0.2, 0.5]), ([1.5, -0.2, 1.4], [1.7, 0.2, 1.6])
    at = pose(z=1.5)
    grid = play(RollingMap(CONFIG), depth_of([FLOOR, box, lamp], at), at, frames=9)
    before, origin = grid.log_odds.copy(), grid.origin_m
    point = np.array([[1.6, 0.0]])
    slice_ = grid.slice_field(at, 1.5 - 0.22)
    assert slice_.lookup(point)[0] < 0.1
    assert grid.slice_field(at, 1.8).lookup(point)[0] < 0.1  # nobody has seen that it ends below
    assert grid.slice_field(at, 0.2).lookup(point)[0] > 1.0
    assert (grid.log_odds == before).all()
    assert (grid.origin_m == origin).all()
    assert grid.floor_z_m == 0.0


@pytest.mark.slow
def test_landing_places_are_judged():
    grid = RollingMap(CONFIG)
    with pytest.raises(LabrError, match="empty"):
        grid.column_clear(np.zeros(2), 0.45, 0.1, 1.0)
    post = ([2.0, -0.05, 0.0], [2.1, 0.05, 2.0])
    for k in range(12):
        at = pose(yaw=0.05 * (k - 6))
        play(grid, depth_of([FLOOR, post, ([5, -9, 0], [6, 9, 3])], at), at)
    free = grid.column_clear(np.array([1.5, 0.0]), 0.3, 0.06, 0.5)
    assert free.clear
    assert free.known > 0.95
    blocked = grid.column_clear(np.array([1.8, 0.1]), 0.3, 0.06, 0.5)
    assert not blocked.clear
    behind = grid.column_clear(np.array([-2.0, 0.0]), 0.3, 0.06, 0.5)
    assert behind.clear
    assert behind.known == 0.0
    assert grid.column_clear(np.array([50.0, 0.0]), 0.3, 0.06, 0.5).known == 0.0


def test_a_full_hit_stays_below_the_threshold_of_an_obstacle():
    assert HIT < OCCUPIED <= 2 * HIT


def pan_past_a_leg(grid):
    """A thin leg is seen well, then leaves the view at the left while its cell's other side stays in."""
    leg = ([1.50, 0.06, 0.0], [1.53, 0.09, 0.5])
    wall = ([4.0, -9.0, 0.0], [4.1, 9.0, 3.0])
    for _ in range(6):
        at = pose()
        play(grid, depth_of([FLOOR, leg, wall], at), at)

    def column(yaw):
        eye = CONFIG.camera.x_m * np.array([math.cos(yaw), math.sin(yaw)])
        to_leg = np.array([1.515, 0.06]) - eye
        return 212.0 - 212.0 * math.tan(math.atan2(to_leg[1], to_leg[0]) - yaw)

    just_out = [yaw for yaw in np.linspace(-0.9, -0.5, 4000) if -6.0 < column(yaw) < -1.0]
    for yaw in just_out[:: max(1, len(just_out) // 30)]:
        at = pose(yaw=float(yaw))
        play(grid, depth_of([FLOOR, leg, wall], at), at)
    return state_at(grid, 1.52, 0.075, 0.25)


def test_a_leg_at_the_border_of_the_view_is_not_forgotten():
    assert pan_past_a_leg(RollingMap(CONFIG)) == "occupied"


def test_without_the_rule_of_the_border_the_leg_would_be_forgotten(monkeypatch):
    monkeypatch.setattr(raycast, "wholly_in_view", njit(lambda *_: 0.0))
    monkeypatch.setattr(raycast, "cast", njit(raycast.cast.py_func))
    assert pan_past_a_leg(RollingMap(CONFIG)) != "occupied"


def test_what_was_not_seen_again_is_forgotten_as_the_robot_drives_on():
    """The pose drifts away from it: on the floor and at the height of flight."""
    grid, at = RollingMap(CONFIG), pose()
    wall = [FLOOR, ([1.5, -1.0, 0.0], [1.6, 1.0, 1.5])]
    play(grid, depth_of(wall, at), frames=20)
    high, low = np.array([[1.55, 0.0, 1.0]]), np.array([[1.55, 0.0]])

    def seen():
        field = grid.land_field(at, 0.0)
        return grid.air_field(np.zeros(2)).lookup(high)[0] < 0.1, field.lookup(low)[0] < 0.1

    assert seen() == (True, True)
    for k in range(30):
        grid.update(frame(NOTHING, 99), pose(-1.1 * (k % 2), 0.0), 0.0)
    assert seen() == (True, True)
    for k in range(30):
        grid.update(frame(NOTHING, 99), pose(-1.1 * (k % 2), 0.0), 0.0)
    assert seen() == (False, False)
