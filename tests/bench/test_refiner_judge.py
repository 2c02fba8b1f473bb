"""The judge sees what it is there for, and the refiner gives it nothing to see."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from labr_autonomy import cli
from labr_autonomy.config import RobotConfig
from labr_autonomy.refine.planner import Refiner
from labr_autonomy.refine.values import AirState, LandState
from labr_autonomy.types import Mode
from sim.bench.refiner import problems
from sim.bench.refiner.judge import faults
from sim.bench.refiner.scenes import HEIGHT_M, SIDE_M, draw

CONFIG = RobotConfig()
REFINER = Refiner(CONFIG)
HARD_M = {Mode.LAND: REFINER.land_hard_m, Mode.AIR: REFINER.air_hard_m}


def drawn(mode):
    """A scene, and a good trajectory of more than half a metre in it."""
    d = 2 if mode is Mode.LAND else 3
    for seed in range(100):
        rng = np.random.default_rng(seed)
        scene = draw(rng, d)
        begin = problems._free_place(rng, scene, HARD_M[mode])
        if begin is None:
            continue
        for goal in rng.uniform(0.5, [SIDE_M - 0.5, SIDE_M - 0.5, HEIGHT_M - 0.6][:d], (20, d)):
            line = begin + (goal - begin) * np.linspace(0.2, 1.0, 5)[:, None]
            yaw = float(np.arctan2(*(goal - begin)[1::-1]))
            if d == 2:
                out = REFINER.land(LandState(begin, yaw, 0.0, 0.0), line, scene.field, 0.0, None)
            else:
                out = REFINER.air(
                    AirState(begin, np.zeros(3), np.zeros(3), yaw), line, scene.field, 0.0, None
                )
            if np.linalg.norm(out.trajectory.position_m[-1] - out.trajectory.position_m[0]) > 0.5:
                return scene, out.trajectory
    raise AssertionError("no scene with room to move")


@pytest.mark.parametrize("mode", [Mode.LAND, Mode.AIR])
def test_each_fault_is_seen(mode):
    scene, good = drawn(mode)
    assert faults(good, scene, CONFIG, HARD_M[mode]) == []
    step = np.linspace(0.0, 1.0, len(good.yaw_rad))[:, None] * np.array([12.0, 0.0, 0.0])
    through = replace(good, position_m=good.position_m + step)
    assert {"touches", "too near"} <= set(faults(through, scene, CONFIG, HARD_M[mode]))
    fast = replace(good, speed_mps=good.speed_mps * 9.0, velocity_mps=good.velocity_mps * 9.0)
    assert "over a limit" in faults(fast, scene, CONFIG, HARD_M[mode])
    cut = {
        name: getattr(good, name)[:8]
        for name in (
            "position_m",
            "velocity_mps",
            "acceleration_mps2",
            "yaw_rad",
            "yaw_rate_rps",
            "speed_mps",
        )
    }
    assert "does not rest" in faults(replace(good, **cut), scene, CONFIG, HARD_M[mode])


@pytest.mark.slow
def test_random_problems_have_no_fault():
    done = CliRunner().invoke(
        cli.main, ["bench", "refiner", "--problems", "60", "--seed", "900", "--jobs", "1", "--json"]
    )
    assert done.exit_code == 0, done.output
    rows = json.loads(done.stdout)["rows"]
    assert [row["mode"] for row in rows] == ["land", "air"]
    assert all(row["problems"] == 60 and row["faults"] == {} for row in rows)
    assert {"gkpn", "turn"} <= rows[0]["sources"].keys()


def test_a_fault_is_reported_by_seed_and_exit_code(monkeypatch):
    monkeypatch.setattr(problems, "faults", lambda *_: ["touches"])
    done = CliRunner().invoke(cli.main, ["bench", "refiner", "--problems", "10", "--jobs", "1"])
    assert done.exit_code == 4
    assert "10 touches" in done.output
    assert "seed 0, number 0: touches" in done.output
