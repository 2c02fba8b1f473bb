"""A pilot that was recorded decides the same again; one that was changed does not, and it is named where."""

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from labr_autonomy.errors import BadInput
from labr_autonomy.mission.pilot_io import Order
from labr_autonomy.mission.recorded import RecordedPilot
from labr_autonomy.mission.steps import Kind, Step
from labr_autonomy.planner.recorder import PlannerLog
from labr_autonomy.record.flight_log import FlightLog
from labr_autonomy.replay.decisions import check_decisions
from labr_autonomy.replay.plans import read_plans
from labr_autonomy.types import DepthFrame, Intrinsics

sys.path.insert(0, str(Path(__file__).parents[1] / "mission"))
import pilot_rig as rig

CAMERA = Intrinsics(8, 6, 4.0, 4.0, 4.0, 3.0)


class RecordedRobot(rig.Robot):
    """The ideal robot of the pilot's own tests, flown by a pilot that is recorded, with the planner's log."""

    def __init__(self, folder, *mission):
        super().__init__()
        self.log = FlightLog(folder / "flight.mcap")
        self.plans_log = PlannerLog(folder / "planner.mcap", rig.CONFIG)
        self.pilot = RecordedPilot(rig.CONFIG, math.inf, lambda body: self.log.pilot(self.now_s, body))
        self.pilot.load(mission, [])
        accept = self.pilot.accept
        self.plans_made = 0

        def recorded(result, now_s):
            self.plans_made += 1
            result = replace(result, sequence=self.plans_made)
            here = self.look().odometry
            request = self.pilot.request(result.sequence, 1, here.pose, here, now_s)
            frame = DepthFrame(result.sequence, now_s, np.full((6, 8), 1.234, np.float32), CAMERA)
            self.plans_log.cycle(request, frame, result)
            accept(result, now_s)

        self.pilot.accept = recorded

    def look(self):
        seen = super().look()  # its velocity goes on changing, which no value of the flight does
        return replace(seen, odometry=replace(seen.odometry, velocity_mps=self.velocity.copy()))

    def close(self):
        self.log.close()
        self.plans_log.close()


@pytest.fixture
def run(tmp_path):
    robot = RecordedRobot(tmp_path, rig.FLOOR_GOAL, rig.AIR_GOAL, Step(Kind.LAND, "land"), rig.HOME)
    robot.pilot.begin(robot.now_s)
    robot.run(3.0)
    robot.order = Order.HOLD
    robot.run(0.5)
    robot.order = Order.FLY
    robot.pilot.insert([Step(Kind.GOTO, "clicked", np.array([1.0, 0.5, 0.0]))], robot.now_s)
    robot.run(6.0)
    robot.pilot.skip(robot.now_s)
    robot.run(25.0)
    robot.close()
    return tmp_path


def test_a_fresh_recording_is_decided_the_same(run):
    ticks, differences = check_decisions(run, 100)
    assert [d.sentence for d in differences] == []
    assert ticks > 1000
    assert len(list(read_plans(run))) > 50


def test_a_moment_of_doubt_about_who_flies_is_decided_the_same(tmp_path):
    robot = RecordedRobot(tmp_path, rig.AIR_GOAL)
    rig.arming(robot, rig.asked_to_arm)
    robot.mode = "hold"
    robot.run(0.1)
    assert robot.look().in_doubt
    robot.mode = "offboard"
    rig.airborne(robot)
    robot.close()
    ticks, differences = check_decisions(tmp_path, 100)
    assert [d.sentence for d in differences] == []
    assert ticks > 100


def test_a_changed_pilot_is_noticed_and_named(run, monkeypatch):
    monkeypatch.setattr("labr_autonomy.mission.following.LOST_M", 0.0)  # it loses its trajectory at once
    _, differences = check_decisions(run, 100)
    assert differences[0].part == "pilot"
    assert differences[0].where.startswith("tick at ")
    assert differences[0].path.startswith(("events", "reference", "speed_mps"))
    assert "was" in differences[0].sentence


def test_a_changed_guard_is_noticed(run, monkeypatch):
    monkeypatch.setattr("labr_autonomy.guard.setpoint.SPEED_SLACK", 0.5)
    assert check_decisions(run, 100)[1]


def test_a_changed_mode_decision_is_noticed(run, monkeypatch):
    monkeypatch.setattr("labr_autonomy.modes.transition.SETTLE_S", 2.0)
    found = check_decisions(run, 1000)[1]
    assert any("phase" in d.path for d in found)


def test_depth_images_come_back_exactly(run):
    cycle = next(read_plans(run))
    assert cycle.begins
    assert (cycle.frame.depth_m == np.float32(1.234)).all()
    assert cycle.frame.intrinsics == CAMERA


def test_a_run_without_recorded_inputs_says_so(tmp_path):
    FlightLog(tmp_path / "flight.mcap").close()
    with pytest.raises(BadInput, match=r"no planner\.mcap"):
        check_decisions(tmp_path, 1)
    PlannerLog(tmp_path / "planner.mcap", rig.CONFIG).close()
    with pytest.raises(BadInput, match="does not hold what the pilot was shown"):
        check_decisions(tmp_path, 1)
