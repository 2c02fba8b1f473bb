"""The image for the STM32: its size, its watchdog, and the computer's channel to it, in real time."""

from __future__ import annotations

import os
import re
import select
import subprocess
import sys
from pathlib import Path

import pytest
from firmware_needs import need
from ground_rig import BAUD, CONFIG, VOLTS, rig, running

from firmware_bridge import build
from firmware_bridge.pins import Duty, Inputs
from labr_autonomy.clock import SystemClock, pause_s
from sim.firmware.controller import SILENT_S, EmulatedController

STANDING = Inputs(VOLTS, 1.0, True, False, 0, 0)
WATCHDOG_FED = re.compile(r"write .*offset 0x000, value 0x0000aaaa")


@pytest.fixture(autouse=True)
def _tools():
    need("arm-none-eabi-gcc", "qemu-system-arm")


@pytest.mark.slow
def test_the_image_is_built_without_a_warning_and_fits():
    done = subprocess.run(
        [sys.executable, "-m", "firmware_bridge.build"], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    said = re.search(r"flash (\d+) of 65536 bytes, RAM (\d+) of 32768 bytes", done.stdout)
    assert said, done.stdout
    assert 4_000 < int(said[1]) <= 65_536
    assert 4_000 < int(said[2]) <= 32_768
    assert "-Werror" in build.WARNINGS


def test_the_limits_of_another_robot_are_another_image():
    slow = CONFIG.model_copy(update={"land": CONFIG.land.model_copy(update={"speed_mps": 0.4})})
    ours, other = (build.image(build.Parameters.of(c)).elf for c in (CONFIG, slow))
    assert ours != other
    assert ours.read_bytes() != other.read_bytes()


def test_interrupts_are_its_own_whoever_has_started_it():
    """DFU's "leave" jumps to the image with the boot loader's vectors still at address 0."""
    elf = build.image(build.Parameters.of(CONFIG)).elf
    dump = ["arm-none-eabi-objdump", "-d", "--no-show-raw-insn", "--disassemble=reset_handler", str(elf)]
    code = subprocess.run(dump, check=True, capture_output=True, text=True).stdout
    symbols = subprocess.run(
        ["arm-none-eabi-nm", str(elf)], check=True, capture_output=True, text=True
    ).stdout
    vectors = next(line.split()[0] for line in symbols.splitlines() if line.endswith(" VECTORS"))
    assert int(vectors, 16) % 0x200 == 0  # as the register wants it, with 97 vectors
    assert f"0x{vectors}" in code
    assert re.search(r"str\S*\s+r\d+, \[r\d+, #\d+\].*0xd08", code)  # SCB_VTOR is 0xE000ED08


def feeds(log) -> int:
    return len(WATCHDOG_FED.findall(log.read_text()))


@pytest.mark.sitl
def test_the_watchdog_is_fed_while_all_parts_report_and_not_when_the_pins_are_gone(tmp_path):
    """QEMU has no watchdog, but it writes down what is said to the place where it would be."""
    log = tmp_path / "unimplemented.log"
    clock = SystemClock()
    controller = EmulatedController(CONFIG, clock, log=log)
    try:

        def run(until, timeout_s: float = 10.0, *, pins: bool = True) -> None:
            begun_s = clock.now_s()
            while not until():
                assert clock.now_s() - begun_s < timeout_s
                if pins:
                    controller.step(clock.now_s(), STANDING)
                else:
                    controller.pass_on()
                    controller.duty()
                pause_s(0.004)

        run(lambda: feeds(log) > 20)
        silent_s = clock.now_s()
        run(lambda: clock.now_s() - silent_s > 0.3, pins=False)
        fed = feeds(log)
        run(lambda: clock.now_s() - silent_s > 0.8, pins=False)
        assert feeds(log) == fed
        run(lambda: feeds(log) > fed + 20)
    finally:
        controller.close()


@pytest.mark.sitl
def test_the_motors_brake_when_the_processor_stands_still():
    """What the watchdog's reset would do on the chip."""
    clock = SystemClock()
    controller = EmulatedController(CONFIG, clock)
    try:
        controller.machine.stop()
        while select.select([controller.machine.plant], [], [], 0.05)[0]:
            controller.machine.plant.recv(65536)
        controller._duty = Duty(0.5, 0.5, braked=False)  # the last it said
        stopped_s = controller._heard_s = clock.now_s()
        assert not controller.duty().braked
        while not controller.duty().braked:
            assert clock.now_s() - stopped_s < 5.0
            pause_s(0.002)
        assert clock.now_s() - stopped_s >= SILENT_S
    finally:
        controller.close()


async def drive(r, channel, v, w, duration_s):
    await r.command(channel, 0.0, 0.0, 0.02, engaged=False)
    return await r.command(channel, v, w, duration_s)


async def at_speed(r, channel) -> None:
    """Drive until it moves, however long a busy machine needs."""
    for _ in range(10):
        await drive(r, channel, 0.5, 0.0, 0.3)
        if r.rover.state.v_mps > 0.2:
            return
    raise AssertionError("it does not move")


@pytest.mark.sitl
async def test_the_channel_drives_the_firmware_and_reads_its_odometry():
    async with rig(firmware=True) as r, running(r) as channel:
        seen = []
        channel.on_odometry = seen.append
        await at_speed(r, channel)
        assert max(o.speed_mps for o in seen) > 0.2
        channel.stop()
        await r.wait(lambda: r.rover.still, 3.0, "rest")
        ticks = r.rover.state.left_ticks, r.rover.state.right_ticks
        await r.wait(lambda: (seen[-1].left_ticks, seen[-1].right_ticks) == ticks, 3.0, "its ticks")
        assert channel.identity.serial == "51454D55" * 3
        values = await channel.read_parameters()
        assert values["track"] == pytest.approx(CONFIG.body.track_m)


@pytest.mark.sitl
async def test_unplugged_and_replugged_it_is_back_within_2_s_and_does_not_move_by_itself(tmp_path):
    async with rig(firmware=True, link_path=tmp_path / "usb-LABR") as r, running(r) as channel:
        await at_speed(r, channel)
        r.twin.unplug()
        pulled_s = r.clock.now_s()
        await r.wait(lambda: not channel.state.connected, 0.5 + r.stall_s, "loss noticed")
        await r.command(channel, 0.5, 0.0, 0.6)
        assert r.last_moving_s - pulled_s <= 0.5 + r.stall_s
        r.twin.replug()
        replugged_s = r.clock.now_s()
        took_s = await r.wait(lambda: channel.state.connected, 5.0, "back")
        assert took_s <= 2.0 + r.stall_s
        assert await r.command(channel, 0.5, 0.0, 0.3) == 0  # the executive has not noticed and talks on
        assert r.last_moving_s < replugged_s
        await at_speed(r, channel)


SECOND = """
import sys
from firmware_bridge.port import SerialPort
from labr_autonomy.errors import LinkError
try:
    SerialPort(sys.argv[1], {baud})
except LinkError as error:
    sys.exit(str(error))
"""


@pytest.mark.sitl
async def test_two_processes_cannot_open_one_port():
    async with rig(firmware=True) as r, running(r) as channel:
        second = [sys.executable, "-c", SECOND.format(baud=BAUD), r.twin.path]
        done = subprocess.run(second, capture_output=True, text=True, check=False)  # noqa: ASYNC221
        assert done.returncode == 1
        assert "in use by another program" in done.stderr
        await r.wait(lambda: channel.state.connected, 2.0, "the first one goes on")
        await channel.close()
        done = subprocess.run(second, capture_output=True, text=True, check=False)  # noqa: ASYNC221
        assert (done.returncode, done.stderr) == (0, "")


ALONE = """
import sys
from firmware_bridge import build
from sim.firmware.qemu import Qemu
machine = Qemu(build.image().elf)
print(machine.pid, flush=True)
sys.stdin.read()
"""


@pytest.mark.sitl
def test_the_emulator_ends_with_its_starter_and_is_not_reached_by_ctrl_c():
    starter = subprocess.Popen(
        [sys.executable, "-c", ALONE], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        pid = int(starter.stdout.readline())
        assert os.getsid(pid) != os.getsid(starter.pid)
        starter.kill()
        starter.wait()
        clock = SystemClock()
        killed_s = clock.now_s()
        while _runs(pid):
            assert clock.now_s() - killed_s < 5.0
            pause_s(0.01)
    finally:
        starter.kill()
        starter.stdin.close()
        starter.stdout.close()


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False
