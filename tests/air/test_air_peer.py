"""Local sockets that are meant for MAVSDK: another program on the computer is not heard there."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys

import pytest
from autopilot_double import CLOCK
from pymavlink import mavutil
from pymavlink.dialects.v20 import development as m

from labr_autonomy.air.peer import Peer, belongs_to_us
from labr_autonomy.air.recorder import Recorder
from labr_autonomy.air.signed_link import SignedLink
from labr_autonomy.record.tlog import Tlog

STRANGER = """
import socket, sys
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.bind(("127.0.0.1", 0))
for frame in sys.argv[2:]:
    s.sendto(bytes.fromhex(frame), ("127.0.0.1", int(sys.argv[1])))
print(s.getsockname()[1], flush=True)
sys.stdin.read()
"""


@contextlib.contextmanager
def stranger(port, *frames):
    """Another program that says something to a local port; its own port, while it lives."""
    command = [sys.executable, "-c", STRANGER, str(port), *(frame.hex() for frame in frames)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield int(process.stdout.readline())
        process.stdin.close()


@pytest.fixture
def own():
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as s:
        s.bind(("127.0.0.1", 0))
        s.settimeout(5.0)
        yield s


def port_of(url) -> int:
    return int(url.rpartition(":")[2])


def system_time(ms) -> bytes:
    return bytes(m.MAVLink_system_time_message(0, ms).pack(m.MAVLink(None, 1, 1)))


def test_a_socket_of_another_program_is_not_ours(own):
    with stranger(own.getsockname()[1]) as port:
        assert belongs_to_us(own.getsockname()[1])
        assert not belongs_to_us(port)
        peer = Peer()
        assert not peer.admits(("127.0.0.1", port))
        assert peer.admits(own.getsockname())
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as second:
        second.bind(("127.0.0.1", 0))
        assert not peer.admits(second.getsockname())
    assert peer.strangers == 2
    assert peer.admits(own.getsockname())


def test_what_another_program_says_does_not_get_into_the_log(own, tmp_path):
    log = Tlog(tmp_path / "air.tlog")
    recorder = Recorder(log, CLOCK)
    port = port_of(recorder.url)
    with stranger(port, system_time(1)):
        own.sendto(system_time(2), ("127.0.0.1", port))
        heard, _ = own.recvfrom(2048)  # the announcement that only MAVSDK gets
    with stranger(port, system_time(3)):
        recorder.close()
    log.close()
    assert m.MAVLink(None).parse_buffer(heard)[0].get_srcComponent() == 155
    link = mavutil.mavlink_connection(str(log.path), dialect="development")
    said = list(iter(link.recv_match, None))
    link.close()
    assert [x.time_boot_ms for x in said if x.get_type() == "SYSTEM_TIME"] == [2]


def test_nothing_of_another_program_is_signed_in_our_name(own, tmp_path):
    key = tmp_path / "key"
    key.write_bytes(bytes(32))
    key.chmod(0o600)
    link = SignedLink(f"udpout://127.0.0.1:{own.getsockname()[1]}", key)
    mavsdk = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        with stranger(port_of(link.url), system_time(1)):
            mavsdk.sendto(system_time(2), ("127.0.0.1", port_of(link.url)))
            got, _ = own.recvfrom(2048)  # in the order in which they were said
    finally:
        link.close()
        mavsdk.close()
    (frame,) = m.MAVLink(None).parse_buffer(got)
    assert frame.time_boot_ms == 2
