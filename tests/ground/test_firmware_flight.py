"""Flights with the firmware in the twin's place: in lock-step exactly, in real time whole."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import pytest
from firmware_needs import need
from firmware_seam import FirmwareSeam

from labr_autonomy.config import RobotConfig
from sim.lockstep import flight as lockstep_flight
from sim.lockstep.run import fly_trial
from sim.lockstep.trial import Task, Trial
from sim.worlds.build import build_world

MISSION = Path(__file__).resolve().parents[2] / "missions" / "first_flight.yaml"
START = (-5.5, -3.0, 0.0, 0.0)


def corner(seed: int) -> Trial:
    """The first goal of missions/first_flight.yaml as a trial."""
    below_m = RobotConfig().body.below_m
    goal = (3.4, -2.0, below_m)
    places = [(START[0], START[1], below_m), goal]
    world = build_world({"family": "hall", "size_m": [14, 10]}, seed=seed, clear_m=places)
    away_m = math.dist(places[0], goal)
    return Trial(Task(world.spec, seed, START, goal, False, False, away_m, away_m, 700.0, 60.0), "two-stage")


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_on_a_simulated_clock_the_core_drives_as_far_and_as_dearly_as_the_twin(monkeypatch, library):
    twin = fly_trial(corner(1))
    monkeypatch.setattr(lockstep_flight, "LandSeam", FirmwareSeam)
    core = fly_trial(corner(1))
    assert twin.outcome == core.outcome == "reached"
    assert core.land_m == pytest.approx(twin.land_m, rel=0.02)
    assert core.energy_land_j == pytest.approx(twin.energy_land_j, rel=0.02)


@pytest.mark.sitl
@pytest.mark.slow
@pytest.mark.timeout(300)
def test_the_first_mission_is_flown_with_the_firmware_in_the_emulator(tmp_path):
    need("arm-none-eabi-gcc", "qemu-system-arm")
    command = [sys.executable, "-m", "labr_autonomy", "fly", str(MISSION), "--ground", "qemu"]
    done = subprocess.run(
        [*command, "--quiet", "--json", "--out", str(tmp_path)], capture_output=True, text=True, check=False
    )
    summary = json.loads(done.stdout)
    assert (done.returncode, summary["outcome"], summary["contacts"]) == (0, "success", 0)
    assert len(summary["goal_errors_m"]) == 3
    (run,) = tmp_path.iterdir()
    assert json.loads((run / "simulator.json").read_text())["ground"] == "qemu"
