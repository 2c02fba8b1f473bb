"""The bridge between executive and a foreign autopilot, over real sockets, one step at a time."""

import asyncio
import contextlib
import math
import os
import pty
import socket
import struct

import numpy as np
import pytest
from pymavlink.dialects.v20 import development as mavlink
from pymavlink.generator.mavcrc import x25crc

from labr_autonomy.air.address import device_of
from labr_autonomy.clock import SystemClock
from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput, ExitCode, LinkError
from labr_autonomy.frames import quaternion_from_rpy, yaw_of
from sim.autopilot.sih import hil_state
from sim.battery import Battery
from sim.external import bridge as bridge_module
from sim.external.bridge import Bridge
from sim.external.endpoint import Endpoint
from sim.quad.state import QuadState

CLOCK = SystemClock()
ROBOT = RobotConfig()


def udp():
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.bind(("127.0.0.1", 0))
    s.settimeout(1.0)
    return s


def quad(position, yaw=0.0, *, on_wheels, velocity=(0.0, 0.0, 0.0), rates=(0.0, 0.0, 0.0)):
    return QuadState(
        np.array(position, float),
        np.array(velocity, float),
        quaternion_from_rpy(0.0, 0.0, yaw),
        np.array(rates, float),
        np.array([0.0, 0.0, 9.80665]),
        0.0,
        np.full(4, 8.0),
        on_wheels=on_wheels,
    )


class Rig:
    """A bridge with both ends in the hands of a test."""

    def __init__(self, *, speed=1.0):
        self._speed, self._start_s = speed, CLOCK.now_s()
        self.executive, self.autopilot = udp(), udp()
        with udp() as free:
            self.port = free.getsockname()[1]
        self.bridge = Bridge(ROBOT, self.executive.getsockname(), f"udpin://127.0.0.1:{self.port}")
        self.own = mavlink.MAVLink(None, 1, 1)
        self.own.robust_parsing = True
        self.companion = mavlink.MAVLink(None, 1, 195)

    def says(self, *messages):
        for m in messages:
            self.autopilot.sendto(m.pack(self.own), ("127.0.0.1", self.port))
            self.own.seq = (self.own.seq + 1) & 0xFF

    @property
    def boot_s(self):
        return 1.0 + self._speed * (CLOCK.now_s() - self._start_s)

    def beat(self, *, armed=False):
        self.says(mavlink.MAVLink_heartbeat_message(2, 12, 1 | (128 if armed else 0), 0x03040000, 3, 3))

    def truth(self, position, velocity=(0.0, 0.0, 0.0), yaw=math.pi / 2):
        self.says(hil_state(quad(position, yaw, on_wheels=False, velocity=velocity), self.boot_s))

    async def open(self, *, beats=True, truth=True):
        opening = asyncio.create_task(self.bridge.open())
        while not opening.done():
            if beats:
                self.beat()
            if truth:
                self.truth((0.0, 0.0, 0.12))
            await CLOCK.sleep_until(CLOCK.now_s() + 0.02)
        await opening

    def step(self, state):
        return self.bridge.step(CLOCK.now_s(), state, Battery())

    def got(self, end):
        """Everything that one end has been sent."""
        out, end_parser = [], mavlink.MAVLink(None)
        end.setblocking(False)
        try:
            while True:
                out += end_parser.parse_buffer(end.recv(2048)) or []
        except BlockingIOError:
            return out

    def close(self):
        self.bridge.close()
        self.executive.close()
        self.autopilot.close()


@pytest.fixture
async def rig(monkeypatch):
    monkeypatch.setattr(bridge_module, "PACE_LOOK_S", 0.0)  # the clocks are compared in a test of their own
    made = Rig()
    await made.open()
    yield made
    made.close()


def names(messages):
    return [m.get_type() for m in messages]


async def test_the_truth_never_reaches_the_executive(rig):
    rig.truth((0.0, 0.0, 0.12))
    rig.says(mavlink.MAVLink_ping_message(1, 2, 0, 0))
    rig.step(quad((4.0, 2.0, 0.12), on_wheels=True))
    got = names(rig.got(rig.executive))
    assert "PING" in got
    assert "HEARTBEAT" in got
    assert "HIL_STATE_QUATERNION" not in got


async def test_on_its_wheels_the_robot_carries_the_autopilots_world_along(rig):
    for x in (1.0, 2.0, 3.0):
        assert rig.step(quad((x, 1.0, 0.12), 0.3, on_wheels=True)) is None
        a = rig.bridge.alignment
        assert a.ours(rig.bridge.truth.position_m) == pytest.approx((x, 1.0, 0.12), abs=1e-6)
        assert a.yaw_rad == pytest.approx(0.3 - math.pi / 2)


async def test_from_arming_on_the_autopilots_truth_moves_the_robot(rig):
    here = quad((3.0, 1.0, 0.12), 0.0, on_wheels=True)
    rig.step(here)
    rig.beat(armed=True)
    assert rig.step(here) is not None
    body = rig.bridge.body
    body.reset(here.position_m, 0.0, quaternion=here.quaternion)
    frozen = rig.bridge.alignment
    rig.truth((0.0, 2.0, 1.12))  # their north, 1 m up; it looked north, the robot east
    assert rig.step(quad((3.0, 1.0, 0.12), on_wheels=False)) is not None
    for _ in range(2):  # the second look has the new truth to go by
        assert rig.step(quad((3.0, 1.0, 0.12), on_wheels=False)) is not None
        assert rig.bridge.alignment == frozen
    state = body.step(())
    np.testing.assert_allclose(state.position_m, [5.0, 1.0, 1.12], atol=0.02)
    assert yaw_of(state.quaternion) == pytest.approx(0.0, abs=1e-6)
    assert state.wheel_load_n.sum() == 0.0
    assert state.electrical_w == pytest.approx(ROBOT.energy.air_w - ROBOT.energy.idle_w, rel=0.05)


async def test_disarmed_and_down_it_is_the_rovers_again(rig):
    rig.beat(armed=True)
    air = quad((3.0, 1.0, 1.0), on_wheels=False)
    rig.truth((0.0, 0.0, 1.12))
    assert rig.step(air) is not None
    rig.beat(armed=False)
    assert rig.step(air) is not None  # disarmed in the air it still falls by its own physics
    rig.truth((0.0, 0.0, 0.12))
    assert rig.step(air) is None
    load = rig.bridge.body.step(()).wheel_load_n.sum()
    assert load == pytest.approx(ROBOT.body.mass_kg * 9.80665)


async def test_poses_and_set_points_of_the_executive_are_turned_on_their_way(rig):
    rig.step(quad((3.0, 1.0, 0.12), 0.0, on_wheels=True))
    setpoint = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, 0, 1.0, 4.0, -1.12, 0, 0, 0, 0, 0, 0, 0.0, 0.0
    )
    port = rig.bridge._executive.getsockname()[1]
    rig.executive.sendto(setpoint.pack(rig.companion), ("127.0.0.1", port))
    rig.step(quad((3.0, 1.0, 0.12), 0.0, on_wheels=True))
    (m,) = [m for m in rig.got(rig.autopilot) if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]
    # ours: one metre east of the robot, which looks east and stands where they do, looking north
    assert (m.x, m.y, m.z) == pytest.approx((1.0, 0.0, -1.0), abs=1e-3)
    assert (m.get_srcSystem(), m.get_srcComponent()) == (1, 195)


@pytest.mark.parametrize("on_wheels", [True, False])
async def test_the_autopilots_inertial_unit_feels_the_rover_and_nothing_in_flight(rig, on_wheels):
    rig.says(mavlink.MAVLink_highres_imu_message(1, 0.0, 0.0, -9.8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 63))
    rig.step(quad((1.0, 0.0, 0.12), on_wheels=on_wheels, rates=(0.0, 0.0, 0.7)))
    (m,) = [m for m in rig.got(rig.executive) if m.get_type() == "HIGHRES_IMU"]
    assert m.zgyro == pytest.approx(-0.7 if on_wheels else 0.0)
    assert m.zacc == pytest.approx(-9.8)


async def test_a_truth_that_stops_is_noticed_and_one_that_returns_as_well(rig):
    here = quad((0.0, 0.0, 0.12), on_wheels=True)
    rig.step(here)
    assert not rig.bridge.blind
    rig.bridge.step(CLOCK.now_s() + 2.0 * bridge_module.TRUTH_LATE_S, here, Battery())
    assert rig.bridge.blind
    rig.truth((0.0, 0.0, 0.12))
    rig.step(here)
    assert not rig.bridge.blind


async def test_a_parameter_passes_bit_for_bit(rig):
    """PX4 writes integers into the float; this one is a signalling NaN, which no float survives as it is."""
    payload = b"\x01\x00\x80\x7f" + bytes.fromhex("a4030a00") + b"SOME_INT".ljust(16, b"\0") + b"\x06"
    header = bytes([len(payload), 0, 0, 9, 1, 1, 22, 0, 0])
    crc = x25crc(header + payload)
    crc.accumulate(bytes([220]))  # CRC_EXTRA of PARAM_VALUE
    frame = b"\xfd" + header + payload + struct.pack("<H", crc.crc)
    rig.autopilot.sendto(frame, ("127.0.0.1", rig.port))
    rig.step(quad((0.0, 0.0, 0.12), on_wheels=True))
    rig.executive.setblocking(False)
    seen = []
    with contextlib.suppress(BlockingIOError):
        while True:
            seen.append(rig.executive.recv(2048))
    assert frame in seen


async def test_a_frame_of_an_unknown_message_passes_as_it_is(rig):
    payload = bytes(range(20))
    header = bytes([len(payload), 0, 0, 7, 1, 1]) + (77_777).to_bytes(3, "little")
    frame = b"\xfd" + header + payload + b"\x12\x34"
    rig.autopilot.sendto(frame, ("127.0.0.1", rig.port))
    rig.step(quad((0.0, 0.0, 0.12), on_wheels=True))
    rig.executive.setblocking(False)
    seen = []
    with contextlib.suppress(BlockingIOError):
        while True:
            seen.append(rig.executive.recv(2048))
    assert frame in seen


async def test_the_truth_is_asked_for_and_the_answer_is_kept_from_the_executive(rig, monkeypatch):
    rig.got(rig.autopilot)
    monkeypatch.setattr(bridge_module, "TRUTH_LATE_S", -1.0)
    monkeypatch.setattr(bridge_module, "ASK_S", -1.0)
    rig.step(quad((0.0, 0.0, 0.12), on_wheels=True))
    (asked,) = [m for m in rig.got(rig.autopilot) if m.get_type() == "COMMAND_LONG"]
    assert (asked.command, asked.param1, asked.get_srcComponent()) == (511, 115.0, 196)
    rig.says(mavlink.MAVLink_command_ack_message(511, 0, 0, 0, 1, 196))
    rig.says(mavlink.MAVLink_command_ack_message(400, 0, 0, 0, 1, 195))
    rig.step(quad((0.0, 0.0, 0.12), on_wheels=True))
    assert [m.command for m in rig.got(rig.executive) if m.get_type() == "COMMAND_ACK"] == [400]


@pytest.mark.parametrize(
    ("beats", "words"),
    [(False, "no autopilot answered on udpin"), (True, "answers, but its own simulator's truth")],
)
async def test_what_does_not_come_is_named(beats, words, monkeypatch):
    monkeypatch.setattr(bridge_module, "WAIT_S", 0.1)
    rig = Rig()
    try:
        with pytest.raises(LinkError, match=words):
            await rig.open(beats=beats, truth=False)
    finally:
        rig.close()


@pytest.mark.parametrize(("speed", "fine"), [(1.0, True), (4.0, False)])
async def test_an_autopilot_that_does_not_run_in_real_time_is_refused(speed, fine):
    rig = Rig(speed=speed)
    try:
        if fine:
            await rig.open()
        else:
            with pytest.raises(LinkError, match=r"runs at [34]\.\d times real time.*PX4_SIM_SPEED_FACTOR=1"):
                await rig.open()
    finally:
        rig.close()


@pytest.mark.parametrize("url", ["nonsense", "udpin://:14540", "udpin://x:99999", "serial:///dev/x"])
def test_an_address_that_is_none_is_refused(url):
    with pytest.raises(BadInput, match="no address of an autopilot") as caught:
        device_of(url)
    assert caught.value.exit_code is ExitCode.BAD_INPUT


def test_addresses_are_those_of_mavsdk():
    assert device_of("udpin://127.0.0.1:14540") == ("udpin:127.0.0.1:14540", 0)
    assert device_of("tcpout://127.0.0.1:5760") == ("tcp:127.0.0.1:5760", 0)
    assert device_of("serial:///dev/ttyACM0:57600") == ("/dev/ttyACM0", 57600)


def test_an_autopilot_that_is_unplugged_is_a_sentence():
    master, slave = pty.openpty()
    endpoint = Endpoint(f"serial://{os.ttyname(slave)}:57600")
    try:
        assert endpoint.read_bytes() == []
        os.close(slave)
        os.close(master)
        with pytest.raises(LinkError, match="is lost: "):
            endpoint.read()
    finally:
        endpoint.close()
