"""The comparison of lock-step and full simulator: what is compared, and what counts as the same."""

import json
import math

import numpy as np
import pytest
from bench_fakes import make_task

from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput
from labr_autonomy.mission.check import clear_places, goal_places
from labr_autonomy.mission.compile import compile_steps
from labr_autonomy.mission.load import parse_mission
from sim.bench import crosscheck
from sim.bench.crosscheck import Pair, agreement, mission_of
from sim.bench.tasks import sample_task
from sim.lockstep.trial import Task

ROBOT = RobotConfig()


def pair(fast, full, outcome=("reached", "reached")):
    return Pair("indoor", 0, False, outcome, *zip(fast, full, strict=True))


def test_trials_within_a_tenth_agree_and_others_do_not():
    near = agreement([pair((10.0, 20.0, 1000.0), (10.5, 21.0, 1050.0))])
    assert near["agrees"]
    assert near["path_m"]["median_difference"] == pytest.approx(0.5 / 10.5)
    far = agreement([pair((10.0, 20.0, 1000.0), (10.5, 21.0, 1150.0))])
    assert not far["agrees"]


def test_one_other_way_does_not_hide_that_the_rest_agree():
    same = [pair((10.0, 20.0, 1000.0), (10.1, 20.0, 1000.0))] * 3
    found = agreement([*same, pair((30.0, 40.0, 4000.0), (60.0, 90.0, 8000.0))])
    assert found["agrees"]
    assert found["path_m"]["worst_difference"] == pytest.approx(0.5)
    assert found["path_m"]["difference_of_means"] > 0.3


def test_only_trials_reached_both_ways_are_compared_and_none_is_no_agreement():
    kept = pair((10.0, 20.0, 1000.0), (10.0, 20.0, 1000.0))
    lost = pair((10.0, 20.0, 1000.0), (90.0, 90.0, 9000.0), ("reached", "not reached within 60 s"))
    found = agreement([kept, lost])
    assert found["trials_reached_both_ways"] == 1
    assert found["agrees"]
    nothing = agreement([lost])
    assert not nothing["agrees"]
    assert math.isnan(nothing["path_m"]["median_difference"])


def test_the_mission_asks_the_same_of_the_same_world():
    task = sample_task({"family": "indoor", "size_m": [16.0, 12.0], "difficulty": 0.3}, 5, ROBOT)
    mission = parse_mission(json.dumps(mission_of(task, "trial 5")).encode())
    assert clear_places(mission, ROBOT) == []  # the world stays as its seed draws it
    assert mission.sim.seed == task.seed
    drawn = {"family": "indoor", "size_m": [16.0, 12.0], "difficulty": 0.3}
    assert mission.sim.world.spec() == drawn
    start = goal_places(mission, ROBOT)[0]
    assert start == pytest.approx((task.start[0], task.start[1], task.start[3] + ROBOT.body.below_m))
    (step,) = compile_steps(mission, (0.0, 0.0), task.start[3])
    assert step.in_air is task.in_air
    assert np.allclose(step.goal_m[: 3 if task.in_air else 2], task.goal_m[: 3 if task.in_air else 2])


def test_a_mesh_world_is_refused():
    task = make_task(3)
    mesh = Task(**{**{n: getattr(task, n) for n in task.__slots__}, "world": {"mesh": "house.npz"}})
    with pytest.raises(BadInput, match="is a mesh"):
        mission_of(mesh, "x")


def test_what_lock_step_does_not_reach_is_passed_over(monkeypatch, tmp_path):
    class Result:
        outcome, land_m, air_m, time_s, energy_j = "timeout", 1.0, 0.0, 9.0, 100.0

    flown = []
    monkeypatch.setattr(crosscheck, "fly_trial", lambda *_: Result)
    monkeypatch.setattr(
        crosscheck, "fly_full", lambda task, _: flown.append(task) or ("reached", 1.0, 9.0, 100.0)
    )
    assert list(crosscheck.cross_check([make_task(1)], ROBOT, tmp_path)) == []
    assert flown == []
    Result.outcome = "reached"
    assert len(list(crosscheck.cross_check([make_task(1)], ROBOT, tmp_path))) == 1
    assert len(flown) == 1
