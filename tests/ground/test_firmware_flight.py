"""Flights with the firmware in the twin's place: in lock-step exactly, in real time whole."""

from __future__ import annotations

import json
import math
import subprocess
import sys

import pytest
from firmware_needs import need
from firmware_seam import FirmwareSeam

from labr_autonomy.config import RobotConfig
from sim.lockstep import flight as lockstep_flight
from sim.lockstep.run import fly_trial
from sim.lockstep.trial import Task, Trial
from sim.worlds.build import build_world

START = (-5.5, -3.0, 0.0, 0.0)
MISSION = """\
version: 1
name: short drive
items:
  - goto: {x: -3.0, y: -2.6}
sim: {world: {family: hall, size_m: [14, 10]}, seed: 1, start: {x: -5.5, y: -3.0}}
"""


def trial(seed: int) -> Trial:
    """A goal on the floor of the hall, a few metres on."""
    below_m = RobotConfig().body.below_m
    goal = (-1.5, -2.0, below_m)
    places = [(START[0], START[1], below_m), goal]
    world = build_world({"family": "hall", "size_m": [14, 10]}, seed=seed, clear_m=places)
    away_m = math.dist(places[0], goal)
    return Trial(Task(world.spec, seed, START, goal, False, False, away_m, away_m, 700.0, 60.0), "two-stage")


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_on_a_simulated_clock_the_core_drives_as_far_and_as_dearly_as_the_twin(monkeypatch, library):
    twin = fly_trial(trial(1))
    monkeypatch.setattr(lockstep_flight, "LandSeam", FirmwareSeam)
    core = fly_trial(trial(1))
    assert twin.outcome == core.outcome == "reached"
    assert core.land_m == pytest.approx(twin.land_m, rel=0.02)
    assert core.energy_land_j == pytest.approx(twin.energy_land_j, rel=0.02)


@pytest.mark.sitl
@pytest.mark.slow
@pytest.mark.timeout(200)
def test_a_mission_is_flown_over_the_real_links_with_the_firmware_in_the_emulator(tmp_path):
    """The first mission takes over a minute; its figures are in firmware_bridge/README.md."""
    need("arm-none-eabi-gcc", "qemu-system-arm")
    mission = tmp_path / "mission.yaml"
    mission.write_text(MISSION)
    command = [sys.executable, "-m", "labr_autonomy", "fly", str(mission), "--ground", "qemu"]
    done = subprocess.run(
        [*command, "--quiet", "--json", "--out", str(tmp_path / "runs")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert (summary["outcome"], summary["contacts"]) == ("success", 0)
    assert summary["land_m"] == pytest.approx(2.5, abs=0.6)
    (run,) = (tmp_path / "runs").iterdir()
    assert json.loads((run / "simulator.json").read_text())["ground"] == "qemu"
