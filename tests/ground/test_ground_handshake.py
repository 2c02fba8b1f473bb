"""Opening the link: who answers, who is refused, and with which words."""

from __future__ import annotations

import asyncio
import os
import pty

import pytest
from ground_rig import BAUD, CONFIG, rig

from firmware_bridge.dialect import labr_land as wire
from firmware_bridge.port import SerialPort
from labr_autonomy.clock import SystemClock
from labr_autonomy.errors import LinkError
from labr_autonomy.ground.channel import GroundChannel


def channel_on(device: str) -> GroundChannel:
    return GroundChannel(device, BAUD, CONFIG, SystemClock())


async def test_handshake_tells_who_answers_and_leaves_nothing_behind():
    async with rig() as r:
        fds = len(os.listdir("/proc/self/fd"))
        channel = r.channel()
        assert not channel.state.connected
        identity = await channel.open(2.0)
        assert identity.firmware == "1.1.0"
        assert len(identity.serial) == 24
        assert channel.state.connected
        assert channel.state.mode == "idle"
        assert channel.state.age_s < 0.3
        await channel.close()
        await channel.close()
        assert not channel.state.connected
        assert len(os.listdir("/proc/self/fd")) == fds
        await channel.open(2.0)  # and again
        await channel.close()


@pytest.mark.parametrize(
    ("twin", "words"),
    [
        ({"protocol": wire.PROTOCOL - 1}, "Update the land controller"),
        ({"protocol": wire.PROTOCOL + 1}, "Update this computer"),
        ({"dialect_hash": 0x12345678}, "dialect 12345678.*Update the land controller"),
    ],
)
async def test_another_protocol_is_refused_with_the_side_to_update(twin, words):
    async with rig(**twin) as r:
        channel = r.channel()
        with pytest.raises(LinkError, match=words):
            await channel.open(2.0)
        assert not channel.send_velocity(0.1, 0.0, engaged=False, air_lock=False)
        assert r.twin.state.session == 0
        SerialPort(r.twin.path, BAUD).close()  # the device was given back


async def test_absent_device_is_a_sentence():
    with pytest.raises(LinkError, match=r"/dev/serial/by-id/none is not there .*Plug the land controller in"):
        await channel_on("/dev/serial/by-id/none").open(1.0)


async def test_a_file_is_no_serial_device(tmp_path):
    path = tmp_path / "file"
    path.write_text("")
    with pytest.raises(LinkError, match="cannot be opened"):
        await channel_on(str(path)).open(1.0)


async def test_second_user_is_refused_until_the_first_is_done():
    async with rig() as r:
        first, second = r.channel(), r.channel()
        await first.open(2.0)
        with pytest.raises(LinkError, match="in use by another program"):
            await second.open(0.5)
        assert first.state.connected
        await first.close()
        await second.open(2.0)
        await second.close()


async def test_silence_and_garbage_have_words_of_their_own():
    master, slave = pty.openpty()
    path = os.ttyname(slave)
    try:
        with pytest.raises(LinkError, match=r"did not answer within 0\.1 s.*power and cable"):
            await channel_on(path).open(0.1)
        opening = asyncio.create_task(channel_on(path).open(0.2), name="open")
        await SystemClock().sleep_until(SystemClock().now_s() + 0.05)
        os.write(master, bytes(range(200)))
        with pytest.raises(LinkError, match="200 bytes came, none of them a frame"):
            await opening
    finally:
        os.close(master)
        os.close(slave)


async def test_cancelled_opening_gives_the_device_back():
    master, slave = pty.openpty()
    path = os.ttyname(slave)
    fds = len(os.listdir("/proc/self/fd"))
    try:
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(channel_on(path).open(5.0), 0.05)
        assert len(os.listdir("/proc/self/fd")) == fds
    finally:
        os.close(master)
        os.close(slave)
