"""Reading disturbances: from a mission's block through the simulator's spec to the plain value."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest

from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput
from labr_autonomy.mission.disturbances import Disturbances as Block
from labr_autonomy.mission.load import FileProblems, parse_mission
from labr_autonomy.mission.simulator import simulator_spec
from sim.disturbances import Disturbances, Wind
from sim.spec import SimSpec
from sim.vio import VioModel

MISSION = """version: 1
name: weather
items:
  - goto: {x: 1, y: 2}
sim:
  world: {family: forest}
"""


def spec_of(tmp_path, block):
    mission = parse_mission((MISSION + block).encode())
    path = tmp_path / "spec.json"
    path.write_text(json.dumps(simulator_spec(mission, RobotConfig(), 3, None)))
    return SimSpec.load(path)


def test_it_is_plain_json_and_comes_back_the_same():
    for value in (Disturbances(), Disturbances.none(), Disturbances.for_family("forest")):
        assert Disturbances.from_dict(json.loads(json.dumps(value.as_dict()))) == value


def test_what_is_usual_depends_on_the_world():
    indoor, forest = Disturbances.for_family("rooms"), Disturbances.for_family("forest")
    assert (indoor.wind.mean_mps, indoor.wind.gust_mps) == (0.0, 0.2)
    assert (forest.wind.mean_mps, forest.wind.gust_mps) == (1.0, 0.8)
    assert Disturbances.for_world({"mesh": "ethz_forest/forest.glb"}) == forest
    assert Disturbances.for_world({"mesh": "aws_small_house/small_house.npz"}) == indoor
    assert Disturbances.for_world({"family": "garage"}).wind.mean_mps == 0.3


@pytest.mark.parametrize(
    ("values", "what"),
    [
        ({"winds": {}}, "disturbances has no field 'winds'"),
        ({"wind": {"speed": 1.0}}, "disturbances.wind has no field 'speed'"),
        ({"wind": 3}, "disturbances.wind is 3"),
        ({"wind": {"gust_mps": -1.0}}, "disturbances.wind.gust_mps is -1"),
        ({"wind": {"gust_mps": "1"}}, "disturbances.wind.gust_mps is '1'"),
        ({"wind": {"mean_mps": math.nan}}, "disturbances.wind.mean_mps is nan"),
        ({"wind": {"time_constant_s": 0.0}}, "disturbances.wind.time_constant_s is 0"),
        ({"slip": {"burst_share": 1.5}}, "disturbances.slip.burst_share is 1.5"),
        ({"slip": {"steady_low": 0.5}}, "disturbances.slip.steady_low is 0.5"),
        ({"battery": {"charge": 0.0}}, "disturbances.battery.charge is 0"),
        ({"setting": "moon"}, "there is no setting 'moon'"),
    ],
)
def test_nonsense_is_refused_with_a_remedy(values, what):
    with pytest.raises(BadInput, match=what) as refused:
        Disturbances.from_dict(values)
    assert refused.value.do


def test_a_mission_changes_only_what_it_names(tmp_path):
    usual = Disturbances.for_family("forest")
    assert spec_of(tmp_path, "").drawn() == usual
    assert spec_of(tmp_path, "  disturbances: {}\n").drawn() == usual
    given = spec_of(tmp_path, "  disturbances: {wind: {mean_mps: 3, direction_deg: 90}}\n").drawn()
    assert given == replace(usual, wind=Wind(3.0, 0.8, math.pi / 2))
    given = spec_of(tmp_path, "  disturbances: {setting: none, vio: {rotation_sigma_deg: 1}}\n").drawn()
    still = VioModel(0.0, 0.0, math.radians(1.0), 0.0, 0.0, 0.0)
    assert given == replace(Disturbances.none(), vio=still)


@pytest.mark.parametrize(
    ("block", "line", "column", "what", "hint"),
    [
        (
            "  disturbances: {wind: {gusts_mps: 1}}\n",
            7,
            25,
            "unknown key 'gusts_mps'",
            "did you mean 'gust_mps'?",
        ),
        ("  disturbances: {winds: {}}\n", 7, 18, "unknown key 'winds'", "did you mean 'wind'?"),
        ("  disturbances: {wind: {gust_mps: -1}}\n", 7, 35, "must be at least 0", ""),
        ("  disturbances: {setting: moon}\n", 7, 27, "must be 'none'", ""),
        (
            "  disturbances:\n    slip: {steady_low: 0.3, steady_high: 0.1}\n",
            8,
            24,
            "more than steady_high",
            "",
        ),
    ],
)
def test_errors_of_the_block_have_their_place(block, line, column, what, hint):
    with pytest.raises(FileProblems) as refused:
        parse_mission((MISSION + block).encode())
    (problem,) = refused.value.problems
    assert (problem.line, problem.col) == (line, column)
    assert what in problem.message
    assert hint in problem.hint


def test_every_field_of_the_value_can_be_said_in_a_mission():
    """The block and the value are two lists of the same names; neither may forget one."""
    for part, values in Disturbances().as_dict().items():
        said = Block.model_fields[part].default.__class__.model_fields
        assert {name.replace("_deg", "_rad") for name in said} == set(values), part


def test_a_spec_without_the_key_is_read(tmp_path):
    path = tmp_path / "old.json"
    path.write_text(
        json.dumps(
            {
                "world": {"family": "hall"},
                "seed": 1,
                "start": [0, 0, 0, 0],
                "keep_clear_m": [],
                "ask_m": [],
                "robot": {},
            }
        )
    )
    assert SimSpec.load(path).drawn() == Disturbances.for_family("hall")
