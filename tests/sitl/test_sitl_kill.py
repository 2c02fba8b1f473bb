"""The executive dies without a word: the wheels stop by themselves, and the autopilot lands."""

import os
import signal

import pytest
from sitl_rig import Truth, alive, family, simulator, start_flight, write_mission

pytestmark = [pytest.mark.sitl, pytest.mark.timeout(180)]

STOP_S = 0.35  # faults.md row 3
LOSS_S = 1.0  # COM_OF_LOSS_T
STALL_S = 0.05  # with longer stalls of the machine a limit of 0.35 s cannot be measured


def stop_after_kill(folder):
    """Seconds from SIGKILL to standing still, and the longest stall of the machine meanwhile."""
    mission = write_mission(folder, "goto: {x: 4.0, y: 0.5}")
    with simulator(mission, folder) as (robot, reader):
        truth = Truth(reader)
        process = start_flight(mission, folder, "--robot", str(robot))
        truth.wait(lambda t: t.speed_mps() > 0.5, 90.0, "driving")
        children = family(process.pid)
        killed_s, _ = truth.look()
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        stopped_s = truth.wait(lambda t: t.speed_mps(0.02) < 0.01, 5.0, "standing still")
        truth.wait(lambda t: not any(alive(pid) for pid in children), 5.0, "the end of its children")
        return stopped_s - killed_s, truth.gap_s(killed_s)


def test_killed_while_driving_the_wheels_stop(tmp_path):
    for attempt in range(3):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        took_s, stall_s = stop_after_kill(folder)
        if stall_s < STALL_S:
            assert took_s <= STOP_S
            return
    pytest.skip(f"the machine stalled for {stall_s:.2f} s in each of three measurements")


def test_killed_while_flying_the_autopilot_lands(tmp_path):
    mission = write_mission(tmp_path, "goto: {x: -3.9, y: 0.0, z: 1.5}", "wait: {seconds: 60}")
    with simulator(mission, tmp_path) as (robot, reader):
        truth = Truth(reader)
        process = start_flight(mission, tmp_path, "--robot", str(robot))
        truth.wait(lambda t: t.look() and t.height_m > 1.2, 90.0, "flying")
        truth.wait(lambda t: t.speed_mps(0.5) < 0.05, 20.0, "hovering")
        height_m = truth.height_m
        killed_s, _ = truth.look()
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        sinking_s = truth.wait(lambda t: t.height_m < height_m - 0.1, 10.0, "sinking")
        assert sinking_s - killed_s >= LOSS_S - 0.1  # it is the offboard loss that lands it
        assert sinking_s - killed_s <= LOSS_S + 1.5 + truth.gap_s(killed_s)
        truth.wait(lambda t: t.height_m < 0.02 and t.speed_mps(0.2) < 0.02, 20.0, "standing on the floor")
