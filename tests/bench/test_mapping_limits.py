"""What leaves the local planners: within limits, clear of the map, at rest; and the take-off rule."""

import math

import numpy as np
import pytest

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.modes import decision
from labr_autonomy.modes.energy import EnergyModel
from labr_autonomy.perception.driving_layer import CELL_M
from labr_autonomy.perception.fields import Field2, Field3
from labr_autonomy.perception.rolling_map import RollingMap
from labr_autonomy.planner.messages import Motion, PlanRequest
from labr_autonomy.refine.planner import Refiner
from labr_autonomy.refine.values import AirState, LandState
from labr_autonomy.types import Mode, Pose, Source
from sim.bench.mapping import takeoff
from sim.bench.mapping.astar import way_on_map
from sim.bench.mapping.flight import Flight
from sim.bench.mapping.ground import Ground
from sim.bench.mapping.planner import MappingPlanner

CONFIG = RobotConfig()
CAMERA = CONFIG.camera

pytestmark = pytest.mark.timeout(90)  # the first run compiles the kernels


@pytest.fixture(scope="module")
def refiner():
    return Refiner(CONFIG)


def pillars(seed, start, goal, count=12):
    rng = np.random.default_rng([seed, 11])
    occupied = np.zeros((100, 100), bool)
    for _ in range(count):
        centre, half = rng.uniform(1.5, 8.5, 2), rng.uniform(0.1, 0.5, 2)
        if (
            min(np.linalg.norm(np.maximum(np.abs(np.array(p) - centre) - half, 0)) for p in (start, goal))
            > 0.8
        ):
            low, high = np.floor((centre - half) * 10).astype(int), np.ceil((centre + half) * 10).astype(int)
            occupied[low[0] : high[0], low[1] : high[1]] = True
    return occupied


def flat(occupied):
    return Field2.from_occupied(occupied, np.ones_like(occupied), np.zeros(2), 0.1)


def tall(occupied):
    space = np.repeat(occupied[:, :, None], 28, axis=2)
    space[:, :, 0] = True  # the floor, below z = 0
    return Field3.from_occupied(space, np.ones_like(space), np.array([0.0, 0.0, -0.1]), 0.1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_driving_keeps_limits_and_distance(refiner, seed):
    ground, lim = Ground(CONFIG, refiner), CONFIG.land
    start, goal = np.array([1.0, 1.0]), np.array([7.0, 5.0 + 0.3 * seed])
    field = flat(pillars(seed, start, goal))
    rng = np.random.default_rng([seed, 3])
    speed, rate = float(rng.choice([0.0, 0.6])), float(rng.uniform(-0.5, 0.5))
    state = LandState(start, math.atan2(goal[1] - 1.0, 6.0) + float(rng.uniform(-0.6, 0.6)), speed, rate)
    way = way_on_map(field, start, goal, ground.hard_m + 0.06, 0.5)
    plan = ground.plan(state, way.points_m, field, 3.0).trajectory
    assert plan is not None
    assert plan.position_m[0, :2] == pytest.approx(start)
    assert (plan.yaw_rad[0], plan.speed_mps[0], plan.yaw_rate_rps[0]) == (state.yaw, speed, rate)
    assert plan.speed_mps.max() <= lim.speed_mps + 1e-9
    assert plan.speed_mps.min() >= -1e-9
    assert np.abs(plan.yaw_rate_rps).max() <= lim.yaw_rate_rps + 1e-9
    assert np.abs(np.diff(plan.speed_mps)).max() <= lim.acceleration_mps2 * plan.step_s + 1e-9
    assert np.abs(np.diff(plan.yaw_rate_rps)).max() <= lim.yaw_acceleration_rps2 * plan.step_s + 1e-9
    assert plan.speed_mps[-1] == plan.yaw_rate_rps[-1] == 0.0
    times = np.arange(plan.start_s, plan.end_s, 0.01)
    points = np.stack([plan.sample(t).position_m[:2] for t in times])
    assert field.lookup(points).min() > ground.hard_m - 0.004
    # no sliding: the way is covered along the heading, at the speed that is said
    v = np.array([plan.sample(t).speed_mps for t in times])
    yaw = np.array([plan.sample(t).yaw_rad for t in times])
    way_m = points[0] + np.cumsum(0.01 * v[:, None] * np.stack([np.cos(yaw), np.sin(yaw)], axis=1), axis=0)
    assert np.abs(way_m - points).max() < 0.03
    length_m = np.hypot(*np.diff(way.points_m, axis=0).T).sum()
    if plan.source is Source.SEARCH and length_m < 10.0:  # no plan is longer than the planner's horizon
        assert math.dist(plan.position_m[-1, :2], goal) < 0.12


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_flying_keeps_limits_and_distance(refiner, seed):
    flight, lim = Flight(CONFIG, refiner), CONFIG.air
    start, goal = np.array([1.0, 1.0, 1.0]), np.array([6.5, 5.0 + 0.3 * seed, 1.8])
    field = tall(pillars(seed, start[:2], goal[:2]))
    rng = np.random.default_rng([seed, 4])
    bearing = math.atan2(goal[1] - 1.0, 5.5)
    speed = float(rng.choice([0.0, 0.8]))
    velocity = speed * np.array([math.cos(bearing), math.sin(bearing), 0.0])
    state = AirState(start, velocity, np.zeros(3), bearing + float(rng.uniform(-0.5, 0.5)))
    way = way_on_map(field, start, goal, flight.hard_m + 0.06, 0.5, (0.4, 2.5))
    plan = flight.plan(state, 0.0, way.points_m, field, 0.0, 2.5).trajectory
    assert plan is not None
    flat_v = np.hypot(plan.velocity_mps[:, 0], plan.velocity_mps[:, 1])
    flat_a = np.hypot(plan.acceleration_mps2[:, 0], plan.acceleration_mps2[:, 1])
    assert flat_v.max() <= lim.speed_mps * 1.01
    assert plan.velocity_mps[:, 2].max() <= lim.climb_mps * 1.01
    assert plan.velocity_mps[:, 2].min() >= -lim.descend_mps * 1.01
    assert flat_a.max() <= lim.acceleration_mps2 * 1.01
    assert np.abs(np.diff(plan.acceleration_mps2, axis=0)).max() <= lim.jerk_mps3 * plan.step_s * 1.01
    assert np.abs(plan.yaw_rate_rps).max() <= lim.yaw_rate_rps + 1e-9
    assert not plan.velocity_mps[-1].any()
    assert plan.yaw_rate_rps[-1] == pytest.approx(0.0, abs=1e-9)
    points = np.stack([plan.sample(t).position_m for t in np.arange(0.0, plan.end_s, 0.02)])
    assert field.lookup(points).min() > flight.hard_m - 0.006
    assert points[:, 2].max() < 2.56
    shift = np.diff(plan.position_m, axis=0) / plan.step_s
    assert shift == pytest.approx(0.5 * (plan.velocity_mps[1:] + plan.velocity_mps[:-1]), abs=0.03)


def request(mode=Mode.LAND, goal=(5.0, 0.0, 1.4), in_air=True, yaw=0.0, start_s=1.0, speed=0.0, sequence=1):
    place = np.array([0.0, 0.0, 0.12 if mode is Mode.LAND else 1.4])
    pose = Pose(place, quaternion_from_rpy(0.0, 0.0, yaw))
    velocity = speed * np.array([math.cos(yaw), math.sin(yaw), 0.0])
    motion = Motion(place, velocity, np.zeros(3), yaw, 0.0, speed)
    return PlanRequest(
        sequence, sequence, pose, pose, start_s, motion, mode, np.array(goal), in_air, 0.0, 1.4
    )  # fmt: skip


def seen_map(wall_x_m=None, unseen_x_m=None):
    grid = RollingMap(CONFIG)
    grid.clear_robot(request().body_pose)
    grid.log_odds[:], grid.driving.bands[:], grid.driving.odds[:] = -20, -20, -20
    grid.frames = 1
    for at, value in ((wall_x_m, 60), (unseen_x_m, 0)):
        if at is not None:
            put(grid, at, 0.4, value)
    return grid


def put(grid, x_m, width_m, value):
    """Believe something of a strip across the whole map, on the plan for driving as well."""
    for cells, origin_m, cell_m in (
        (grid.log_odds, grid.origin_m[0], grid.cell_m),
        (grid.driving.bands, grid.driving.origin_m[0], CELL_M),
        (grid.driving.odds, grid.driving.origin_m[0], CELL_M),
    ):
        i = int((x_m - origin_m) / cell_m)
        cells[i : i + round(width_m / cell_m)] = value


@pytest.mark.parametrize(
    ("grid", "yaw", "goal", "in_air", "wanted_m"),
    [
        (seen_map(), 0.0, (5.0, 0.0, 1.4), True, math.inf),  # in view: it drives
        (seen_map(), 1.0, (5.0, 0.0, 1.4), True, 0.0),  # beside the image
        (seen_map(), 0.0, (1.5, 0.0, 1.4), True, 0.0),  # above it
        (seen_map(), 0.0, (11.0, 0.0, 1.4), True, 0.0),  # beyond its range
        (seen_map(wall_x_m=2.0), 0.0, (5.0, 0.0, 1.4), True, 0.0),
        (seen_map(unseen_x_m=3.0), 0.0, (5.0, 0.0, 1.4), True, 0.0),
        (seen_map(wall_x_m=2.0), 0.0, (5.0, 0.0, 0.12), False, math.inf),  # land goals are driven to
    ],
)
def test_it_takes_off_for_air_goals_out_of_sight(grid, yaw, goal, in_air, wanted_m):
    pose = request(yaw=yaw).body_pose
    assert takeoff.lift_off_m(CAMERA, grid, pose, np.array(goal), in_air) == wanted_m
    facts = decision.Facts(Mode.LAND, in_air, math.hypot(*goal[:2]), wanted_m, False, True, True)
    wish = decision.wish(facts, EnergyModel.of(CONFIG))
    assert wish is (Mode.AIR if wanted_m == 0.0 else Mode.LAND)


def test_before_the_first_image_it_does_not_take_off():
    grid = RollingMap(CONFIG)
    assert takeoff.lift_off_m(CAMERA, grid, request().body_pose, np.array([5.0, 0.0, 1.4]), True) == math.inf


def with_map(grid):
    planner = MappingPlanner(CONFIG)
    planner._map = grid
    return planner


@pytest.mark.slow
def test_a_goal_behind_is_turned_to_and_a_blocked_robot_stops_in_time():
    planner = with_map(seen_map())
    result = planner.cycle(request(goal=(-4.0, 0.5, 0.12), in_air=False), None)
    assert result.source is Source.TURN
    assert result.network.mu == 0.0
    planner = with_map(seen_map())
    first = planner.cycle(request(goal=(6.0, 0.0, 0.12), in_air=False, speed=0.8), None)
    assert first.source is Source.SEARCH
    put(planner._map, 0.9, 0.2, 60)  # a wall all across, 0.9 m ahead
    again = request(goal=(6.0, 0.0, 0.12), in_air=False, speed=0.8, start_s=1.0, sequence=2)
    result = planner.cycle(again, None)
    assert result.trajectory.position_m[:, 0].max() < 0.9 - CONFIG.body.radius_m
    assert result.trajectory.speed_mps[-1] == 0.0
    assert result.clearance_m >= CONFIG.clearance.hard_m - 1e-3


@pytest.mark.slow
def test_between_plans_the_kept_one_goes_on_and_ends_at_the_same_place():
    planner = with_map(seen_map())
    first = planner.cycle(request(goal=(6.0, 0.0, 0.12), in_air=False), None)
    now = first.trajectory.sample(1.1)
    moved = Motion(
        now.position_m, now.velocity_mps, now.acceleration_mps2, now.yaw_rad, now.yaw_rate_rps, now.speed_mps
    )
    base = request(goal=(6.0, 0.0, 0.12), in_air=False, start_s=1.1, sequence=2)
    second = planner.cycle(
        PlanRequest(
            2, 2, base.frame_pose, base.body_pose, 1.1, moved, Mode.LAND, base.goal_m, False, 0.0, 1.4
        ),
        None,
    )
    assert second.trajectory.start_s == 1.1
    assert second.trajectory.position_m[0] == pytest.approx(now.position_m, abs=1e-9)
    assert second.trajectory.position_m[-1] == pytest.approx(first.trajectory.position_m[-1], abs=1e-9)
    assert second.trajectory.speed_mps[-1] == 0.0


@pytest.mark.slow
def test_towards_unseen_space_it_can_stop_or_creeps():
    planner = with_map(seen_map(unseen_x_m=3.0))
    result = planner.cycle(request(goal=(6.0, 0.0, 0.12), in_air=False), None)
    plan = result.trajectory
    assert plan.position_m[-1, 0] > 5.0  # optimism: it plans through
    room_m = 3.0 - CONFIG.body.radius_m - plan.position_m[:, 0]
    stops_in_m = plan.speed_mps**2 / (2.0 * CONFIG.land.acceleration_mps2)
    fast = plan.speed_mps > 0.3
    assert (stops_in_m <= room_m)[fast & (room_m > -3.0)].all()
    assert plan.speed_mps.max() > 0.7
