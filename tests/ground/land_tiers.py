"""The land controller in its three forms behind one interface: twin, C core on this computer, ELF in QEMU."""

from __future__ import annotations

import contextlib
import select

from firmware_bridge import build
from firmware_bridge.host.library import HostController, Library
from firmware_bridge.pins import Duty, Inputs
from firmware_bridge.port import SerialPort
from labr_autonomy.clock import SystemClock, pause_s
from labr_autonomy.config import RobotConfig
from sim.firmware.plant_wire import DriveReader, PinsWriter
from sim.firmware.qemu import Qemu
from sim.land_controller import LandController

CONFIG = RobotConfig()
BAUD = 460800
DT = 0.004


class SimulatedClock:
    """Time that only `advance` moves."""

    def __init__(self, now_s: float = 100.0) -> None:
        self.time_s = now_s

    def now_s(self) -> float:
        return self.time_s

    async def sleep_until(self, due_s: float) -> None:
        raise AssertionError("nothing waits on this clock")


class TwinTier:
    """`sim.land_controller` on its pseudo-terminal."""

    name = "twin"
    exact = True  # steps on a simulated clock: late answers do not exist

    def __init__(self) -> None:
        self.clock = SimulatedClock()
        self.twin = LandController(CONFIG, self.clock, 3)
        self.port = SerialPort(self.twin.path, BAUD)

    def now_s(self) -> float:
        return self.clock.time_s

    def advance(self) -> float:
        self.clock.time_s += DT
        return DT

    def write(self, data: bytes) -> None:
        assert self.port.write(data) == len(data)
        assert select.select([self.twin], [], [], 5.0)[0], "the terminal did not pass the bytes on"

    def step(self, inputs: Inputs) -> Duty:
        self.twin.step(self.clock.time_s, inputs)
        return self.twin.duty

    def read(self) -> bytes:
        return self.port.read()

    def reset(self) -> None:
        self.twin.reboot(self.clock.time_s)

    def close(self) -> None:
        self.port.close()
        self.twin.close()


class HostTier:
    """The C core as a library."""

    name = "host"
    exact = True

    def __init__(self, library: Library) -> None:
        self.library = library
        self.clock = SimulatedClock()
        self.boot_s = self.clock.time_s - 1.03
        self.controller = HostController(library)

    def now_s(self) -> float:
        return self.clock.time_s

    def advance(self) -> float:
        self.clock.time_s += DT
        return DT

    def _ms(self) -> int:
        return int((self.clock.time_s - self.boot_s) * 1000.0)

    def write(self, data: bytes) -> None:
        self.controller.receive(data, self._ms() + round(DT * 1000.0))  # seen by the next step

    def step(self, inputs: Inputs) -> Duty:
        return self.controller.step(inputs, self._ms())

    def read(self) -> bytes:
        return self.controller.take()

    def reset(self) -> None:
        self.controller.reset()
        self.boot_s = self.clock.time_s

    def close(self) -> None:
        self.controller.close()


class QemuTier:
    """The image for the STM32 in QEMU, in real time; its sockets are read and written directly."""

    name = "qemu"
    exact = False

    def __init__(self) -> None:
        self.clock = SystemClock()
        self.machine = Qemu(build.image().elf)
        self.reader, self.pins = DriveReader(), PinsWriter()
        self.duty = Duty()
        self.last_s = self.clock.now_s()
        self.due_s = self.last_s

    def now_s(self) -> float:
        return self.clock.now_s()

    def advance(self) -> float:
        """Wait for the next step; how long it is since the last one [s]."""
        self.due_s = max(self.due_s + DT, self.clock.now_s())
        pause_s(self.due_s - self.clock.now_s())
        now_s = self.clock.now_s()
        dt, self.last_s = now_s - self.last_s, now_s
        return dt

    def write(self, data: bytes) -> None:
        self.machine.link.sendall(data)

    def step(self, inputs: Inputs) -> Duty:
        with contextlib.suppress(BlockingIOError):
            self.machine.plant.send(self.pins.frame(inputs, int(self.last_s * 1000.0)))
        with contextlib.suppress(BlockingIOError):
            self.duty = self.reader.feed(self.machine.plant.recv(65536)) or self.duty
        return self.duty

    def read(self) -> bytes:
        with contextlib.suppress(BlockingIOError):
            return self.machine.link.recv(65536)
        return b""

    def reset(self) -> None:
        self.machine.reset()
        self.duty = Duty()

    def close(self) -> None:
        self.machine.close()
