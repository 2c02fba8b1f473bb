"""`labr-mission bench links`: figures come from answers, and what is missing is refused with a sentence."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner
from firmware_needs import need

from labr_autonomy.cli import main
from sim.bench.links.rows import row


def test_percentiles_and_losses():
    made = row("ground", "twin", "round trip", [0.001 * k for k in range(1, 101)], lost=3)
    assert (made["n"], made["lost"]) == (100, 3)
    assert made["p50_ms"] == pytest.approx(50.5)
    assert made["p99_ms"] == pytest.approx(99.01)
    assert made["max_ms"] == 100.0


@pytest.mark.sitl
@pytest.mark.parametrize(("channel", "which"), [("ground", "twin"), ("ground", "qemu"), ("air", "px4")])
def test_links_are_measured_and_the_load_is_stated(channel, which):
    if which == "qemu":
        need("arm-none-eabi-gcc", "qemu-system-arm")
    done = CliRunner().invoke(main, ["bench", "links", f"--{channel}", which, "--seconds", "1.5", "--json"])
    assert done.exit_code == 0, done.output
    answer = json.loads(done.stdout)
    rows = {r["figure"]: r for r in answer["rows"]}
    assert set(rows) == {
        "round trip",
        "set-point to motors" if channel == "ground" else "set-point to socket",
    }
    for r in rows.values():
        assert (r["channel"], r["endpoint"]) == (channel, which)
        assert r["n"] > 5
        assert 0.0 < r["p50_ms"] <= r["p99_ms"] <= r["max_ms"]
    assert answer["load"]["cores"] >= 1
    assert answer["load"]["load_before"] >= 0.0


def test_a_robot_that_does_not_answer_is_a_sentence(tmp_path):
    robot = tmp_path / "robot.yaml"
    robot.write_text("version: 1\nlinks: {ground: /dev/serial/by-id/none}\n")
    done = CliRunner().invoke(main, ["bench", "links", "--robot", str(robot)])
    assert done.exit_code == 3
    assert "/dev/serial/by-id/none is not there" in done.output


def test_an_emulator_that_is_not_installed_is_a_sentence(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    done = CliRunner().invoke(main, ["bench", "links", "--ground", "qemu", "--seconds", "1"])
    assert done.exit_code == 3
    assert "arm-none-eabi-gcc is not installed. apt-get install gcc-arm-none-eabi" in done.output
