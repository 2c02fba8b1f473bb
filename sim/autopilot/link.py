"""`AutopilotStandIn`: the vehicle behind a UDP socket."""

from __future__ import annotations

import asyncio
from typing import cast

import numpy as np

from labr_autonomy.clock import utc_s
from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import LinkError
from labr_autonomy.types import Array
from sim.autopilot.brain import Pack
from sim.autopilot.vehicle import Vehicle
from sim.quad.state import QuadState


class _Socket(asyncio.DatagramProtocol):
    """Hands datagrams to the vehicle; a peer that is not there yet is no error."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        self._vehicle.receive(data)

    def error_received(self, exc: Exception) -> None:
        """ICMP says that nobody listens; like a radio, go on sending."""


class AutopilotStandIn:
    """A PX4 look-alike that sends to `remote` from a port of its own choice.

    Args:
        config: The robot; its mass must be the model's.
        remote: Host and port where the client listens (MAVSDK `udpin://`).
        seed: Of the IMU's noise and biases.
    """

    def __init__(self, config: RobotConfig, remote: tuple[str, int], seed: int = 0) -> None:
        self.config = config
        self._remote = remote
        self._transport: asyncio.DatagramTransport | None = None
        self.vehicle = Vehicle(self._send, seed=seed, unix_s=utc_s())

    @property
    def armed(self) -> bool:
        """Whether the rotors may turn."""
        return self.vehicle.armed

    @property
    def local_address(self) -> tuple[str, int]:
        """Where it sends from."""
        if self._transport is None:
            raise LinkError("the autopilot stand-in has no socket yet", "Await open() first.")
        return cast("tuple[str, int]", self._transport.get_extra_info("sockname")[:2])

    async def open(self) -> None:
        """Create the socket."""
        loop = asyncio.get_running_loop()
        try:
            self._transport, _ = await loop.create_datagram_endpoint(
                lambda: _Socket(self.vehicle), remote_addr=self._remote
            )
        except OSError as error:
            raise LinkError(
                f"the autopilot stand-in cannot send to {self._remote[0]}:{self._remote[1]} ({error})",
                "Give a host of this machine and a free UDP port.",
            ) from error

    def step(self, now_s: float, truth: QuadState, battery: Pack) -> Array | None:
        """One tick of 4 ms; see `Vehicle.step`. Returns (4,) duties, or None when disarmed."""
        motors = self.vehicle.step(now_s, truth, battery)
        return None if motors is None else np.array(motors)

    def close(self) -> None:
        """Close the socket; it may be called twice."""
        if self._transport is not None:
            self._transport.close()
            self._transport = None

    def _send(self, data: bytes) -> None:
        if self._transport is not None:
            self._transport.sendto(data)
