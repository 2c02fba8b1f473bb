"""An autopilot stand-in as a program of its own, with its own physics, in place of a SITL.

`python -m sim.autopilot.alone --air udpout://127.0.0.1:14540 [--truth udpout://127.0.0.1:19410]` flies the
JSBSim quadrotor on flat ground at a place and heading of its own, and publishes the truth as PX4's SIH does.
It knows nothing of the world that a mission is flown in.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import logging
import signal
import sys
from collections.abc import Callable
from typing import Protocol

import numpy as np

from labr_autonomy.clock import SystemClock, utc_s
from labr_autonomy.errors import LabrError
from sim.autopilot.brain import Motors, Pack
from sim.autopilot.copter import Copter
from sim.autopilot.sih import hil_state
from sim.autopilot.vehicle import Vehicle
from sim.battery import Battery
from sim.external.endpoint import Endpoint
from sim.pace import due_steps
from sim.quad.quad import STEP_S, Quad
from sim.quad.state import QuadState

REST_M = 0.1221  # body above flat ground, on its wheels
TRUTH_EVERY = 10  # steps: 25 Hz, as PX4's SIH
STILL_MPS = 1e-3

log = logging.getLogger("labr.sim.alone")


class Autopilot(Protocol):
    """What flies: PX4's or ArduPilot's stand-in."""

    @property
    def armed(self) -> bool:
        """Whether the rotors may turn."""
        ...

    @property
    def mode_name(self) -> str:
        """Mode that runs, in a word."""
        ...

    def receive(self, data: bytes) -> None:
        """Bytes off the link."""
        ...

    def step(self, now_s: float, truth: QuadState, pack: Pack) -> Motors | None:
        """One tick; (4,) duties, None while disarmed."""
        ...


class Alone:
    """One autopilot, its quadrotor and its links.

    Args:
        kind: "px4" or "ardupilot".
        air: Address of the companion.
        truth: Where PX4 publishes its truth; None for nowhere.
        yaw_rad: Heading at the start, counter-clockwise from east.
        seed: Of the IMU.
    """

    def __init__(self, kind: str, air: str, truth: str | None, yaw_rad: float, seed: int) -> None:
        self._clock = SystemClock()
        self._air = Endpoint(air)
        self._truth_link = Endpoint(truth) if truth is not None else None
        self._quad = Quad(STEP_S)
        self._quad.reset(np.array([0.0, 0.0, REST_M]), yaw_rad)
        self._battery = Battery()
        self._truth = self._quad.state
        self._steps = 0
        self._start_s = self._clock.now_s()
        self.vehicle: Autopilot = _make(kind, self._air.write_bytes, seed)
        self._told: tuple[str, bool] | None = None
        self.stop = asyncio.Event()

    def step(self, now_s: float) -> None:
        """One step of the physics."""
        for data in self._air.read_bytes():
            self.vehicle.receive(data)
        motors = self.vehicle.step(now_s, self._truth, self._battery)
        now = self.vehicle.mode_name, self.vehicle.armed
        if now != self._told:
            self._told = now
            log.info("%s, %s", now[0], "armed" if now[1] else "disarmed")
        at_rest = self._truth.on_ground and abs(float(self._truth.velocity_mps[2])) < STILL_MPS
        if motors is not None or not at_rest:
            self._battery.draw("rotors", self._truth.electrical_w)
            self._quad.set_volts(self._battery.step(STEP_S))
            self._truth = self._quad.step(np.zeros(4) if motors is None else np.array(motors))
        if self._truth_link is not None and self._steps % TRUTH_EVERY == 0:
            self._truth_link.say(hil_state(self._truth, now_s - self._start_s), 1, 1)
        self._steps += 1

    async def run(self) -> None:
        """Step in real time until `stop` is set."""
        async for stamps_s in due_steps(self._clock, STEP_S, self.stop, log):
            for stamp_s in stamps_s:
                self.step(stamp_s)

    def close(self) -> None:
        """Let go of the links."""
        self._air.close()
        if self._truth_link is not None:
            self._truth_link.close()


def _make(kind: str, send: Callable[[bytes], None], seed: int) -> Autopilot:
    if kind == "ardupilot":
        return Copter(send, seed=seed)  # started half a minute ago: it would not arm before
    return Vehicle(send, seed=seed, unix_s=utc_s())


async def _serve(arguments: argparse.Namespace) -> None:
    alone = Alone(
        arguments.kind, arguments.air, arguments.truth, np.radians(arguments.yaw_deg), arguments.seed
    )
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, alone.stop.set)
    with contextlib.closing(alone):
        await alone.run()


def main(argv: list[str] | None = None) -> int:
    """Entry of `python -m sim.autopilot.alone`."""
    parser = argparse.ArgumentParser(
        prog="sim.autopilot.alone", description="An autopilot stand-in with its own physics."
    )
    parser.add_argument("--kind", choices=("px4", "ardupilot"), default="px4")
    parser.add_argument("--air", default="udpout://127.0.0.1:14540", metavar="URL")
    parser.add_argument("--truth", metavar="URL", help="also publish HIL_STATE_QUATERNION there")
    parser.add_argument("--yaw-deg", type=float, default=90.0, help="heading, counter-clockwise from east")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args(argv)
    logging.basicConfig(level=logging.INFO, format="%(relativeCreated)8d ms %(levelname)s %(message)s")
    try:
        asyncio.run(_serve(arguments))
    except LabrError as error:
        sys.stderr.write(f"{error}\n")
        return int(error.exit_code)
    return 0


if __name__ == "__main__":
    sys.exit(main())
