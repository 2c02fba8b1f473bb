"""From records and truth to figures, and from a mission file to steps and fences."""

import json
from dataclasses import replace

import numpy as np
import pytest

from labr_autonomy.config import RobotConfig
from labr_autonomy.guard.fence import margin_m
from labr_autonomy.mission import summarise
from labr_autonomy.mission.compile import compile_fences, compile_steps
from labr_autonomy.mission.load import parse_mission
from labr_autonomy.mission.logbook import LegRecord, Logbook
from labr_autonomy.mission.meter import Meter
from labr_autonomy.mission.steps import Kind, OnFail, Policy, Step
from labr_autonomy.modes.transition import Phase

MISSION = """\
version: 1
name: t
places: {up: {x: 2, y: 1, z: 1.5}}
items:
  - goto: {x: 1, y: 0}
    mode: ground
    timeout_s: 30
    on_fail: skip
  - goto: up
    accept: {radius_m: 0.2}
  - wait: {seconds: 3}
  - land: {}
  - return: {}
fence:
  - polygon: [[-3, -3], [3, -3], [3, 3], [-3, 3]]
    keep: in
    z: [-5, 2]
  - circle: {x: 0, y: 2, radius_m: 0.5}
    keep: out
expect: {outcome: success, contacts: 0, min_land_m: 3, min_air_m: 1, max_goal_error_m: 0.5}
"""


@pytest.fixture
def mission():
    return parse_mission(MISSION.encode())


def test_items_become_steps_in_figures(mission):
    steps = compile_steps(mission, (0.5, -0.5), floor_z_m=0.1)
    assert [s.kind for s in steps] == [Kind.GOTO, Kind.GOTO, Kind.WAIT, Kind.LAND, Kind.GOTO]
    first, up, wait, _, home = steps
    assert (first.policy, first.timeout_s, first.on_fail) == (Policy.GROUND, 30.0, OnFail.SKIP)
    assert not first.in_air
    assert up.in_air
    assert up.goal_m == pytest.approx([2.0, 1.0, 1.6])
    assert up.accept_m == 0.2
    assert wait.wait_s == 3.0
    assert home.goal_m[:2] == pytest.approx([0.5, -0.5])


def test_the_whole_outline_stays_inside_the_fence(mission):
    robot = RobotConfig()
    zones = compile_fences(mission, robot)
    assert margin_m(zones, 0.0, 0.0, 0.12) == pytest.approx(2.0 - 0.5 - robot.body.radius_m)
    assert margin_m(zones, 2.8, 0.0, 0.12) < 0.0  # its outline sticks out
    assert margin_m(zones, 0.0, 2.0, 0.12) < 0.0
    assert margin_m(zones, 0.0, -1.0, 1.9) < 0.0  # its propellers are above the lid


def book():
    goto, wait = Step(Kind.GOTO, "a", np.array([1.0, 0, 0])), Step(Kind.WAIT, "w")
    legs = [
        LegRecord(0, goto, 10.0, 12.0, "done", 4.0, 0.0, 300.0, np.array([1.1, 0, 0.12])),
        LegRecord(1, wait, 12.0, 13.0, "done", 0.0, 2.0, 900.0, np.array([1.1, 0, 1.5])),
    ]
    meter = Meter(land_m=4.0, air_m=2.0, energy_land_j=300.0, energy_air_j=500.0, energy_transition_j=400.0)
    return Logbook(meter, [0.001, 0.002], [0.03], [0.06], legs, started_s=10.0, ended_s=13.0)


def flown(outcome="success"):
    return summarise.flown("t", book(), outcome, "all items done", 1, np.zeros(3), {})


def test_a_flight_is_summed_up_from_its_own_estimate():
    summary = flown()
    assert summary.duration_s == 3.0
    assert summary.goal_errors_m == [pytest.approx(0.1)]
    assert summary.contacts is None
    assert summary.tick_late_ms["max"] == 2.0


def truth(folder, contacts=0):
    stamps = np.array([11.0, 12.0, 13.0])
    np.savez(
        folder / "truth.npz", stamp_s=stamps, position_m=np.array([[0, 0, 0.12], [1.3, 0.4, 0.12], [9, 9, 9]])
    )
    (folder / "referee.json").write_text(json.dumps({"contacts": contacts, "min_clearance_m": 0.2}))


def test_the_truth_replaces_the_estimate_where_it_is_known(tmp_path):
    truth(tmp_path, contacts=2)
    summary = summarise.with_truth(flown(), tmp_path)
    assert summary.goal_errors_m == [pytest.approx(0.5)]  # of (1.3, 0.4) from (1, 0), when the leg ended
    assert (summary.contacts, summary.min_clearance_m) == (2, 0.2)


def test_without_a_referee_the_estimate_stays(tmp_path):
    assert summarise.with_truth(flown(), tmp_path) == flown()


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"outcome": "failed"}, "outcome failed"),
        ({"contacts": 1}, "1 contacts"),
        ({"contacts": None}, "nobody counted"),
        ({"land_m": 2.0}, "2.0 m on land"),
        ({"air_m": 0.5}, "0.5 m in the air"),
        ({"goal_errors_m": [0.1, 0.6]}, "0.60 m off"),
    ],
)
def test_each_missed_expectation_has_its_sentence(mission, change, word):
    good = replace(flown(), contacts=0)
    assert summarise.missed_expectations(good, mission, judged=True).expect_missed == []
    missed = summarise.missed_expectations(replace(good, **change), mission, judged=True).expect_missed
    assert len(missed) == 1
    assert word in missed[0]


def test_on_a_real_robot_nobody_counts_contacts_and_that_is_no_miss(mission):
    assert summarise.missed_expectations(flown(), mission, judged=False).expect_missed == []


def test_the_meter_keeps_land_air_and_transition_apart():
    meter = Meter()
    x = 0.0
    for phase, power in ((Phase.DRIVING, 80.0), (Phase.LIFTING, 600.0), (Phase.FLYING, 590.0)):
        for _ in range(50):
            x += 0.01
            meter.add(phase, np.array([x, 0.0, 0.0]), 0.5, power, 0.02)
    assert meter.land_m == pytest.approx(0.49)
    assert meter.air_m == pytest.approx(1.0)
    assert meter.energy_land_j == pytest.approx(80.0)
    assert meter.energy_transition_j == pytest.approx(600.0)
    assert meter.energy_j == pytest.approx(80.0 + 600.0 + 590.0)


def test_the_meter_does_not_count_a_jump_or_a_tremble_or_an_unknown_power():
    meter = Meter()
    for x, speed, power in ((0.0, 0.5, 10.0), (5.0, 0.5, float("nan")), (5.001, 0.0, -3.0)):
        meter.add(Phase.DRIVING, np.array([x, 0.0, 0.0]), speed, power, 0.02)
    assert meter.land_m == 0.0
    assert meter.energy_j == pytest.approx(0.2)
