"""The firmware's stack: that it fits, that it has room to spare, and what happens when it is outgrown."""

from __future__ import annotations

import shutil
import struct
import subprocess

import pytest
from firmware_debugger import SP, Debugger
from firmware_needs import need
from land_bench import Bench
from land_tiers import QemuTier

from firmware_bridge import build
from firmware_bridge.dialect import labr_land as wire
from firmware_bridge.parameters import Parameters
from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput

RAM, STACK_BYTES, GUARD_WORDS = 0x2000_0000, 4096, 32
PAINT = 0x57AC_C0DE


@pytest.fixture
def image():
    need("arm-none-eabi-gcc")
    return lambda: build.image(Parameters.of(RobotConfig()))


@pytest.fixture
def bench(image):
    need("qemu-system-arm")
    tier = QemuTier()
    try:
        yield Bench(tier)
    finally:
        tier.close()


def test_it_lies_at_the_lower_end_of_ram_and_nothing_below_it(image):
    names = subprocess.run(
        ["arm-none-eabi-nm", str(image().elf)], check=True, capture_output=True, text=True
    ).stdout
    at = {line.split()[2]: int(line.split()[0], 16) for line in names.splitlines() if len(line.split()) == 3}
    assert (at["stack_begin"], at["stack_top"] - at["stack_begin"]) == (RAM, STACK_BYTES)
    assert at["data_begin"] >= at["stack_top"]


def test_a_stack_that_does_not_fit_is_refused_by_the_linker(image, tmp_path, monkeypatch):
    port = shutil.copytree(build.PORT, tmp_path / "port")
    script = port / "stm32f405.ld"
    script.write_text(script.read_text().replace("stack_bytes = 4K;", "stack_bytes = 29K;"))
    monkeypatch.setattr(build, "PORT", port)
    with pytest.raises(BadInput, match="data, bss and the stack do not fit into RAM"):
        image()


def unused_bytes(bench, folder) -> int:
    with Debugger(bench.tier.machine, folder) as debugger:
        words = struct.unpack(f"<{STACK_BYTES // 4}I", debugger.read(RAM, STACK_BYTES))
    return 4 * next(k for k, word in enumerate(words) if word != PAINT)


@pytest.mark.sitl
def test_driving_needs_less_than_half_of_it(bench, tmp_path):
    bench.moving()
    bench.drive(0.3, 0.2, 1.0)
    assert unused_bytes(bench, tmp_path) >= STACK_BYTES // 2


def outgrow_guard(debugger) -> None:
    debugger.write(RAM + 4 * (GUARD_WORDS - 1), b"\0\0\0\0")


def outgrow_ram(debugger) -> None:
    debugger.set_register(SP, RAM + 4)


@pytest.mark.sitl
@pytest.mark.parametrize("harm", [outgrow_guard, outgrow_ram])
def test_outgrown_it_stops_the_wheels_and_boots_anew_as_after_a_fault(bench, tmp_path, harm):
    bench.moving()
    boots = bench.of("LAND_IDENTITY")[-1].boot_count
    with Debugger(bench.tier.machine, tmp_path) as debugger:
        harm(debugger)
    bench.until(lambda: bench.duty.braked, "brake")
    bench.map.reset()
    who = bench.hello(nonce=2)
    assert (who.boot_count, who.reset_cause) == (boots + 1, wire.LAND_RESET_FAULT)
    assert bench.duty.braked
