"""Ctrl-C holds, a second Ctrl-C comes down and ends with exit code 5; a dead planner is replaced."""

import os
import signal
from pathlib import Path

import pytest
from sitl_rig import Truth, family, simulator, start_flight, write_mission

from labr_autonomy.record.summary import read_summary

pytestmark = [pytest.mark.sitl, pytest.mark.timeout(150)]


def _planner(pid: int) -> int:
    """The planner: the spawned child that is not multiprocessing's resource tracker."""
    for child in family(pid):
        if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
            return child
    raise AssertionError("there is no planner process")


def test_ctrl_c_holds_then_ends_and_a_dead_planner_is_replaced(tmp_path):
    mission = write_mission(tmp_path, "goto: {x: 4.0, y: 0.5}", "return: {}")
    with simulator(mission, tmp_path) as (robot, reader):
        truth = Truth(reader)
        process = start_flight(mission, tmp_path, "--robot", str(robot))
        truth.wait(lambda t: t.speed_mps() > 0.3, 90.0, "driving")

        os.kill(_planner(process.pid), signal.SIGKILL)
        truth.wait(lambda t: t.speed_mps(0.3) < 0.02, 10.0, "coming to rest without a planner")
        truth.wait(lambda t: t.speed_mps() > 0.3, 30.0, "driving on with a new planner")

        process.send_signal(signal.SIGINT)
        truth.wait(lambda t: t.speed_mps(0.3) < 0.01, 5.0, "holding")
        place = truth.look()[1]
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=30) == 5
        assert abs(truth.look()[1] - place).max() < 0.05
    log = (tmp_path / "fly.log").read_text()
    assert "planner process ended" in log
    assert "Traceback" not in log
    run = next(p for p in tmp_path.iterdir() if p.is_dir() and "sim-" not in p.name)
    assert read_summary(run)["outcome"] == "aborted"
