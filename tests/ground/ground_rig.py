"""A land controller and its rover on a real pseudo-terminal, stepped at 250 Hz in real time."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable

from firmware_bridge.pins import Inputs
from labr_autonomy.clock import SystemClock, Ticker
from labr_autonomy.config import RobotConfig
from labr_autonomy.ground.channel import GroundChannel
from sim.firmware.controller import EmulatedController
from sim.land_controller import LandController
from sim.rover import Rover

CONFIG = RobotConfig()
BAUD = 460800


VOLTS = 19.0


class Rig:
    def __init__(self, *, firmware: bool = False, **options) -> None:
        self.clock = SystemClock()
        self.firmware = firmware
        if firmware:
            self.twin = EmulatedController(CONFIG, self.clock, **options)
        else:
            self.twin = LandController(CONFIG, self.clock, 1, **options)
        self.rover = Rover(CONFIG, 1)
        self.wheel_load = True
        self.last_moving_s = 0.0
        self.stall_s = 0.0  # longest pause of the twin itself, on a busy machine

    def channel(self, log=None) -> GroundChannel:
        return GroundChannel(self.twin.path, BAUD, CONFIG, self.clock, log)

    async def run(self) -> None:
        ticker, last_s = Ticker(self.clock, 0.004), self.clock.now_s()
        left, right, braked = 0.0, 0.0, True
        while True:
            await ticker.wait()
            now_s = self.clock.now_s()
            self.stall_s = max(self.stall_s, now_s - last_s)
            volts = VOLTS if self.firmware else None
            s = self.rover.step(now_s - last_s, left, right, braked=braked, volts=volts)  # up to now, then
            inputs = Inputs(VOLTS, s.watts / VOLTS, self.wheel_load, False, s.left_ticks, s.right_ticks)
            left, right, braked = self.twin.step(now_s, inputs)
            last_s = now_s
            if self.rover.state.left_wheel_mps or self.rover.state.right_wheel_mps:
                self.last_moving_s = now_s

    async def wait(self, condition: Callable[[], object], timeout_s: float, what: str) -> float:
        """Wait for a condition; returns how long it took [s]."""
        begun_s = self.clock.now_s()
        while not condition():
            assert self.clock.now_s() - begun_s < timeout_s, f"{what}: not within {timeout_s} s"
            await self.clock.sleep_until(self.clock.now_s() + 0.002)
        return self.clock.now_s() - begun_s

    async def command(self, channel: GroundChannel, v: float, w: float, duration_s: float, **flags) -> int:
        """Say the same command at 50 Hz; returns how many were sent."""
        flags = {"engaged": True, "air_lock": False} | flags
        ticker, until_s, sent = Ticker(self.clock, 0.02), self.clock.now_s() + duration_s, 0
        while self.clock.now_s() < until_s:
            sent += channel.send_velocity(v, w, **flags)
            await ticker.wait()
        return sent


@contextlib.asynccontextmanager
async def rig(**options) -> AsyncIterator[Rig]:
    """The twin, or the firmware in an emulator, running."""
    r = Rig(**options)
    task = asyncio.create_task(r.run(), name="twin")
    try:
        yield r
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task
        r.twin.close()


@contextlib.asynccontextmanager
async def running(r: Rig, log=None) -> AsyncIterator[GroundChannel]:
    """A channel that is open and runs."""
    channel = r.channel(log)
    await channel.open(2.0)
    task = asyncio.create_task(channel.run(), name="ground")
    try:
        yield channel
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task
        await channel.close()
