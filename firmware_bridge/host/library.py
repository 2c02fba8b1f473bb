"""The C core in this process: the same bytes and pins as on the STM32, on whatever clock the caller keeps."""

from __future__ import annotations

import functools
import os
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from firmware_bridge import build
from firmware_bridge.pins import Duty, Inputs, wrapped

SERIAL = "484F5354" + "0" * 16  # "HOST"
ROOM = 4096
LIBRARY_VARIABLE = (
    "LABR_HOST_LIBRARY"  # path of a library that is loaded instead: counted, or with a mutation
)

_DECLARATIONS = """
typedef struct {
    float battery_v, current_a, left_a, right_a;
    int32_t left_ticks, right_ticks;
    uint32_t sampled_ms;
    bool wheel_load, rotors_possible, driver_fault, estop_pressed;
} land_inputs;
typedef struct { float left_duty, right_duty; bool braked; } land_outputs;
typedef struct land_controller land_controller;
typedef struct { float duty, integral, ceiling; } land_wheel;

land_controller *land_host_boot(uint32_t boot_count, bool estop, uint8_t reset_cause, const char *serial);
void land_host_reset(land_controller *c, uint8_t reset_cause);
void land_host_free(land_controller *c);
void land_receive(land_controller *c, const uint8_t *bytes, size_t length, uint32_t now_ms);
void land_host_step(land_controller *c, const land_inputs *inputs, uint32_t now_ms, land_outputs *out);
size_t land_host_take(land_controller *c, uint8_t *out, size_t room);
bool land_host_would_move(const bool *holds);
void land_host_wheel(const land_controller *c, land_wheel *w, float target, float measured, float current,
                     float dt_s);
void land_report_log(land_controller *c, uint8_t severity, const char *text);
bool land_host_feeds_watchdog(land_controller *c, uint32_t parts);
bool land_host_keeps(const land_controller *c, int index, float value);
"""


@functools.cache
def _ffi() -> Any:
    import cffi

    ffi = cffi.FFI()
    ffi.cdef(_DECLARATIONS)
    return ffi


class Library:
    """The loaded library.

    Args:
        path: Of the shared object; by default what LABR_HOST_LIBRARY names, or `build.host_library`.

    Raises:
        Refused: There is no gcc to build it.
    """

    def __init__(self, path: Path | None = None) -> None:
        self.ffi = _ffi()
        named = os.environ.get(LIBRARY_VARIABLE)
        self.c: Any = self.ffi.dlopen(str(path or named or build.host_library()))

    def would_move(self, conditions: Sequence[bool]) -> bool:
        """Whether the gate lets wheels turn when of its eight conditions these hold (see land_host.c)."""
        return bool(self.c.land_host_would_move(self.ffi.new("bool[8]", list(conditions))))


class HostController:
    """One land controller in C.

    Args:
        library: The loaded library.
        boot_count: Boots so far.
        estop: Whether the emergency stop was latched before.
        reset_cause: LAND_RESET.
    """

    def __init__(
        self, library: Library, boot_count: int = 1, *, estop: bool = False, reset_cause: int = 0
    ) -> None:
        self._ffi, self._c = library.ffi, library.c
        self._self = self._c.land_host_boot(boot_count, estop, reset_cause, SERIAL.encode())
        self._inputs = self._ffi.new("land_inputs *")
        self._outputs = self._ffi.new("land_outputs *")
        self._room = self._ffi.new("uint8_t[]", ROOM)

    def __enter__(self) -> HostController:
        """Itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give its memory back."""
        self.close()

    def close(self) -> None:
        """Give its memory back; a second call does nothing."""
        if self._self is not None:
            self._c.land_host_free(self._self)
            self._self = None

    def receive(self, data: bytes, now_ms: int) -> None:
        """Bytes from the computer."""
        self._c.land_receive(self._self, data, len(data), now_ms & 0xFFFFFFFF)

    def step(self, pins: Inputs, now_ms: int, sampled_ms: int | None = None) -> Duty:
        """Advance to `now_ms` with these pins, read at `sampled_ms` (now when left out)."""
        i = self._inputs
        i.battery_v, i.current_a = pins.battery_v, pins.current_a
        i.left_a, i.right_a = pins.left_a, pins.right_a
        i.left_ticks, i.right_ticks = wrapped(pins.left_ticks), wrapped(pins.right_ticks)
        i.sampled_ms = (now_ms if sampled_ms is None else sampled_ms) & 0xFFFFFFFF
        i.wheel_load, i.rotors_possible = pins.wheel_load, pins.rotors_possible
        i.driver_fault, i.estop_pressed = pins.driver_fault, pins.estop_pressed
        self._c.land_host_step(self._self, i, now_ms & 0xFFFFFFFF, self._outputs)
        o = self._outputs
        return Duty(o.left_duty, o.right_duty, o.braked)

    def take(self, room: int = ROOM) -> bytes:
        """At most `room` bytes for the computer."""
        count = self._c.land_host_take(self._self, self._room, room)
        return bytes(self._ffi.buffer(self._room, count))

    def reset(self, reset_cause: int = 0) -> None:
        """What the reset pin does; boot count, emergency stop and parameters are kept."""
        self._c.land_host_reset(self._self, reset_cause)

    def log(self, severity: int, text: str) -> None:
        """Let it say something."""
        self._c.land_report_log(self._self, severity, text.encode())

    def wheel(self, state: tuple[float, float, float], *step: float) -> tuple[float, float, float]:
        """One wheel after a step: duty, integral and ceiling.

        Args:
            state: The same three before.
            step: Target and measured speed [m/s], current [A], period [s].
        """
        w = self._ffi.new("land_wheel *", state)
        self._c.land_host_wheel(self._self, w, *step)
        return w.duty, w.integral, w.ceiling

    def feeds_watchdog(self, parts: int) -> bool:
        """Report these parts as alive; whether the watchdog may be fed now."""
        return bool(self._c.land_host_feeds_watchdog(self._self, parts))

    def keeps(self, index: int, value: float) -> bool:
        """Whether a copy of the parameters with this value would be taken over after a reset."""
        return bool(self._c.land_host_keeps(self._self, index, value))
