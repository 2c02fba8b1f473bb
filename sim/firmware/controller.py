"""The emulated firmware in the twin's place: a terminal for the computer, pins and duty for the robot."""

from __future__ import annotations

import asyncio
import contextlib
from pathlib import Path

from firmware_bridge import build
from firmware_bridge.parameters import Parameters
from firmware_bridge.pins import Duty, Inputs
from labr_autonomy.clock import Clock
from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import LinkError
from sim.firmware.plant_wire import DriveReader, PinsWriter
from sim.firmware.qemu import Qemu
from sim.terminal import Terminal

READ_BYTES = 65536
SILENT_S = 0.1  # without a word from the firmware the motors brake, as its watchdog would see to
WAITING_BYTES = 4096  # for a computer that does not read; what is older is dropped


class EmulatedController:
    """Firmware in QEMU behind what looks like its USB serial port.

    Args:
        config: The robot; its limits are flashed.
        clock: Monotonic.
        link_path: See `Terminal`.
        log: See `Qemu`.

    Raises:
        Refused: The cross-compiler or QEMU is not installed.
    """

    def __init__(
        self, config: RobotConfig, clock: Clock, *, link_path: Path | None = None, log: Path | None = None
    ) -> None:
        self.parameters = Parameters.of(config)
        self.machine = Qemu(build.image(self.parameters).elf, log)
        self._clock = clock
        self._reader, self._pins = DriveReader(), PinsWriter()
        self._duty = Duty()
        self._heard_s = clock.now_s()
        self._terminal = Terminal(link_path)
        self._to_computer = b""
        self._loop: asyncio.AbstractEventLoop | None = None

    @property
    def path(self) -> str:
        """Device path for the computer."""
        return self._terminal.path

    def attend(self, loop: asyncio.AbstractEventLoop) -> None:
        """Pass on what the firmware says at once, not only in `step`."""
        self._loop = loop
        loop.add_reader(self.machine.link.fileno(), self._on_readable)

    def _on_readable(self) -> None:
        try:
            self.pass_on()
        except LinkError:
            self._ignore()  # the next `step` says so

    def _ignore(self) -> None:
        if self._loop is not None:
            self._loop.remove_reader(self.machine.link.fileno())
            self._loop = None

    def step(self, now_s: float, inputs: Inputs) -> Duty:
        """Tell the firmware its pins, and take the newest duty. Call it at 250 Hz."""
        with contextlib.suppress(BlockingIOError, BrokenPipeError):  # far behind, or gone: `pass_on` tells
            self.machine.plant.send(self._pins.frame(inputs, int(now_s * 1000.0)))
        self.pass_on()
        return self.duty()

    def duty(self) -> Duty:
        """The newest duty; braked when the firmware has fallen silent."""
        with contextlib.suppress(BlockingIOError):
            data = self.machine.plant.recv(READ_BYTES)
            if not data:
                raise LinkError("the emulator of the land controller ended")
            newest = self._reader.feed(data)
            if newest is not None:
                self._duty, self._heard_s = newest, self._clock.now_s()
        return self._duty if self._clock.now_s() - self._heard_s <= SILENT_S else Duty()

    def pass_on(self) -> None:
        """Carry bytes between the terminal and the firmware, in both directions, without waiting."""
        with contextlib.suppress(BlockingIOError):
            data = self.machine.link.recv(READ_BYTES)
            if not data:
                raise LinkError("the emulator of the land controller ended")
            self._to_computer += data
        said = self._terminal.read()
        if said:
            with contextlib.suppress(BlockingIOError, BrokenPipeError):
                self.machine.link.send(said)
        taken = self._terminal.write(self._to_computer)
        waits = WAITING_BYTES if self._terminal.plugged else 0
        self._to_computer = self._to_computer[max(taken, len(self._to_computer) - waits) :]

    def unplug(self) -> None:
        """Pull the cable; the firmware keeps running."""
        self._terminal.unplug()

    def replug(self) -> None:
        """Put the cable back; the kernel gives the terminal a new number."""
        self._terminal.replug()

    def close(self) -> None:
        """End the machine and give the terminal back."""
        self._ignore()
        self._terminal.unplug()
        self.machine.close()
