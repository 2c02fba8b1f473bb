"""Movers in lock-step flights, in the real-time simulator, in missions and in the benchmark's tables."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from movers_rig import BODY, BOX, CONFIG, mover

from labr_autonomy.cli import main
from labr_autonomy.config import RobotConfig
from labr_autonomy.mission.load import FileProblems, parse_mission
from labr_autonomy.mission.simulator import simulator_spec
from labr_autonomy.planner.messages import PlanResult, Timings
from labr_autonomy.types import KeyPoints, Mode, Source, Trajectory
from sim.bench.records import result_from_dict, task_from_dict, task_to_dict
from sim.lockstep.run import Stage, fly_with
from sim.lockstep.trial import Task
from sim.server import Simulator
from sim.spec import SimSpec
from sim.worlds.build import build_world

START = (-3.0, 0.0, 0.0, 0.0)


class Straight:
    """Drives straight ahead at some speed, whatever is there."""

    def __init__(self, speed=0.5):
        self.speed = speed

    def cycle(self, request, frame):
        n = 100
        t = np.arange(n) * 0.1
        way = np.column_stack([self.speed * t, np.zeros(n), np.zeros(n)])
        velocity = np.tile([self.speed, 0.0, 0.0], (n, 1))
        plan = Trajectory(
            Mode.LAND, request.start_s, 0.1, request.motion.position_m + way, velocity,
            np.zeros((n, 3)), np.zeros(n), np.zeros(n), np.full(n, self.speed),
        )  # fmt: skip
        points = KeyPoints(plan.position_m[-1:], np.array([False]), 0.0, Source.DIRECT)
        return PlanResult(
            request.sequence, request.start_s, plan, points, points, Source.DIRECT, 1.0, "", math.inf, False,
            True, True, Timings(),
        )  # fmt: skip


class Still(Straight):
    def cycle(self, request, frame):
        return replace(super().cycle(request, frame), trajectory=None)


@pytest.fixture(autouse=True)
def _empty_stage():
    yield
    if Stage._last is not None:
        Stage._last.close()
        Stage._last = None


def task(*movers, bound_s=0.0):
    goal = (3.0, 0.0, BODY.below_m)
    places = [(START[0], START[1], BODY.below_m), (0.0, 0.0, BODY.below_m), goal]
    world = build_world({"family": "hall", "size_m": [9, 6]}, seed=4, clear_m=places)
    told = tuple(m.as_dict() for m in movers)
    return Task(world.spec, 4, START, goal, False, False, 6.0, 6.0, 700.0, bound_s, told)


ACROSS = mover(first=(-1.0, 0.2), last=(-1.0, -1.5), speed=0.6, pause=60.0, along=1.6)


def test_a_robot_that_drives_into_a_person_has_touched_a_person():
    standing_there = mover(first=(-1.0, 0.0), last=(-1.0, 0.4), speed=0.01, pause=60.0, along=0.0)
    result = fly_with(task(standing_there), Straight(), CONFIG, sees=False)
    assert result.outcome == "contact"
    assert "touched a person" in result.reason
    assert result.struck == 0


def test_a_box_that_runs_into_a_waiting_robot_does_not_end_the_flight():
    rammed = mover(BOX, first=(-3.0, 2.0), last=(-3.0, -2.0), speed=1.0, pause=60.0)
    result = fly_with(task(rammed, bound_s=-8.0), Still(), CONFIG, sees=False)
    assert result.outcome == "timeout"
    assert result.struck >= 1
    assert result.movers == 1
    assert result.min_clearance_m <= 0.0


def test_whoever_flies_without_movers_does_not_meet_them():
    rammed = mover(BOX, first=(-3.0, 2.0), last=(-3.0, -2.0), speed=1.0, pause=60.0)
    result = fly_with(task(rammed, bound_s=-8.0), Still(), CONFIG, sees=False, meets_movers=False)
    assert (result.struck, result.movers, result.outcome) == (0, 0, "timeout")
    assert result.min_clearance_m > 0.3


def test_the_same_seed_gives_the_same_flight_with_movers():
    results = [fly_with(task(ACROSS, bound_s=-7.0), Straight(0.3), CONFIG, sees=True) for _ in range(2)]
    a, b = ({**r.as_dict(), "plan_cycle_ms": 0, "real_time_factor": 0} for r in results)
    assert a == b


def test_a_task_keeps_its_movers_and_an_older_one_has_none():
    asked = task(ACROSS)
    kept = json.loads(json.dumps(task_to_dict(asked)))
    again = task_from_dict(kept)
    assert json.dumps(task_to_dict(again)) == json.dumps(task_to_dict(asked))
    del kept["movers"]
    assert task_from_dict(kept).movers == ()
    result = fly_with(task(bound_s=-9.5), Still(), CONFIG, sees=False).as_dict()
    del result["struck"], result["unseen"], result["movers"]  # a journal from before there were movers
    assert result_from_dict(result).struck == 0


MISSION = """\
version: 1
name: crossing
items:
  - goto: {x: 4.5, y: 3.0}
sim: {world: {family: hall, size_m: [12, 9], movers: 3}, seed: 5, start: {x: -4.5, y: -3.0}}
"""


def test_a_mission_asks_for_movers_and_its_simulator_makes_them(tmp_path):
    mission = parse_mission(MISSION.encode())
    spec_path = tmp_path / "simulator.json"
    spec_path.write_text(json.dumps(simulator_spec(mission, RobotConfig(), 5, None)))
    simulator = Simulator(SimSpec.load(spec_path), tmp_path)
    try:
        movers = simulator._crowd.movers
        assert len(movers) == 3
        assert simulator._camera_spec.movers == tuple(m.as_dict() for m in movers)
        before = list(simulator._crowd.along_m)
        for step in range(250):
            simulator._step(100.0 + 0.004 * step)
        assert simulator._crowd.along_m != before
    finally:
        simulator.close()
    account = json.loads((tmp_path / "referee.json").read_text())
    assert (account["movers"], account["struck_while_standing"]) == (3, 0)


def test_a_world_without_movers_has_no_crowd(tmp_path):
    mission = parse_mission(MISSION.replace(", movers: 3", "").encode())
    spec_path = tmp_path / "simulator.json"
    spec_path.write_text(json.dumps(simulator_spec(mission, RobotConfig(), 5, None)))
    simulator = Simulator(SimSpec.load(spec_path), tmp_path)
    try:
        assert simulator._crowd is None
    finally:
        simulator.close()


def test_a_number_of_movers_that_makes_no_sense_is_refused_with_its_place():
    with pytest.raises(FileProblems) as caught:
        parse_mission(MISSION.replace("movers: 3", "movers: -1").encode(), "m.yaml")
    assert [p.line for p in caught.value.problems] == [5]


def test_the_benchmark_states_its_movers_in_settings_rows_and_page(tmp_path):
    out = tmp_path / "run"
    words = "bench navigation --family indoor --trials 1 --method oracle --movers 2 --seed 3 --jobs 1 --json"
    done = CliRunner().invoke(main, [*words.split(), "--no-pictures", "--out", str(out)])
    assert done.exit_code == 0, done.output
    results = json.loads(done.output)
    assert "--movers 2" in results["command"]
    assert results["settings"]["places"][0]["spec"]["movers"] == 2
    assert results["rows"][0]["movers"] == 0.0  # the oracle's
    kept = json.loads(next((out / "tasks").glob("*.json")).read_text())
    assert len(kept["movers"]) == 2
    other = CliRunner().invoke(main, [*words.replace("--movers 2 ", "").split(), "--out", str(out)])
    assert other.exit_code == 2
    assert "other settings" in other.output


def test_a_row_counts_movers_and_strikes():
    from sim.bench.page import _movers
    from sim.bench.rows import Flight, _figures

    result = fly_with(task(bound_s=-9.5), Still(), CONFIG, sees=False)
    row = _figures([Flight(task(ACROSS), replace(result, struck=2, movers=1), None)], 0)
    assert (row["movers"], row["struck"]) == (1.0, 2)
    page = "\n".join(_movers([{**row, "family": "indoor", "method": "two-stage"}]))
    assert "| indoor, two-stage | 1.0 | 0 | 0 | 2 |" in page
    assert _movers([{**row, "movers": 0.0}]) == []
