"""A PX4 on a UDP socket that does only what a test of the channel needs; it flies nothing."""

from __future__ import annotations

import asyncio
import math
import socket
from collections import Counter

from pymavlink.dialects.v20 import common as m

from labr_autonomy.clock import SystemClock

HOLD, OFFBOARD, LAND = 0x03040000, 0x00060000, 0x06040000
CLOCK = SystemClock()


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


class Double(asyncio.DatagramProtocol):
    """Heartbeats at 10 Hz, the five streams at 50 Hz once asked for, acknowledgements as told."""

    def __init__(self, port: int, *, system: int = 1, vehicle: int = 2, autopilot: int = 12) -> None:
        self.remote = ("127.0.0.1", port)
        self.vehicle, self.autopilot = vehicle, autopilot
        self.mav = m.MAVLink(None, system, 1)
        self.decoder = m.MAVLink(None)
        self.decoder.robust_parsing = True
        self.armed, self.mode, self.status = False, HOLD, 3
        self.beating = self.streaming = self.speaking = True
        self.answers: dict[int, int | None] = {}  # command -> result, None = silence
        self.obeys = True
        self.text = b""
        self.received: list[tuple[float, m.MAVLink_message]] = []
        self.start_s = CLOCK.now_s()
        self.commands: Counter[int] = Counter()
        self.timesync_asked_ns = 0
        self.closed = asyncio.Event()

    async def __aenter__(self) -> Double:
        loop = asyncio.get_running_loop()
        self.transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=("127.0.0.1", 0))
        self.task = asyncio.create_task(self.run())
        return self

    async def __aexit__(self, *_: object) -> None:
        self.task.cancel()
        await asyncio.wait([self.task])
        self.transport.close()
        await self.closed.wait()

    def connection_lost(self, _error: Exception | None) -> None:
        self.closed.set()

    def of(self, kind: str) -> list[m.MAVLink_message]:
        return [message for _, message in self.received if message.get_type() == kind]

    def send(self, message: m.MAVLink_message) -> None:
        if not self.speaking:
            return
        self.transport.sendto(bytes(message.pack(self.mav)), self.remote)
        self.mav.seq = (self.mav.seq + 1) & 0xFF

    def datagram_received(self, data: bytes, _address: object) -> None:
        for message in self.decoder.parse_buffer(data) or ():
            self.received.append((CLOCK.now_s(), message))
            if message.get_type() == "COMMAND_LONG":
                self.command(message)

    def command(self, c: m.MAVLink_message) -> None:
        self.commands[c.command] += 1
        result = self.answers.get(c.command, 0)
        if result is None:
            return
        if result == 0 and self.obeys:
            if c.command == 400:
                self.armed = c.param1 > 0.5
            elif c.command == 176:
                self.mode = OFFBOARD
            elif c.command == 21:
                self.mode = LAND
        elif result != 0 and self.text:
            self.send(m.MAVLink_statustext_message(3, self.text))
        self.send(
            m.MAVLink_command_ack_message(c.command, result, 0, 0, c.get_srcSystem(), c.get_srcComponent())
        )

    def boot_s(self) -> float:
        return CLOCK.now_s() - self.start_s

    async def run(self) -> None:
        tick = 0
        while True:
            if self.beating and tick % 5 == 0:
                base = 1 | (128 if self.armed else 0)
                self.send(
                    m.MAVLink_heartbeat_message(self.vehicle, self.autopilot, base, self.mode, self.status, 3)
                )
            if self.streaming:
                self.streams(tick)
            tick += 1
            await CLOCK.sleep_until(self.start_s + tick * 0.02)

    def streams(self, tick: int) -> None:
        ms, us = int(self.boot_s() * 1e3), int(self.boot_s() * 1e6)
        half = math.pi / 8  # heading 45 degrees
        self.send(m.MAVLink_local_position_ned_message(ms, 2.0, 1.0, -0.5, 0.2, 0.1, -0.3))
        self.send(m.MAVLink_attitude_quaternion_message(ms, math.cos(half), 0, 0, math.sin(half), 0, 0, 0))
        self.send(
            m.MAVLink_highres_imu_message(us, 0.1, 0.2, -9.8, 0.01, 0.02, 0.03, 0, 0, 0, 955, 0, 0, 15, 63)
        )
        if tick % 10 == 0:
            self.send(m.MAVLink_extended_sys_state_message(0, 1))
            cells = [16200] + [65535] * 9
            self.send(m.MAVLink_battery_status_message(0, 1, 1, 32767, cells, 1250, 0, 30, 99))
            self.timesync_asked_ns = int(self.boot_s() * 1e9)
            self.send(m.MAVLink_timesync_message(0, self.timesync_asked_ns))
