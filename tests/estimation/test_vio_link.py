from __future__ import annotations

import asyncio
import math
import socket

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from labr_autonomy.errors import BadInput, LinkError
from labr_autonomy.estimation.vio_link import Refusal, VioLink, VioSample, encode_vio, udp_address
from labr_autonomy.frames import quaternion_from_rpy


class StoppedClock:
    def now_s(self):
        return 100.0

    async def sleep_until(self, due_s):
        raise AssertionError("nothing here sleeps")


def sample(stamp_s=10.0, **changes):
    values = {
        "stamp_s": stamp_s,
        "position_m": np.array([1.0, -2.0, 0.5]),
        "quaternion": quaternion_from_rpy(0.1, -0.2, 2.0),
        "velocity_mps": np.array([0.3, 0.1, -0.05]),
        "covariance": np.diag([1e-4, 2e-4, 3e-4, 4e-6, 5e-6, 6e-6]) + 1e-7,
    }
    return VioSample(**(values | changes))


@pytest.fixture
def link():
    got = []
    link = VioLink("udp://127.0.0.1:0", got.append, StoppedClock())
    link.got = got
    return link


def feed(link, *datagrams):
    for datagram in datagrams:
        link.datagram_received(datagram, ("127.0.0.1", 1))


def test_a_sample_survives_the_wire(link):
    sent = sample(reset_count=3)
    feed(link, encode_vio(sent, 700))
    (got,) = link.got
    assert got.stamp_s == pytest.approx(sent.stamp_s, abs=1e-6)
    assert np.allclose(got.position_m, sent.position_m, atol=1e-6)
    assert np.allclose(got.quaternion, sent.quaternion, atol=1e-6)
    assert np.allclose(got.velocity_mps, sent.velocity_mps, atol=1e-6)
    assert np.allclose(got.covariance, sent.covariance, rtol=1e-5)
    assert got.reset_count == 3
    assert link.age_s(10.25) == pytest.approx(0.25, abs=1e-6)


NAN3 = np.array([0.0, math.nan, 0.0])
BAD = {
    "nan position": (sample(position_m=NAN3), Refusal.NOT_FINITE),
    "nan velocity": (sample(velocity_mps=NAN3), Refusal.NOT_FINITE),
    "infinite quaternion": (sample(quaternion=np.array([math.inf, 0, 0, 0])), Refusal.NOT_FINITE),
    "zero quaternion": (sample(quaternion=np.zeros(4)), Refusal.QUATERNION),
    "nan covariance": (sample(covariance=np.full((6, 6), math.nan)), Refusal.COVARIANCE),
    "negative covariance": (sample(covariance=np.diag([1e-4, 1e-4, -1e-4, 1, 1, 1])), Refusal.COVARIANCE),
    "zero covariance": (sample(covariance=np.zeros((6, 6))), Refusal.COVARIANCE),
    "future": (sample(100.2), Refusal.FUTURE),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_samples_are_refused_and_counted(link, case):
    bad, reason = BAD[case]
    feed(link, encode_vio(bad))
    assert not link.got
    assert link.refused == {reason: 1}
    assert link.age_s(0.0) == math.inf


def test_stamps_must_increase(link):
    feed(link, encode_vio(sample(10.0)), encode_vio(sample(10.0)), encode_vio(sample(9.9)))
    feed(link, encode_vio(sample(10.1)))
    assert [s.stamp_s for s in link.got] == pytest.approx([10.0, 10.1])
    assert link.refused == {Refusal.STAMP: 2}


def packed(**changes):
    fields = {
        "time_usec": 10_000_000,
        "frame_id": mavlink.MAV_FRAME_LOCAL_FLU,
        "child_frame_id": mavlink.MAV_FRAME_LOCAL_FLU,
        **dict.fromkeys(("x", "y", "z", "vx", "vy", "vz", "rollspeed", "pitchspeed", "yawspeed"), 0.0),
        "q": [1.0, 0.0, 0.0, 0.0],
        "pose_covariance": [float(v) for v in (1e-4 * np.eye(6))[np.triu_indices(6)]],
        "velocity_covariance": [0.0] * 21,
        "quality": 0,
    } | changes
    return bytes(mavlink.MAVLink_odometry_message(**fields).pack(mavlink.MAVLink(None)))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"frame_id": mavlink.MAV_FRAME_LOCAL_FRD}, Refusal.FRAME),
        ({"frame_id": mavlink.MAV_FRAME_LOCAL_NED}, Refusal.FRAME),
        ({"child_frame_id": mavlink.MAV_FRAME_BODY_FRD}, Refusal.FRAME),
        ({"quality": -1}, Refusal.LOST),
    ],
)
def test_wrong_frames_and_a_lost_source_are_refused(link, changes, reason):
    feed(link, packed(**changes))
    assert link.refused == {reason: 1}
    assert not link.got
    feed(link, packed())
    assert len(link.got) == 1


def test_garbage_truncation_and_bit_errors_never_pass_and_never_spoil_the_next(link):
    whole = encode_vio(sample(10.0))
    rng = np.random.default_rng(5)
    for _ in range(300):
        broken = bytearray(whole)
        broken[rng.integers(len(broken))] ^= 1 << rng.integers(8)
        feed(link, bytes(broken))
    for cut in range(1, len(whole), 7):
        feed(link, whole[:cut])
    feed(link, b"", b"\xfd", rng.bytes(500))
    assert not link.got
    feed(link, whole)
    assert len(link.got) == 1


def test_several_messages_in_a_datagram(link):
    beat = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3).pack(mavlink.MAVLink(None))
    feed(link, bytes(beat) + encode_vio(sample(10.0)) + encode_vio(sample(10.1)) + b"\x00junk")
    assert len(link.got) == 2
    assert link.refused == {Refusal.OTHER: 1, Refusal.GARBAGE: 1}


@pytest.mark.parametrize("url", ["127.0.0.1:14560", "tcp://127.0.0.1:14560", "udp://:14560", "udp://a:port"])
def test_a_bad_address_is_a_sentence(url):
    with pytest.raises(BadInput, match="no address for VIO"):
        udp_address(url)


async def test_over_a_real_socket():
    arrived = asyncio.get_running_loop().create_future()
    link = VioLink("udp://127.0.0.1:0", arrived.set_result, StoppedClock())
    with pytest.raises(LinkError, match="not open"):
        _ = link.port
    await link.open()
    try:
        with pytest.raises(LinkError, match="cannot receive VIO"):
            await VioLink(f"udp://127.0.0.1:{link.port}", print).open()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(encode_vio(sample(10.0)), ("127.0.0.1", link.port))
        got = await asyncio.wait_for(arrived, 5.0)
    finally:
        link.close()
        link.close()
    assert got.stamp_s == pytest.approx(10.0)


async def test_close_releases_a_port_that_was_bound_elsewhere():
    link = VioLink("udp://127.0.0.1:0", print, StoppedClock())
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(lambda: link, local_addr=("127.0.0.1", 0))
    link.close()
    assert transport.is_closing()
