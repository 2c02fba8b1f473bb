"""`labr-mission wheels`, the workshop's tool, against a controller in a process of its own."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys

import pytest
from click.testing import CliRunner
from firmware_needs import need
from ground_rig import rig, running

from firmware_bridge.dialect import labr_land as wire
from firmware_bridge.link import Link
from firmware_bridge.port import SerialPort
from labr_autonomy.cli import main
from labr_autonomy.clock import SystemClock, pause_s
from labr_autonomy.commands import wheels
from labr_autonomy.errors import LinkError


@contextlib.contextmanager
def land_controller(which: str, folder):
    """Its robot.yaml."""
    link = folder / "land_controller"
    process = subprocess.Popen(
        [sys.executable, "-m", "sim.bench.links.land_server", which, str(link)],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert json.loads(process.stdout.readline()) == {"event": "ready"}
        robot = folder / "robot.yaml"
        robot.write_text(f"version: 1\nlinks: {{ground: {link}}}\n")
        yield robot
    finally:
        process.terminate()
        process.wait(timeout=10)
        process.stdout.close()


def run(*arguments) -> tuple[int, str]:
    done = CliRunner().invoke(main, ["wheels", *(str(a) for a in arguments)])
    return done.exit_code, done.output


@pytest.mark.sitl
@pytest.mark.parametrize("which", ["twin", "qemu"])
def test_it_shows_the_pins_and_turns_the_wheels_the_way_that_was_asked(tmp_path, which):
    if which == "qemu":
        need("arm-none-eabi-gcc", "qemu-system-arm")
    with land_controller(which, tmp_path) as robot:
        code, said = run("--robot", robot, "--seconds", 1)
        assert code == 0, said
        assert "firmware 1.1.0" in said
        assert "track 0.3" in said
        assert "18.5 V" in said
        assert "turned: left +0.000 m, right +0.000 m" in said
        code, said = run("--robot", robot, "--seconds", 2, "--turn", "0.2,0.4", "--in-the-air", "--json")
        assert code == 0, said
        turned = json.loads(said)["turned_m"]
        assert 0.1 < turned["left"] < turned["right"] < 0.7


@pytest.mark.sitl
def test_an_emergency_stop_keeps_the_wheels_still_until_it_is_released(tmp_path):
    with land_controller("twin", tmp_path) as robot:
        port = SerialPort(str(tmp_path / "land_controller"), 460800)
        port.write(Link().encode(wire.MAVLink_land_estop_message(1)))
        begun_s = SystemClock().now_s()
        while b"emergency stop latched" not in port.read():
            assert SystemClock().now_s() - begun_s < 10.0
            pause_s(0.002)
        port.close()
        turn = ["--robot", robot, "--seconds", 1.5, "--turn", "0.1,0", "--in-the-air"]
        code, said = run(*turn)
        assert code == 3
        assert "the wheels do not turn: " in said
        assert "emergency stop" in said
        code, said = run(*turn, "--release-estop")
        assert code == 0, said
        code, said = run("--robot", robot, "--seconds", 0.5, "--release-estop")
        assert code == 3
        assert "refused" in said


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--turn", "0.1,0"], "say --in-the-air"),
        (["--turn", "0.5,0", "--in-the-air"], "at most 0.3 m/s and 1 rad/s"),
        (["--turn", "nan,0", "--in-the-air"], "too fast"),
        (["--turn", "fast", "--in-the-air"], "no pair of numbers"),
    ],
)
def test_what_is_not_for_a_workshop_is_refused(tmp_path, arguments, words):
    robot = tmp_path / "robot.yaml"
    robot.write_text("version: 1\nlinks: {ground: /dev/serial/by-id/none}\n")
    code, said = run("--robot", robot, *arguments)
    assert code == 2
    assert words in said


@pytest.mark.sitl
async def test_a_cable_that_was_pulled_out_is_a_sentence():
    async with rig() as r, running(r) as channel:
        r.twin.unplug()
        await r.wait(lambda: channel.telemetry is None, 5.0, "lost")
        assert wheels._line(channel).startswith("lost")
        with pytest.raises(LinkError, match="was lost: ") as lost:
            wheels._measured(channel)
        assert lost.value.do


def test_a_controller_that_is_not_there_is_a_sentence(tmp_path):
    robot = tmp_path / "robot.yaml"
    robot.write_text("version: 1\nlinks: {ground: /dev/serial/by-id/none}\n")
    code, said = run("--robot", robot)
    assert code == 3
    assert "/dev/serial/by-id/none is not there" in said
