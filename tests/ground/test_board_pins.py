"""What the STM32's port writes to its registers: `board_pins.c` on this computer, with memory where they are.

QEMU's chip has none of these devices, so this is as near as a test comes to the pins.
"""

from __future__ import annotations

import ctypes
import mmap
import re

import pytest
from firmware_needs import need

from firmware_bridge import build

PERIPHERALS, SIZE = 0x4000_0000, 0x3_0000
MAP_FIXED_NOREPLACE = 0x100000
GPIOA, GPIOB, GPIOC = 0x4002_0000, 0x4002_0400, 0x4002_0800
TIM3, TIM4, TIM8, ADC1, IWDG = 0x4000_0400, 0x4000_0800, 0x4001_0400, 0x4001_2000, 0x4000_3000
CNT, CCR1, BDTR = 0x24, 0x34, 0x44
RCC_CSR, SOFTWARE_RESET, WATCHDOG_RESET = 0x4002_3874, 1 << 28, 1 << 29
IDR, AFRL, AFRH = 0x10, 0x20, 0x24
STEPS = 8400
INPUT, OUTPUT, ALTERNATE, ANALOGUE = 0, 1, 2, 3
GUARD_WORDS, PAINT = 32, 0x57AC_C0DE


class Memory:
    """Plain memory at the addresses of the chip's devices."""

    def __init__(self) -> None:
        libc = ctypes.CDLL(None, use_errno=True)
        libc.mmap.restype = ctypes.c_void_p
        libc.mmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t, *[ctypes.c_int] * 3, ctypes.c_long]
        flags = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | MAP_FIXED_NOREPLACE
        at = libc.mmap(PERIPHERALS, SIZE, mmap.PROT_READ | mmap.PROT_WRITE, flags, -1, 0)
        if at != PERIPHERALS:
            pytest.skip("firmware: memory at the registers' addresses is taken by something else")
        self._unmap = lambda: libc.munmap(ctypes.c_void_p(PERIPHERALS), ctypes.c_size_t(SIZE))

    def __getitem__(self, address: int) -> int:
        return ctypes.c_uint32.from_address(address).value

    def __setitem__(self, address: int, value: int) -> None:
        ctypes.c_uint32.from_address(address).value = value

    def mode(self, gpio: int, n: int) -> int:
        return self[gpio] >> 2 * n & 3

    def function(self, gpio: int, n: int) -> int:
        return self[gpio + (AFRL if n < 8 else AFRH)] >> 4 * (n % 8) & 0xF

    def pulled_up(self, gpio: int, n: int) -> bool:
        return self[gpio + 0x0C] >> 2 * n & 3 == 1

    def compare(self) -> list[int]:
        return [self[TIM8 + CCR1 + 4 * i] for i in range(4)]

    def close(self) -> None:
        self._unmap()


class Inputs(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_float) for name in ("battery_v", "current_a", "left_a", "right_a")),
        *((name, ctypes.c_int32) for name in ("left_ticks", "right_ticks")),
        ("sampled_ms", ctypes.c_uint32),
        *((n, ctypes.c_bool) for n in ("wheel_load", "rotors_possible", "driver_fault", "estop_pressed")),
    ]


class Boot(ctypes.Structure):
    _fields_ = [
        ("boot_count", ctypes.c_uint32),
        ("estop", ctypes.c_bool),
        ("reset_cause", ctypes.c_uint8),
        ("serial", ctypes.c_char_p),
        ("params", ctypes.c_void_p),
    ]


class Outputs(ctypes.Structure):
    _fields_ = [("left", ctypes.c_float), ("right", ctypes.c_float), ("braked", ctypes.c_bool)]


@pytest.fixture
def chip():
    """Registers and the port's functions after `pins_init`."""
    need("gcc")
    memory = Memory()
    try:
        library = ctypes.CDLL(str(build.port_library()))
        library.pins_sample.restype = ctypes.c_bool
        library.pins_init()
        yield memory, library
    finally:
        memory.close()


def drive(chip, left: float, right: float, *, braked: bool = False) -> list[int]:
    memory, library = chip
    library.pins_drive(ctypes.byref(Outputs(left, right, braked)))
    return memory.compare()


def sample(chip) -> tuple[bool, Inputs]:
    found = Inputs()
    fresh = chip[1].pins_sample(ctypes.byref(found), ctypes.c_uint32(1234))
    return fresh, found


def test_a_device_is_written_to_only_when_its_clock_has_come():
    """Plain memory takes every write, so no test of registers sees a lost one, of TIM8 or of TIM2."""
    by_hand = re.compile(r"RCC_A[HP]B\dENR\s*\|?=")
    for source in sorted(build.PORT.glob("*.[ch]")):
        assert not by_hand.findall(source.read_text()), f"{source.name}: let clock_to() wait for the clock"


def test_it_comes_up_braking(chip):
    memory, _ = chip
    assert memory.compare() == [STEPS] * 4
    assert memory[TIM8 + BDTR] & 1 << 15
    assert memory[TIM8 + 0x2C] == STEPS - 1
    assert all(memory.mode(GPIOC, n) == ALTERNATE and memory.function(GPIOC, n) == 3 for n in (6, 7, 8, 9))


def test_pins_have_the_functions_of_the_table(chip):
    memory, _ = chip
    assert all(memory.mode(GPIOA, n) == ALTERNATE and memory.function(GPIOA, n) == 7 for n in (9, 10))
    assert all(memory.mode(GPIOB, n) == ALTERNATE and memory.function(GPIOB, n) == 2 for n in (4, 5, 6, 7))
    assert all(memory.mode(GPIOA, n) == ANALOGUE for n in (4, 5, 6, 7))
    assert all(memory.mode(GPIOC, n) == INPUT and memory.pulled_up(GPIOC, n) for n in (0, 1, 2, 3))
    assert memory.mode(GPIOB, 1) == INPUT
    assert memory.mode(GPIOB, 0) == OUTPUT
    assert memory[GPIOB + 0x18] == 1  # the drivers are woken


def test_duty_is_one_input_high_and_the_other_low_for_its_share(chip):
    assert drive(chip, 0.25, -0.5) == [STEPS, 6300, 4200, STEPS]
    assert drive(chip, 1.0, -1.0) == [STEPS, 0, 0, STEPS]
    assert drive(chip, 0.0, 0.0) == [STEPS] * 4
    assert drive(chip, 0.7, 0.7, braked=True) == [STEPS] * 4


def test_encoders_are_counted_beyond_16_bits_and_backward(chip):
    memory, _ = chip
    _, begun = sample(chip)
    for left, right in ((30_000, 65_000), (60_000, 40_000), (24_000, 15_000)):
        memory[TIM3 + CNT], memory[TIM4 + CNT] = left, right
        _, found = sample(chip)
    assert found.left_ticks - begun.left_ticks == 89_536
    assert found.right_ticks - begun.right_ticks == -50_536
    assert found.sampled_ms == 1234


def test_a_wire_that_came_off_reads_as_the_safe_answer(chip):
    memory, _ = chip
    memory[GPIOC + IDR], memory[GPIOB + IDR] = 0xF, 2
    _, off = sample(chip)
    assert (off.wheel_load, off.rotors_possible, off.estop_pressed, off.driver_fault) == (0, 1, 1, 0)
    memory[GPIOC + IDR], memory[GPIOB + IDR] = 0, 0
    _, low = sample(chip)
    assert (low.wheel_load, low.rotors_possible, low.estop_pressed, low.driver_fault) == (1, 0, 0, 1)
    for one_open in (1, 2):
        memory[GPIOC + IDR] = one_open
        assert not sample(chip)[1].wheel_load


def test_voltages_and_currents_have_their_scale_and_the_dutys_sign(chip):
    memory, _ = chip
    for n, volts in enumerate((18.5 / 11.0, 0.25, 0.4, 0.4)):
        memory[ADC1 + 0x3C + 4 * n] = round(volts / 3.3 * 4095)
    memory[ADC1] = 1 << 2
    drive(chip, 0.3, -0.3)
    fresh, found = sample(chip)
    assert fresh
    assert found.battery_v == pytest.approx(18.5, abs=0.02)
    assert found.current_a == pytest.approx(2.5, abs=0.01)
    assert found.left_a == pytest.approx(2.0, abs=0.01)
    assert found.right_a == pytest.approx(-2.0, abs=0.01)
    assert not sample(chip)[0], "until the next conversion has ended it is not fresh"
    assert memory[ADC1 + 8] & 1 << 22, "the next conversion was begun"


def test_the_watchdog_is_set_to_100_ms_and_fed(chip):
    memory, library = chip
    library.watchdog_start()
    assert memory[IWDG + 4] == 0
    assert memory[IWDG + 8] == 800  # of 32 kHz / 4
    assert memory[IWDG] == 0xAAAA
    memory[IWDG] = 0
    library.watchdog_feed()
    assert memory[IWDG] == 0xAAAA


def booted(chip, reset: int) -> Boot:
    memory, library = chip
    memory[RCC_CSR] = reset
    boot = Boot()
    library.keep_load(ctypes.byref(boot))
    return boot


@pytest.mark.parametrize("reset", [WATCHDOG_RESET, SOFTWARE_RESET])
def test_what_was_kept_outlives_a_reset_and_counts_as_a_stop_when_it_was_damaged(chip, reset):
    memory, _ = chip
    first = booted(chip, 0)  # the power came; whatever the memory holds by chance
    assert (first.boot_count, first.estop) == (1, False)
    again = booted(chip, reset)
    assert (again.boot_count, again.estop) == (2, False)
    memory[build.KEPT_AT + 4] ^= 1
    damaged = booted(chip, reset)
    assert (damaged.boot_count, damaged.estop) == (1, True)
    assert booted(chip, reset).estop
    memory[build.KEPT_AT + 4] ^= 1
    assert not booted(chip, 0).estop


def test_a_single_word_written_to_the_guard_of_the_stack_is_seen(chip):
    memory, library = chip
    library.stack_holds.restype = ctypes.c_bool
    guard = [build.STACK_AT + 4 * k for k in range(GUARD_WORDS)]
    for address in guard:
        memory[address] = PAINT
    assert library.stack_holds()
    for address in guard:
        memory[address] = 0
        assert not library.stack_holds()
        memory[address] = PAINT
    memory[build.STACK_AT + 4 * GUARD_WORDS] = 0
    assert library.stack_holds(), "above the guard the stack may be used"
