"""`labr-mission params` against a stand-in that runs as a program of its own."""

import json
import subprocess
import sys

import pytest
from autopilot_double import free_port
from click.testing import CliRunner

from labr_autonomy.cli import main

pytestmark = pytest.mark.sitl


@pytest.fixture
def autopilot():
    port = free_port()
    command = [sys.executable, "-m", "sim.autopilot.alone", "--air", f"udpout://127.0.0.1:{port}"]
    process = subprocess.Popen(command)
    yield f"udpin://127.0.0.1:{port}"
    process.terminate()
    process.wait(timeout=10)


def test_it_compares_and_applies(autopilot):
    result = CliRunner().invoke(main, ["params", "--air", autopilot])
    assert result.exit_code == 0, result.output
    assert [w in result.output for w in ("name", "have", "want", "why", "--apply")] == [True] * 5
    result = CliRunner().invoke(main, ["params", "--air", autopilot, "--apply", "--json"])
    answer = json.loads(result.output)
    assert (answer["fits"], answer["written"]) == (True, ["COM_OBL_RC_ACT"])
    assert {row["state"] for row in answer["rows"]} == {"good"}


def test_nobody_there_is_a_sentence():
    result = CliRunner().invoke(main, ["params", "--air", "nonsense"])
    assert result.exit_code == 2
    assert "no address of an autopilot" in result.output
