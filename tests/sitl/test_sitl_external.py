"""Missions on an autopilot that runs as a program of its own, with its own physics at a place of its own."""

import contextlib
import json
import socket
import subprocess
import sys

import numpy as np
import pytest
from sitl_rig import start_flight, write_mission

from labr_autonomy.record.summary import read_summary

pytestmark = [pytest.mark.sitl, pytest.mark.timeout(120)]


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


@contextlib.contextmanager
def autopilot(kind, *arguments):
    port = free_port()
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "sim.autopilot.alone",
            *("--kind", kind, "--air", f"udpout://127.0.0.1:{port}", "--yaw-deg", "200", *arguments),
        ]
    )
    try:
        yield f"udpin://127.0.0.1:{port}"
        assert process.poll() is None, "the autopilot ended by itself"
    finally:
        process.terminate()
        process.wait(timeout=10)


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
def test_a_mission_flies_on_it_and_drives_on_our_wheels(kind, tmp_path):
    mission = write_mission(
        tmp_path,
        "goto: {x: -3.0, y: 0.6}",
        "goto: {x: -2.4, y: 1.4, z: 1.1}",
        "land: {}",
        "goto: {x: -3.2, y: 1.8}",
    )
    truth = f"127.0.0.1:{free_port()}"
    told = ("--truth", f"udpout://{truth}") if kind == "px4" else ()
    with autopilot(kind, *told) as url:
        asked = ("--truth", f"udpin://{truth}") if kind == "px4" else ()
        process = start_flight(mission, tmp_path, "--json", "--air", url, *asked)
        process.wait(timeout=110)
    log = (tmp_path / "fly.log").read_text()
    assert process.returncode == 0, log
    run = next(p for p in tmp_path.iterdir() if p.is_dir())
    summary = read_summary(run)
    assert summary["outcome"] == "success"
    assert summary["contacts"] == 0
    assert summary["land_m"] >= 1.5
    assert summary["air_m"] >= 1.0
    assert max(summary["goal_errors_m"]) < 0.5  # by the true pose, which is rover and autopilot in turn
    assert min(summary["energy_land_j"], summary["energy_air_j"], summary["energy_transition_j"]) > 0.0
    with np.load(run / "truth.npz") as track:
        steps = np.linalg.norm(np.diff(track["position_m"], axis=0), axis=1)
        assert steps.max() < 0.15, "the hand-over between rover and autopilot moved the robot"
        assert track["mode"].max() == 1
    assert json.loads((run / "referee.json").read_text())["touchdown_mps"] < 0.6
