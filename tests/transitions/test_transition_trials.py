"""Hand-overs: what is drawn, what is measured, what counts as done, and what they add up to."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.mission.steps import Kind
from labr_autonomy.modes.transition import Phase
from sim.bench.transitions.figures import lines, summary
from sim.bench.transitions.open_ground import sloping_ground
from sim.bench.transitions.trial import GUST_MPS, Hop, Measure, draw, fly, mission, rises

ROBOT = RobotConfig()


def test_conditions_follow_from_the_seed_and_cover_what_is_asked():
    drawn = [draw(seed) for seed in range(300)]
    assert draw(7) == drawn[7]
    slopes, gusts = [c.slope_deg for c in drawn], [c.gust_mps for c in drawn]
    assert (min(slopes) < 0.2, max(slopes) > 4.9, max(slopes) <= 5.0) == (True, True, True)
    assert GUST_MPS[0] <= min(gusts)
    assert max(gusts) <= GUST_MPS[1]
    assert np.ptp([c.heading_deg - c.uphill_deg for c in drawn]) > 500.0


def test_the_ground_rises_as_drawn_and_the_mission_stays_on_it():
    c = replace(draw(0), slope_deg=5.0, uphill_deg=30.0, heading_deg=75.0)
    east, north = rises(c)
    assert math.degrees(math.atan(math.hypot(east, north))) == pytest.approx(5.0)
    surface = sloping_ground(east, north, ROBOT.body)
    stop, hover, land, on = mission(c, ROBOT)
    assert [s.kind for s in (stop, hover, land, on)] == [Kind.GOTO, Kind.GOTO, Kind.LAND, Kind.GOTO]
    for step, above in ((stop, 0.0), (hover, c.height_m), (on, 0.0)):
        x, y, z = step.goal_m
        floor = surface.floor_below(x, y, 10.0)
        assert z - floor == pytest.approx(ROBOT.body.below_m + above, abs=1e-4)


@pytest.mark.slow
@pytest.mark.timeout(60)
def test_a_steep_and_gusty_hand_over_is_done_and_is_the_same_each_time():
    seed = max(range(40), key=lambda s: draw(s).slope_deg + 5.0 * draw(s).gust_mps)
    c = draw(seed)
    assert c.slope_deg > 4.0
    hop = fly(seed)
    assert hop.done, hop.reason
    assert hop.stop_error_m < 0.10
    assert hop.landing_error_m < 0.25
    assert 0.1 < hop.touchdown_mps < 0.4
    assert hop.tilt_deg < 10.0
    assert fly(seed) == hop


@pytest.mark.slow
@pytest.mark.timeout(90)
def test_with_camera_map_and_network_it_is_done_as_well():
    hop = fly(21, whole=True)  # a slope of 4 degrees
    assert hop.done, hop.reason
    assert hop.stop_error_m < 0.10
    assert hop.touchdown_mps < 0.4


@dataclass
class Plant:
    """As much of the physics as is looked at."""

    height_m: float = 0.0
    on_wheels: bool = True
    down_mps: float = 0.0
    roll: float = 0.0
    load_n: float = 33.0
    xy: list = field(default_factory=lambda: [0.0, 0.0])

    @property
    def state(self):
        return SimpleNamespace(
            position_m=np.array([*self.xy, 0.12 + self.height_m]),
            velocity_mps=np.array([0.0, 0.0, -self.down_mps]),
            quaternion=quaternion_from_rpy(self.roll, 0.0, 0.0),
            wheel_load_n=np.full(4, self.load_n / 4.0),
            on_wheels=self.on_wheels,
        )


def measured(plant):
    c = replace(draw(0), slope_deg=0.0, heading_deg=0.0, drive_m=2.0, fly_m=1.0)
    return Measure(plant, mission(c, ROBOT))


def test_the_fastest_sinking_near_the_floor_counts_not_that_of_the_descent():
    plant = Plant()
    measure = measured(plant)
    course = [(0.5, 0.0), (0.2, 0.9), (0.06, 0.5), (0.04, 0.38), (0.01, 0.31)]
    for height, down in course:
        plant.height_m, plant.down_mps, plant.on_wheels, plant.load_n = height, down, False, 0.0
        measure.step(0.0)
    plant.height_m, plant.down_mps, plant.load_n, plant.roll = 0.0, 0.1, 20.0, 0.05
    measure.step(0.0)
    assert measure.touchdown_mps == pytest.approx(0.38)
    assert measure.tilt_rad == pytest.approx(0.05)


def test_errors_are_taken_when_the_rotors_begin_and_when_it_drives_again():
    plant = Plant()
    measure = measured(plant)
    for phase, xy in (
        (Phase.STOPPING, [2.0, 0.0]),
        (Phase.ARMING, [2.03, 0.04]),
        (Phase.LIFTING, [2.5, 0.0]),
    ):
        plant.xy = xy
        measure.tick(0.0, SimpleNamespace(phase=phase))
    assert measure.stop_error_m == pytest.approx(0.05)
    plant.xy = [3.0, 0.1]
    for phase in (Phase.FLYING, Phase.DESCENDING, Phase.SETTLING, Phase.DISARMING, Phase.DRIVING):
        measure.tick(0.0, SimpleNamespace(phase=phase))
    assert measure.landing_error_m == pytest.approx(0.1)
    assert measure.fault == ""


def test_rotors_taken_for_off_in_the_air_are_a_fault():
    plant = Plant(height_m=0.3, on_wheels=False)
    measure = measured(plant)
    for phase in (Phase.DISARMING, Phase.DRIVING):
        measure.tick(0.0, SimpleNamespace(phase=phase))
    assert "0.30 m above the floor" in measure.fault


def hop(seed=0, **changes):
    values = dict(
        conditions=draw(seed), done=True, reason="", stop_error_m=0.03, landing_error_m=0.05,
        touchdown_mps=0.34, tilt_deg=1.0, time_s=24.0,
    )  # fmt: skip
    return Hop(**{**values, **changes})


def test_what_is_wanted_is_met_or_not():
    good = summary([hop(seed) for seed in range(50)])
    assert all(good["met"].values())
    assert good["done_pct_ci95"][1] == pytest.approx(100.0)
    for bad, key in (
        (hop(7, done=False, reason="it never stood again", touchdown_mps=None), "all_done"),
        (hop(7, stop_error_m=2.0), "stop_error"),
        (hop(7, touchdown_mps=0.41), "touchdown"),
    ):
        found = summary([*(hop(seed) for seed in range(20)), bad])
        assert [name for name, met in found["met"].items() if not met] == [key]
    failed = summary([hop(3, done=False, reason="it never stood again")])
    assert "seed 3: it never stood again" in "\n".join(lines(failed))
    assert "0 of 1 hand-overs done" in lines(failed)[0]


def test_figures_that_nobody_reached_are_dashes():
    nothing = hop(done=False, reason="x", stop_error_m=None, touchdown_mps=None, tilt_deg=None)
    found = summary([nothing])
    assert not found["met"]["stop_error"]
    assert "p50 -" in "\n".join(lines(found))
