"""A ground station at the window: it sees the air link, and speaks only when it may."""

from __future__ import annotations

import contextlib
import socket

import pytest
from autopilot_double import CLOCK, OFFBOARD, Double, free_port
from pymavlink.dialects.v20 import common as m

from labr_autonomy.air.channel import AirChannel
from labr_autonomy.air.watch import WatchAt
from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput
from labr_autonomy.record.tlog import Tlog

pytestmark = pytest.mark.sitl
POSITION = 0x00030000


class Station:
    """A ground station that listens, as QGroundControl does on UDP 14550."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.port = self.socket.getsockname()[1]
        self.mav = m.MAVLink(None, 255, 190)
        self.parser = m.MAVLink(None)
        self.parser.robust_parsing = True
        self.seen: list[m.MAVLink_message] = []
        self.peer = None

    def listen(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while True:
                data, self.peer = self.socket.recvfrom(2048)
                self.seen += self.parser.parse_buffer(data) or []

    def say(self, message: m.MAVLink_message) -> None:
        self.socket.sendto(message.pack(self.mav), self.peer)
        self.mav.seq = (self.mav.seq + 1) & 0xFF

    async def until(self, reached, timeout_s=5.0) -> bool:
        end_s = CLOCK.now_s() + timeout_s
        while CLOCK.now_s() < end_s:
            self.listen()
            if reached():
                return True
            await CLOCK.sleep_until(CLOCK.now_s() + 0.02)
        return False

    def names(self) -> set[str]:
        return {message.get_type() for message in self.seen}


@contextlib.asynccontextmanager
async def watched(tmp_path, *, may_speak):
    station, port = Station(), free_port()
    log = Tlog(tmp_path / "air.tlog")
    at = WatchAt("127.0.0.1", station.port, may_speak)
    channel = AirChannel(f"udpin://127.0.0.1:{port}", RobotConfig(), CLOCK, log, at)
    async with Double(port) as autopilot:
        await channel.connect(5.0)
        try:
            yield channel, autopilot, station
        finally:
            await channel.close()
            log.close()
            station.socket.close()


def take_over(mode):
    return m.MAVLink_command_long_message(1, 1, 176, 0, 1.0, float(mode >> 16), 0, 0, 0, 0, 0)


@pytest.mark.parametrize("may_speak", [False, True])
async def test_it_sees_the_link_and_its_commands_pass_only_when_they_may(tmp_path, may_speak):
    async with watched(tmp_path, may_speak=may_speak) as (channel, autopilot, station):
        wanted = {"HEARTBEAT", "LOCAL_POSITION_NED", "ATTITUDE_QUATERNION", "BATTERY_STATUS"}
        assert await station.until(lambda: wanted <= station.names())
        await channel.arm()
        assert await station.until(lambda: {"COMMAND_LONG", "COMMAND_ACK"} <= station.names())  # both ways
        autopilot.follow = POSITION  # what the double goes to on DO_SET_MODE
        station.say(take_over(POSITION))
        changed = await station.until(lambda: channel.state.mode == "position", 5.0 if may_speak else 1.0)
        assert changed is may_speak
        sent = [c for c in autopilot.of("COMMAND_LONG") if c.get_srcSystem() == 255]
        assert len(sent) == int(may_speak)


async def test_nobody_else_may_speak_through_the_window(tmp_path):
    async with watched(tmp_path, may_speak=True) as (_, autopilot, station):
        assert await station.until(lambda: station.peer is not None)
        stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        stranger.sendto(take_over(OFFBOARD).pack(station.mav), station.peer)
        stranger.close()
        await station.until(lambda: False, 0.5)
        assert not [c for c in autopilot.of("COMMAND_LONG") if c.get_srcSystem() == 255]


@pytest.mark.parametrize("url", ["14550", "tcp://x:1", "udp://x", "udp://x:99999"])
def test_an_address_that_is_none_is_refused(url):
    with pytest.raises(BadInput, match="no address of a ground station"):
        WatchAt.parse(url, may_speak=False)
