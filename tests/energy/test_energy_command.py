"""`labr-mission energy`: what it prints, and how bad input is refused."""

import json

import pytest
import yaml
from click.testing import CliRunner
from energy_rig import Truth, write_flight

from labr_autonomy.cli import main
from labr_autonomy.config import RobotConfig


def run(*words):
    return CliRunner().invoke(main, ["energy", *(str(w) for w in words)])


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    return write_flight(tmp_path_factory.mktemp("runs") / "a", hops=3)


def test_the_block_can_be_pasted_into_robot_yaml(flown, tmp_path):
    done = run(flown)
    assert done.exit_code == 0, done.output
    block = done.output[done.output.index("energy:\n") :]
    path = tmp_path / "robot.yaml"
    path.write_text(block)
    values = yaml.safe_load(block)
    robot = RobotConfig(**values)
    assert robot.energy.air_w == pytest.approx(640.0, rel=0.02)
    assert robot.energy.pack_j == RobotConfig().energy.pack_j
    again = run(flown, "--robot", path)
    assert "air_w" in again.output
    off = [float(word.split()[-1]) for word in again.output.split(" %") if "now" in word]
    assert off == pytest.approx([0.0, 0.0, 0.0, 0.0], abs=0.2)


def test_it_says_how_far_the_present_settings_lie_off(flown):
    lines = {line.split()[0]: line for line in run(flown).output.splitlines() if line.strip()}
    assert "now 590: +8." in lines["air_w"]
    assert "+-" in lines["air_w"]
    assert "take-offs and landings" in lines["transition_s"]


def test_json_has_values_errors_and_the_block(flown):
    answer = json.loads(run(flown, "--json").output)
    land = answer["fit"]["land_w"]
    assert land["value"] == pytest.approx(Truth().land_w(0.8), rel=0.03)
    assert 0.0 < land["error"] < 3.0
    assert land["present"] == 84.0
    assert land["off_pct"] == pytest.approx(100.0 * (land["value"] / 84.0 - 1.0))
    assert answer["fit"]["transition_j"]["unit"] == "J"
    assert answer["channels"] == ["ground"]
    assert yaml.safe_load(answer["robot_yaml"])["energy"]["reserve"] == 0.15


def test_channels_that_disagree_are_named(tmp_path):
    done = run(write_flight(tmp_path / "a", air_gain=1.2))
    assert "the other measured +20 % against the ground channel" in done.output
    assert "disagree" not in run(write_flight(tmp_path / "b", air_gain=1.01)).output


def test_bad_input_is_one_sentence_and_code_2(tmp_path):
    silent = write_flight(tmp_path / "silent", ground=False, air=False)
    torn = tmp_path / "torn"
    torn.mkdir()
    (torn / "flight.mcap").write_bytes(b"no log at all")
    for words, says in (
        ((), "no run is named"),
        ((tmp_path / "nowhere",), "holds no flight.mcap"),
        ((silent,), "holds no battery telemetry"),
        ((torn,), "is not an MCAP file"),
        ((silent, "--robot", tmp_path / "no.yaml"), "no.yaml"),
    ):
        done = run(*words)
        assert done.exit_code == 2, words
        assert says in done.output
        assert len(done.output.strip().splitlines()) == 1
        assert "Traceback" not in done.output
