"""Signatures against pymavlink's own, and a signed link against an autopilot that accepts nothing else."""

from __future__ import annotations

import contextlib
import os
import pty
import socket

import pytest
from autopilot_double import CLOCK, Double, free_port
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as m

from labr_autonomy.air.channel import AirChannel
from labr_autonomy.air.signed_link import SignedLink
from labr_autonomy.air.signing import OLD_UNITS, Signer, read_key, stamp_of, unsigned
from labr_autonomy.clock import utc_s
from labr_autonomy.config import Links, RobotConfig
from labr_autonomy.errors import BadInput, LinkError
from labr_autonomy.mission.load import load_robot

KEY, OTHER = bytes(range(32)), bytes(32)
NOW_S = 1_795_000_000.0


def theirs(key=KEY, stamp=None, component=1):
    """pymavlink as the other end."""
    mav = m.MAVLink(None, 1, component)
    mav.robust_parsing = True
    mav.signing.secret_key = key
    mav.signing.sign_outgoing = True
    mav.signing.link_id = 3
    mav.signing.timestamp = stamp_of(NOW_S) if stamp is None else stamp
    mav.signing.allow_unsigned_callback = None
    return mav


def heartbeat(mav):
    return bytes(m.MAVLink_heartbeat_message(2, 12, 1, 0, 3, 3).pack(mav))


def signer(key=KEY):
    return Signer(key, stamp_of(NOW_S))


# -- frames -----------------------------------------------------------------------------------------


@given(st.floats(-1e3, 1e3, width=32), st.integers(0, 255))
def test_pymavlink_accepts_what_we_sign(x, sequence):
    plain = m.MAVLink(None, 1, 195)
    plain.seq = sequence
    frame = bytes(m.MAVLink_local_position_ned_message(1, x, 0.0, 0.0, 0.0, 0.0, 0.0).pack(plain))
    signed = signer().sign(frame, NOW_S)
    assert len(signed) == len(frame) + 13
    (got,) = theirs(stamp=stamp_of(NOW_S) - 10).parse_buffer(signed)
    assert (got.get_type(), got.x, got.get_seq()) == ("LOCAL_POSITION_NED", x, sequence)
    assert unsigned(signed) == frame


def test_pymavlink_refuses_it_under_another_key():
    signed = signer(OTHER).sign(heartbeat(m.MAVLink(None, 1, 195)), NOW_S)
    (got,) = theirs().parse_buffer(signed)
    assert got.get_type() == "BAD_DATA"


def test_we_accept_what_pymavlink_signs_and_give_it_back_unsigned():
    ours, their = signer(), theirs()
    first, second = heartbeat(their), heartbeat(their)
    assert ours.good(first)
    assert ours.good(second)
    assert ours.refused == 0
    (plain,) = m.MAVLink(None).parse_buffer(unsigned(first))
    assert plain.get_type() == "HEARTBEAT"


@pytest.mark.parametrize("where", [2, 5, 10, 15, -14, -13, -7, -1])
def test_one_changed_bit_anywhere_is_refused(where):
    ours, frame = signer(), bytearray(heartbeat(theirs()))
    frame[where] ^= 0x04 if where != 2 else 0x01
    assert not ours.good(bytes(frame))
    assert ours.refused == 1


def test_what_was_heard_before_is_not_accepted_again():
    ours, frame = signer(), heartbeat(theirs())
    assert ours.good(frame)
    assert not ours.good(frame)


def test_a_sender_that_is_long_behind_is_refused_and_each_has_its_own_count():
    ours = signer()
    assert not ours.good(heartbeat(theirs(stamp=stamp_of(NOW_S) - OLD_UNITS - 100)))
    assert ours.good(heartbeat(theirs(stamp=stamp_of(NOW_S) - OLD_UNITS + 100)))
    assert ours.good(heartbeat(theirs(stamp=stamp_of(NOW_S) - 500, component=2)))


def test_unsigned_frames_are_refused_and_cannot_be_passed_off():
    ours = signer()
    for frame in (heartbeat(m.MAVLink(None, 1, 1)), b"", b"\xfd", b"\xfd" * 40):
        assert not ours.good(frame)
    assert ours.sign(b"garbage", NOW_S) is None


def test_stamps_grow_though_the_wall_clock_is_set_back():
    ours, frame = signer(), heartbeat(m.MAVLink(None, 1, 195))
    stamps = []
    for utc in (NOW_S, NOW_S - 3600.0, NOW_S - 3600.0):
        signed = ours.sign(frame, utc)
        stamps.append(int.from_bytes(signed[-12:-6], "little"))
    assert stamps[0] < stamps[1] < stamps[2]


# -- keys -------------------------------------------------------------------------------------------


@pytest.fixture
def key_file(tmp_path):
    path = tmp_path / "signing.key"
    path.write_bytes(KEY)
    path.chmod(0o600)
    return path


def test_a_key_is_read_raw_or_as_digits(key_file):
    assert read_key(key_file) == KEY
    key_file.write_text(KEY.hex() + "\n")
    assert read_key(key_file) == KEY


def test_a_key_that_others_may_read_or_that_is_none_is_refused_and_never_shown(key_file):
    key_file.chmod(0o640)
    with pytest.raises(BadInput, match=r"others may read .* chmod 600"):
        read_key(key_file)
    key_file.chmod(0o600)
    key_file.write_text(KEY.hex()[:-2])
    with pytest.raises(BadInput, match="holds no signing key") as caught:
        read_key(key_file)
    assert KEY.hex()[:8] not in str(caught.value)
    with pytest.raises(BadInput, match="cannot be read"):
        read_key(key_file.with_name("none"))
    assert KEY.hex() not in repr(signer())
    assert str(KEY) not in repr(signer())


def test_the_key_file_is_found_beside_robot_yaml(key_file):
    robot = key_file.with_name("robot.yaml")
    robot.write_text("links: {air_key: signing.key}\n")
    assert load_robot(robot).links.air_key == key_file


# -- the link ---------------------------------------------------------------------------------------


class SignedDouble(Double):
    """Accepts nothing that is not signed with its key, and signs what it says."""

    key = KEY

    def __init__(self, port, **options):
        super().__init__(port, **options)
        for mav in (self.mav, self.decoder):
            mav.signing.secret_key = self.key
            mav.signing.timestamp = stamp_of(utc_s()) - 100
            mav.signing.allow_unsigned_callback = None
        self.mav.signing.sign_outgoing = True


@contextlib.asynccontextmanager
async def pair(key_file, double=SignedDouble):
    port = free_port()
    config = RobotConfig(links=Links(air_key=key_file))
    channel = AirChannel(f"udpin://127.0.0.1:{port}", config, CLOCK)
    async with double(port) as autopilot:
        try:
            yield channel, autopilot, port
        finally:
            await channel.close()


@pytest.mark.sitl
async def test_an_autopilot_that_demands_signatures_is_flown(key_file):
    async with pair(key_file) as (channel, autopilot, _):
        await channel.connect(5.0)
        await channel.arm()
        assert channel.state.armed
        assert channel.state.position_m is not None
        assert channel.forged == 0
        assert autopilot.commands[400] == 1
        await channel.close()
    stamp = int(key_file.with_name("signing.key.stamp").read_text())
    assert abs(stamp - stamp_of(utc_s())) < 60 * 100_000


@pytest.mark.sitl
async def test_forged_frames_change_nothing_and_are_counted(key_file):
    async with pair(key_file) as (channel, _, port):
        await channel.connect(5.0)
        stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        armed = m.MAVLink_heartbeat_message(2, 12, 129, 0x00060000, 4, 3)
        for _ in range(20):
            stranger.sendto(armed.pack(m.MAVLink(None, 1, 1)), ("127.0.0.1", port))
            await CLOCK.sleep_until(CLOCK.now_s() + 0.02)
            assert not channel.state.armed
        stranger.close()
        assert channel.forged >= 10


@pytest.mark.sitl
async def test_an_autopilot_with_another_key_does_not_answer(key_file):
    class Other(SignedDouble):
        key = OTHER

    async with pair(key_file, Other) as (channel, autopilot, _):
        with pytest.raises(LinkError, match="no autopilot answered"):
            await channel.connect(1.5)
        assert not autopilot.commands


def test_a_cable_that_was_pulled_out_is_a_sentence_and_keeps_the_stamp(key_file, caplog):
    master, slave = pty.openpty()
    link = SignedLink(f"serial://{os.ttyname(slave)}:57600", key_file)
    try:
        os.close(slave)
        os.close(master)
        link._thread.join(5.0)
        assert not link._thread.is_alive()
        assert "the signed air link is lost: " in caplog.text
    finally:
        link.close()
    assert int(key_file.with_name("signing.key.stamp").read_text()) == link.signer.stamp
