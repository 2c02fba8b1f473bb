"""Ctrl-C holds, a second Ctrl-C comes down and ends with exit code 5; a dead planner is replaced."""

import contextlib
import os
import signal
import time
from pathlib import Path

import pytest
from sitl_rig import Truth, family, simulator, start_flight, write_mission

from labr_autonomy.record.summary import read_summary
from sim.pose_slot import PoseSlotReader

pytestmark = [pytest.mark.sitl, pytest.mark.timeout(150)]


def _child(pid: int, word: bytes) -> int:
    """The child whose command line holds a word; the planner is the one that multiprocessing spawned."""
    deadline = time.monotonic() + 20.0
    while time.monotonic() < deadline:
        for child in family(pid):
            with contextlib.suppress(OSError):
                if word in Path(f"/proc/{child}/cmdline").read_bytes():
                    return child
        time.sleep(0.05)
    raise AssertionError(f"there is no child process with {word!r}")


def test_ctrl_c_holds_then_ends_and_a_dead_planner_is_replaced(tmp_path):
    mission = write_mission(tmp_path, "goto: {x: 4.0, y: 0.5}", "return: {}")
    with simulator(mission, tmp_path) as (robot, reader):
        truth = Truth(reader)
        process = start_flight(mission, tmp_path, "--robot", str(robot))
        truth.wait(lambda t: t.speed_mps() > 0.3, 90.0, "driving")

        planner = _child(process.pid, b"spawn_main")
        os.kill(planner, signal.SIGSTOP)  # a new planner is there too soon for a dead one to bring it to rest
        truth.wait(lambda t: t.speed_mps(0.3) < 0.02, 10.0, "coming to rest without a planner")
        os.kill(planner, signal.SIGKILL)
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


def test_ctrl_c_in_the_terminal_reaches_the_robot_and_not_its_simulator(tmp_path):
    """A terminal signals the whole group: executive, simulator, camera and planner."""
    mission = write_mission(tmp_path, "goto: {x: 4.0, y: 0.5}", "return: {}")
    process = start_flight(mission, tmp_path, start_new_session=True)
    truth = Truth(PoseSlotReader(f"labr_{_child(process.pid, b'sim.server')}_pose", timeout_s=60.0))
    truth.wait(lambda t: t.speed_mps() > 0.3, 90.0, "driving")
    os.killpg(process.pid, signal.SIGINT)
    truth.wait(lambda t: t.speed_mps(0.3) < 0.01, 5.0, "holding")
    first_s, _ = truth.look()
    truth.wait(lambda t: t.look()[0] > first_s + 1.0, 3.0, "the simulator going on")
    os.killpg(process.pid, signal.SIGINT)
    assert process.wait(timeout=30) == 5
    run = next(p for p in tmp_path.iterdir() if p.is_dir())
    assert read_summary(run)["outcome"] == "aborted"
    assert (run / "truth.npz").exists()
