"""A PX4 on a UDP socket that does only what a test of the channel needs; it flies nothing."""

from __future__ import annotations

import asyncio
import math
import socket
import struct
from collections import Counter

from pymavlink.dialects.v20 import development as m
from pymavlink.generator.mavcrc import x25crc

from labr_autonomy.clock import SystemClock
from sim.autopilot.copter.parameters import Parameters as CopterParameters
from sim.autopilot.parameters import Parameters

HOLD, OFFBOARD, LAND = 0x03040000, 0x00060000, 0x06040000
STABILIZE, GUIDED, AP_LAND = 0, 4, 9
ARDUPILOT = 3
TEXT_LATER_S = 0.05
VERSIONS = {12: (59647, 17956992), 3: (64495, 67567616)}  # capabilities and version, as recorded
CLOCK = SystemClock()


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


class Double(asyncio.DatagramProtocol):
    """Heartbeats at 10 Hz, the streams at 50 Hz, acknowledgements as told; PX4's ways or ArduPilot's."""

    def __init__(self, port: int, *, system: int = 1, vehicle: int = 2, autopilot: int = 12) -> None:
        self.remote = ("127.0.0.1", port)
        self.vehicle, self.autopilot = vehicle, autopilot
        self.mav = m.MAVLink(None, system, 1)
        self.decoder = m.MAVLink(None)
        self.decoder.robust_parsing = True
        self.ardupilot = autopilot == ARDUPILOT
        self.hold, self.follow, self.land = (
            (STABILIZE, GUIDED, AP_LAND) if self.ardupilot else (HOLD, OFFBOARD, LAND)
        )
        self.armed, self.mode, self.status = False, self.hold, 3
        self.intended: int | None = None  # CURRENT_MODE's second field; the mode itself by default
        self.landed = 1
        self.version: tuple[int, int] | None = VERSIONS.get(autopilot)
        self.origin: m.MAVLink_message | None = None
        self.px4_parameters, self.copter_parameters = Parameters(), CopterParameters()
        self.event = b""  # payload of an EVENT, sent with a refusal
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
            elif message.get_type() == "SET_GPS_GLOBAL_ORIGIN":
                self.origin = message
                self.tell_origin()

            elif message.get_type() == "PARAM_REQUEST_READ":
                self.tell_parameter(message)
            elif message.get_type() == "PARAM_SET":
                name, value = message.param_id, message.param_value
                if self.ardupilot:
                    self.copter_parameters.write(name, value)
                else:
                    self.px4_parameters.write(name, value, message.param_type)
                self.tell_parameter(message)

    def tell_parameter(self, asked: m.MAVLink_message) -> None:
        """PX4 says when there is none of that name, ArduPilot says nothing."""
        if self.ardupilot:
            answer = self.copter_parameters.read(asked.param_id)
        else:
            answer = self.px4_parameters.read(asked.param_id, -1)
            if answer is None:
                to = asked.get_srcSystem(), asked.get_srcComponent()
                answer = m.MAVLink_param_error_message(*to, asked.param_id.encode(), -1, 1)
        if answer is not None:
            self.send(answer)

    def tell_origin(self) -> None:
        if self.origin is not None:
            at = self.origin.latitude, self.origin.longitude, self.origin.altitude
            self.send(m.MAVLink_gps_global_origin_message(*at))

    def change_mode(self, mode: int) -> None:
        """Somebody changes the mode: ArduPilot says so at once, PX4 with its next word."""
        self.mode = mode
        if self.ardupilot:
            self.beat()

    def command(self, c: m.MAVLink_message) -> None:
        self.commands[c.command] += 1
        result = self.answers.get(c.command, 0)
        if result is None:
            return
        if result == 0 and self.obeys:
            self.obey(c)
        self.send(
            m.MAVLink_command_ack_message(c.command, result, 0, 0, c.get_srcSystem(), c.get_srcComponent())
        )
        if result != 0 and self.text:  # after the acknowledgement, as recorded from ArduPilot
            said = m.MAVLink_statustext_message(3, self.text)
            asyncio.get_running_loop().call_later(TEXT_LATER_S, self.send, said)
        if result != 0 and self.event:
            self.send_event(self.event)

    def obey(self, c: m.MAVLink_message) -> None:
        match c.command:
            case 400:
                self.armed = c.param1 > 0.5
            case 176:
                self.change_mode(self.follow)
            case 21:
                self.change_mode(self.land)
            case 22:
                self.landed = 3
            case 512 if c.param1 == 49:
                self.tell_origin()
            case 512 if c.param1 == 148 and self.version is not None:
                capabilities, version = self.version
                zero = [0] * 8
                self.send(
                    m.MAVLink_autopilot_version_message(
                        capabilities, version, 0, 0, 0, zero, zero, zero, 0, 0, 0
                    )
                )

    def send_event(self, payload: bytes) -> None:
        """EVENT (410), which pymavlink cannot pack: frame and checksum by hand (CRC_EXTRA 160)."""
        header = struct.pack("<BBBBBBB", len(payload), 0, 0, self.mav.seq, 1, 1, 410 & 0xFF) + b"\x01\0"
        crc = x25crc(header + payload)
        crc.accumulate(bytes([160]))
        self.transport.sendto(b"\xfd" + header + payload + struct.pack("<H", crc.crc), self.remote)
        self.mav.seq = (self.mav.seq + 1) & 0xFF

    def boot_s(self) -> float:
        return CLOCK.now_s() - self.start_s

    async def run(self) -> None:
        tick = 0
        while True:
            if self.beating and tick % 5 == 0:
                self.beat()
            if self.streaming:
                self.streams(tick)
            tick += 1
            await CLOCK.sleep_until(self.start_s + tick * 0.02)

    def beat(self) -> None:
        base = 1 | (128 if self.armed else 0)
        self.send(m.MAVLink_heartbeat_message(self.vehicle, self.autopilot, base, self.mode, self.status, 3))

    def streams(self, tick: int) -> None:
        ms, us = int(self.boot_s() * 1e3), int(self.boot_s() * 1e6)
        half = math.pi / 8  # heading 45 degrees
        self.send(m.MAVLink_local_position_ned_message(ms, 2.0, 1.0, -0.5, 0.2, 0.1, -0.3))
        self.send(m.MAVLink_attitude_quaternion_message(ms, math.cos(half), 0, 0, math.sin(half), 0, 0, 0))
        if self.ardupilot:
            self.send(m.MAVLink_raw_imu_message(us, 10, 20, -1000, 10, 20, 30, 0, 0, 0))
        else:
            self.send(
                m.MAVLink_highres_imu_message(
                    us, 0.1, 0.2, -9.8, 0.01, 0.02, 0.03, 0, 0, 0, 955, 0, 0, 15, 63
                )
            )
            intended = self.mode if self.intended is None else self.intended
            self.send(m.MAVLink_current_mode_message(0, self.mode, intended))
        if tick % 10 == 0:
            self.send(m.MAVLink_extended_sys_state_message(0, self.landed))
            cells = [16200] + [65535] * 9
            self.send(m.MAVLink_battery_status_message(0, 1, 1, 32767, cells, 1250, 0, 30, 99))
            self.timesync_asked_ns = int(self.boot_s() * 1e9)
            self.send(m.MAVLink_timesync_message(0, self.timesync_asked_ns))
