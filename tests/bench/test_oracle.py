"""The oracle drives and flies its route on true fields, and tells the pilot where to switch."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from analytic_worlds import ROBOT, low_wall, rooms_of, standing_at, two_rooms

from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.planner.messages import Motion, PlanRequest
from labr_autonomy.types import Mode, Pose
from sim.bench.known import know
from sim.bench.oracle import OraclePlanner
from sim.lockstep.trial import Task

PERIOD_S = 0.1


def task_in(folder, blocks, start, goal, *, in_air=False):
    world = rooms_of(blocks)
    np.savez(folder / "place.npz", V=world.vertices_m, F=world.faces)
    spec = {"mesh": "place.npz", "scale": 1.0, "worlds_dir": str(folder)}
    return Task(spec, 0, (*start, 0.0), tuple(goal), in_air, False, 0.0, 0.0, 0.0, 0.0)


class Ride:
    """A robot that is exactly where its trajectory says."""

    def __init__(self, task, mode=Mode.LAND, z=None):
        x, y, yaw, floor = task.start
        self.task, self.mode = task, mode
        self.oracle = OraclePlanner(ROBOT, task)
        place = standing_at(x, y, floor) if z is None else np.array([x, y, z])
        self.motion = Motion(place, np.zeros(3), np.zeros(3), yaw, 0.0, 0.0)
        self.now_s, self.fresh, self.track = 0.0, True, [place]

    def request(self):
        goal = np.array(self.task.goal_m)
        pose = Pose(self.motion.position_m, quaternion_from_rpy(0.0, 0.0, self.motion.yaw_rad))
        lift_m = max(0.12 + 0.8, goal[2]) if self.task.in_air else 1.32
        return PlanRequest(
            0,
            0,
            pose,
            pose,
            self.now_s,
            self.motion,
            self.mode,
            goal,
            self.task.in_air,
            0.0,
            lift_m,
            self.fresh,
        )

    def step(self):
        result = self.oracle.cycle(self.request(), None)
        self.now_s += PERIOD_S
        at = result.trajectory.sample(self.now_s)
        self.motion = Motion(
            at.position_m, at.velocity_mps, at.acceleration_mps2, at.yaw_rad, at.yaw_rate_rps, at.speed_mps
        )
        self.track.append(at.position_m)
        self.fresh = False
        return result

    def until(self, done, most_s=40.0):
        while self.now_s < most_s:
            result = self.step()
            if done(result):
                return result
        pytest.fail(f"not done after {most_s:.0f} s at {self.motion.position_m}: {result.reason}")

    def near(self, place, within):
        return float(np.linalg.norm(self.motion.position_m[:2] - np.asarray(place)[:2])) < within


def test_it_drives_through_the_door_to_a_land_goal_without_contact(tmp_path):
    goal = standing_at(4.0, -1.5)
    task = task_in(tmp_path, two_rooms(), (-4.0, -1.5, 0.0), goal)
    ride = Ride(task)
    last = ride.until(lambda _: ride.near(goal, 0.1))
    known = know(task.world, ROBOT)
    assert min(known.surface.clearance(p, on_floor=True) for p in ride.track) > 0.02
    length = np.linalg.norm(np.diff(ride.track, axis=0), axis=1).sum()
    route = known.router.route(standing_at(-4.0, -1.5), goal)
    assert length < 1.08 * route.land_m
    assert math.isinf(last.lift_off_m)
    assert not last.take_off_clear
    assert not last.land_path_ends


def test_it_asks_for_the_take_off_under_an_air_goal_and_flies_the_rest(tmp_path):
    goal = np.array([4.0, 1.0, 1.5])
    task = task_in(tmp_path, two_rooms(), (-4.0, 1.0, 0.0), goal, in_air=True)
    ride = Ride(task)
    first = ride.step()
    assert not first.take_off_clear
    assert first.lift_off_m == pytest.approx(8.1, abs=0.5)
    last = ride.until(lambda result: result.take_off_clear)
    assert last.lift_off_m <= 0.4
    assert ride.near(goal, 0.6)
    up = np.array([*ride.motion.position_m[:2], 1.5])
    ride.motion = Motion(up, np.zeros(3), np.zeros(3), ride.motion.yaw_rad, 0.0, 0.0)
    ride.mode, ride.fresh, began = Mode.AIR, True, len(ride.track)
    ride.until(lambda _: float(np.linalg.norm(ride.motion.position_m - goal)) < 0.1)
    surface = know(task.world, ROBOT).surface
    assert min(surface.clearance(p) for p in ride.track[began + 1 :]) > 0.1


def test_over_a_wall_it_flies_and_grants_the_landing_only_beyond(tmp_path):
    goal = standing_at(3.0, 0.0)
    task = task_in(tmp_path, low_wall(), (-2.0, 0.0, 0.0), goal)
    ride = Ride(task, Mode.AIR, z=1.32)
    last = ride.until(lambda result: result.landing_clear)
    assert last.source.value == "search"
    assert ride.motion.position_m[0] > 0.1 + 0.45
    assert ride.motion.position_m[2] > 1.0
    surface = know(task.world, ROBOT).surface
    assert min(surface.clearance(p) for p in ride.track) > 0.0
    ride.mode, ride.fresh = Mode.LAND, True
    ride.motion = replace(
        ride.motion,
        position_m=standing_at(*ride.motion.position_m[:2]),
        velocity_mps=np.zeros(3),
        acceleration_mps2=np.zeros(3),
        yaw_rate_rps=0.0,
        speed_mps=0.0,
    )
    ride.until(lambda _: ride.near(goal, 0.1))


def test_before_a_wall_it_asks_for_a_hop_to_a_land_goal(tmp_path):
    task = task_in(tmp_path, low_wall(), (-3.0, 0.0, 0.0), standing_at(3.0, 0.0))
    ride = Ride(task)
    last = ride.until(lambda result: result.land_path_ends)
    assert last.take_off_clear
    assert -0.95 < ride.motion.position_m[0] < -0.5


def test_without_a_way_it_comes_to_rest_and_says_why(tmp_path):
    task = task_in(tmp_path, two_rooms(), (-4.0, 0.0, 0.0), standing_at(0.0, -2.0))
    result = Ride(task).step()
    assert result.reason == "there is no way to the goal"
    assert np.abs(result.trajectory.speed_mps).max() == 0.0
