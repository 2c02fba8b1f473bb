import math
from dataclasses import replace

import numpy as np
import pytest

from firmware_bridge.dialect.labr_land import LAND_MODE_ESTOP
from labr_autonomy.air.telemetry import AirState
from labr_autonomy.config import RobotConfig
from labr_autonomy.ground.state import GroundState
from labr_autonomy.ground.words import mode_word
from labr_autonomy.mission.budget import joules_to_finish
from labr_autonomy.mission.operator import LINK_LATE_S
from labr_autonomy.mission.preflight import preflight
from labr_autonomy.mission.steps import Kind, Policy, Step
from labr_autonomy.modes.energy import EnergyModel
from labr_autonomy.types import Mode

CONFIG = RobotConfig()
GROUND = GroundState(1.0, True, True, "drive", (), True, 20.5, 1.0, 0.0, 0.0, 0.02)
AIR = AirState(1.0, True, False, "hold", "on_ground", None, None, None, 20.5, 0.9, 1.0, 0.1, False)
GOOD = {
    "ages_s": dict.fromkeys(LINK_LATE_S, 0.02),
    "ground": GROUND,
    "air": AIR,
    "sigma_m": 0.02,
    "energy_left_j": 5000.0,
    "energy_needed_j": 1000.0,
    "logs_ok": True,
}


def failed(**changes):
    return {c.name: c for c in preflight(CONFIG, **{**GOOD, **changes}) if not c.passed}


def test_all_pass_on_a_good_robot_and_none_asks_for_a_fix():
    assert failed() == {}
    assert not any(c.fix for c in preflight(CONFIG, **GOOD))


@pytest.mark.parametrize(
    ("changes", "name", "figure"),
    [
        ({"ages_s": {**GOOD["ages_s"], "depth": 1.2}}, "depth image", "1.2 s old (limit 0.5 s)"),
        ({"ages_s": {**GOOD["ages_s"], "vio": math.inf}}, "pose from VIO", "never"),
        ({"sigma_m": 0.5}, "position", "0.50 m (limit 0.3 m)"),
        ({"air": replace(AIR, battery_remaining=0.1)}, "battery", "10 % (reserve 15 %)"),
        ({"air": replace(AIR, battery_remaining=None)}, "battery", "not reported"),
        ({"ground": replace(GROUND, battery_v=14.2)}, "voltage", "14.2 V"),
        ({"energy_needed_j": 6000.0}, "energy", "needs 6.0 kJ, has 5.0 kJ"),
        ({"energy_left_j": math.nan}, "energy", "needs 1.0 kJ, has an unknown charge"),
        ({"ground": replace(GROUND, mode=mode_word(LAND_MODE_ESTOP))}, "emergency stop", "latched"),
        ({"ground": replace(GROUND, faults=("wheel stalled",))}, "land controller's faults", "wheel stalled"),
        ({"air": replace(AIR, failsafe=True)}, "autopilot's health", "in failsafe"),
        ({"ground": replace(GROUND, wheel_load=False)}, "stands on its wheels", "no load"),
        ({"logs_ok": False}, "logs", "stopped"),
    ],
)
def test_each_failure_is_named_with_its_figure_and_a_fix(changes, name, figure):
    found = failed(**changes)
    assert list(found) == [name]
    assert figure in found[name].figure
    assert found[name].fix


MODEL = EnergyModel.of(CONFIG)
HERE = np.array([0.0, 0.0, 0.12])
FLOOR = Step(Kind.GOTO, "floor", np.array([4.0, 0.0, 0.0]))
ABOVE = Step(Kind.GOTO, "above", np.array([4.0, 0.0, 1.62]), in_air=True)


def test_a_drive_costs_its_metres():
    assert joules_to_finish([FLOOR], HERE, Mode.LAND, MODEL) == pytest.approx(MODEL.land_j(4.0))
    assert joules_to_finish([], HERE, Mode.LAND, MODEL) == 0.0


def test_going_up_and_coming_down_pays_for_both():
    up_and_down = [ABOVE, Step(Kind.LAND, "land")]
    needed = joules_to_finish(up_and_down, HERE, Mode.LAND, MODEL)
    assert needed == pytest.approx(MODEL.land_j(4.0) + MODEL.transition_j())


def test_what_is_flown_by_order_costs_as_flight():
    flown = joules_to_finish([replace(FLOOR, policy=Policy.AIR)], HERE, Mode.LAND, MODEL)
    assert flown == pytest.approx(MODEL.air_j(4.0) + MODEL.transition_j())
    assert flown > 5 * MODEL.land_j(4.0)


def test_hovering_costs_and_standing_does_not():
    wait = Step(Kind.WAIT, "wait", wait_s=10.0)
    assert joules_to_finish([wait], HERE, Mode.LAND, MODEL) == 0.0
    assert joules_to_finish([wait], HERE, Mode.AIR, MODEL) == pytest.approx(10 * MODEL.air_w)
