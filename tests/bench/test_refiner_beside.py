"""Times of the refiner beside a flight: read from the flight's own record."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from labr_autonomy import cli
from labr_autonomy.config import RobotConfig
from labr_autonomy.record.flight_log import FlightLog
from labr_autonomy.refine.planner import Refiner
from labr_autonomy.refine.values import AirState, LandState
from labr_autonomy.types import KeyPoints, Source

KEYS = KeyPoints(np.ones((1, 3)), np.zeros(1, bool), 0.1, Source.SEARCH)


@pytest.fixture(scope="module")
def brakes():
    refiner = Refiner(RobotConfig())
    land = refiner.brake_land(LandState(np.zeros(2), 0.0, 0.0, 0.0), 0.0)
    return land, refiner.brake_air(AirState(np.zeros(3), np.zeros(3), np.zeros(3), 0.0), 0.0)


def write_run(folder, brakes, times_ms):
    land, air = brakes
    folder.mkdir()
    with FlightLog(folder / "flight.mcap") as log:
        for k, (mode, took, followed) in enumerate(times_ms):
            plan = replace(land if mode == "land" else air, start_s=0.1 * k)
            log.plan(
                0.1 * k,
                frame_stamp_s=0.1 * k,
                network=None,
                followed=KEYS if followed else None,
                trajectory=plan,
                source=Source.SEARCH,
                timings_s={"refine": took / 1e3, "total": 1.0},
            )
    return folder


def bench(*arguments):
    return CliRunner().invoke(cli.main, ["bench", "refiner", *map(str, arguments)])


def test_the_refiners_times_are_told_by_mode(tmp_path, brakes):
    times = [("land", k / 10.0, True) for k in range(1, 101)] + [("air", 4.0, True)] * 3
    times += [("land", 0.0, False)] * 50  # cycles in which nothing was refined
    run = write_run(tmp_path / "run", brakes, times)
    done = bench("--beside-flight", run, "--json")
    assert done.exit_code == 0, done.output
    land, air = json.loads(done.stdout)["rows"]
    assert (land["mode"], land["plans"]) == ("land", 100)
    assert land["time_ms"] == {"p50": 5.05, "p99": 9.9, "max": 10.0}
    assert air == {"mode": "air", "plans": 3, "time_ms": {"p50": 4.0, "p99": 4.0, "max": 4.0}}
    assert "land  100 plans: p50 5.0 ms, p99 9.9 ms, max 10.0 ms" in bench("--beside-flight", run).output


def test_a_run_without_plans_and_random_problems_beside_a_flight_are_refused(tmp_path, brakes):
    empty = tmp_path / "empty"
    empty.mkdir()
    done = bench("--beside-flight", empty)
    assert done.exit_code == 2
    assert "has no flight.mcap" in done.output
    done = bench("--beside-flight", write_run(tmp_path / "still", brakes, [("land", 0.0, False)]))
    assert done.exit_code == 2
    assert "holds no plan" in done.output
    done = bench("--beside-flight", empty, "--problems", 10)
    assert done.exit_code == 2
    assert "--problems is of random problems" in done.output


def test_a_flight_that_cannot_begin_is_told(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    mission = tmp_path / "mission.yaml"
    mission.write_text("version: 1\nname: nowhere\nitems: [{goto: moon}]\n")
    done = bench("--beside-flight", mission, "--json")
    assert done.exit_code == 2
    assert "ended with 2 and left no record" in done.output
    assert "no place is called 'moon'" in capfd.readouterr().err
