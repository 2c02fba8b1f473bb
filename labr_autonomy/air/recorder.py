"""Both directions of the air link into a tlog, without Python in the flight path.

MAVSDK forwards every frame to a UDP socket of ours. Two of its routing rules need an answer. Frames for
system 1 go only to links on which system 1 was heard: so the recorder announces itself there as what it
is, the vehicle's logging component (1/155). And frames addressed to the companion itself are not passed
on: their acknowledgements are encoded anew here (same fields; the sequence number is the recorder's own).
"""

from __future__ import annotations

import asyncio
from typing import Any, cast

from pymavlink.dialects.v20 import common as mavlink

from labr_autonomy.air.px4 import AUTOPILOT_COMPONENT, VEHICLE_SYSTEM
from labr_autonomy.air.telemetry import Received
from labr_autonomy.clock import Clock, utc_s
from labr_autonomy.record.tlog import Tlog

LOGGER_COMPONENT = 155  # MAV_COMP_ID_LOG
ANNOUNCE_S = 1.0


class Recorder(asyncio.DatagramProtocol):
    """A local UDP socket that writes what it is sent."""

    def __init__(self, tlog: Tlog, clock: Clock) -> None:
        self._tlog = tlog
        self._clock = clock
        self._announced_s = -ANNOUNCE_S
        self._transport: asyncio.DatagramTransport | None = None
        self._closed = asyncio.Event()
        self._own = mavlink.MAVLink(None, VEHICLE_SYSTEM, LOGGER_COMPONENT)
        self._autopilot = mavlink.MAVLink(None, VEHICLE_SYSTEM, AUTOPILOT_COMPONENT)

    @classmethod
    async def open(cls, tlog: Tlog, clock: Clock) -> Recorder:
        """Bind a free port on the loopback."""
        loop = asyncio.get_running_loop()
        _, recorder = await loop.create_datagram_endpoint(
            lambda: cls(tlog, clock), local_addr=("127.0.0.1", 0)
        )
        return recorder

    @property
    def url(self) -> str:
        """Where MAVSDK shall forward to."""
        if self._transport is None:
            raise RuntimeError("the recorder is not open")
        return f"udpout://127.0.0.1:{self._transport.get_extra_info('sockname')[1]}"

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The socket is bound."""
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, address: Any) -> None:
        """Frames from MAVSDK."""
        self._tlog.write(utc_s(), data)
        now_s = self._clock.now_s()
        if self._transport is not None and now_s - self._announced_s >= ANNOUNCE_S:
            self._announced_s = now_s
            beat = self._own.heartbeat_encode(
                mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
                mavlink.MAV_AUTOPILOT_INVALID,
                0,
                0,
                mavlink.MAV_STATE_ACTIVE,
            )
            self._transport.sendto(bytes(beat.pack(self._own)), address)
            self._own.seq = (self._own.seq + 1) & 0xFF

    def write_ack(self, fields: Received) -> None:
        """Log a COMMAND_ACK that was addressed to us."""
        names = ("command", "result", "progress", "result_param2", "target_system", "target_component")
        ack = self._autopilot.command_ack_encode(*(int(fields[name]) for name in names))
        self._tlog.write(utc_s(), bytes(ack.pack(self._autopilot)))
        self._autopilot.seq = (self._autopilot.seq + 1) & 0xFF

    def connection_lost(self, _error: Exception | None) -> None:
        """The socket is closed."""
        self._closed.set()

    async def close(self) -> None:
        """Close the socket; the tlog stays its owner's."""
        if self._transport is not None:
            self._transport.close()
            await self._closed.wait()
