"""The twin through its terminal, on a simulated clock: bytes in, bytes out, wheels turning."""

from __future__ import annotations

import itertools
import random
import select

import pytest

from firmware_bridge.dialect import labr_land as wire
from firmware_bridge.link import Link
from firmware_bridge.parameters import TICKS_PER_M
from firmware_bridge.pins import Inputs
from firmware_bridge.port import SerialPort
from labr_autonomy.config import RobotConfig
from labr_autonomy.ground.clock_map import ClockMap
from sim.land_controller import LandController
from sim.rover import Rover

CONFIG = RobotConfig()
DT = 0.004


class FakeClock:
    def __init__(self) -> None:
        self.time_s = 100.0

    def now_s(self) -> float:
        return self.time_s

    async def sleep_until(self, due_s: float) -> None:
        raise AssertionError("the twin does not wait")


class Bench:
    """Computer's side by hand, the twin, and the rover, all stepped together."""

    def __init__(self) -> None:
        self.clock = FakeClock()
        self.twin = LandController(CONFIG, self.clock, 3)
        self.rover = Rover(CONFIG, 3)
        self.port = SerialPort(self.twin.path, 460800)
        self.link = Link()
        self.map = ClockMap()
        self.got = []
        self.stamps = {}  # id(state message) -> stamp on our clock
        self.session = 0
        self.sequence = 0
        self.targets = (0.0, 0.0, True)

    def write(self, data: bytes) -> None:
        assert self.port.write(data) == len(data)
        assert select.select([self.twin], [], [], 1.0)[0], "the terminal did not pass the bytes on"

    def say(self, message) -> None:
        self.write(self.link.encode(message))

    def step(self, count: int = 1) -> None:
        for _ in range(count):
            self.clock.time_s += DT
            left, right, braked = self.targets
            s = self.rover.step(DT, left, right, braked=braked)
            self.targets = self.twin.step(
                self.clock.time_s, Inputs(19.0, s.watts / 19.0, True, False, s.left_ticks, s.right_ticks)
            )
            for received in self.link.feed(self.port.read(), self.clock.time_s):
                m = received.message
                self.got.append(m)
                if m.get_type() == "LAND_STATE":
                    self.stamps[id(m)] = self.map.add(m.time_ms, self.clock.time_s)
                elif m.get_type() == "LAND_IDENTITY":
                    self.session = m.session

    def of(self, name: str) -> list:
        return [m for m in self.got if m.get_type() == name]

    def shake_hands(self) -> None:
        self.say(wire.MAVLink_land_hello_message(1, wire.DIALECT_HASH, wire.PROTOCOL))
        for _ in range(500):
            self.step()
            if self.session and self.map.known:
                return
        raise AssertionError("no identity")

    def command(self, v: float, w: float, *, engaged: bool = True) -> None:
        self.sequence += 1
        deadline = (self.map.controller_ms(self.clock.time_s) + 200) % 2**32
        v_mmps, w_mradps, flags = round(1000 * v), round(1000 * w), int(engaged)
        self.say(wire.MAVLink_land_heartbeat_message(self.session, 0, 0, flags))
        self.say(
            wire.MAVLink_land_velocity_message(self.session, deadline, v_mmps, w_mradps, self.sequence, flags)
        )

    def drive(self, v: float, w: float, duration_s: float) -> None:
        for _ in range(round(duration_s / 0.02)):
            self.command(v, w)
            self.step(5)


@pytest.fixture
def bench():
    b = Bench()
    yield b
    b.port.close()
    b.twin.close()


def test_telemetry_at_50_hz_and_heartbeat_at_10_hz(bench):
    bench.step(1000)
    times = [m.time_ms for m in bench.of("LAND_STATE")]
    gaps = [b - a for a, b in itertools.pairwise(times)]
    assert sum(gaps) / len(gaps) == pytest.approx(20.0, rel=0.01)
    assert len(bench.of("LAND_HEARTBEAT")) == pytest.approx(40, abs=2)


def test_odometry_is_right_within_one_percent(bench):
    bench.shake_hands()
    bench.command(0.0, 0.0, engaged=False)
    bench.drive(0.5, 0.6, 2.0)
    bench.drive(0.4, -0.8, 2.0)
    bench.drive(-0.2, 0.3, 1.0)
    bench.drive(0.0, 0.0, 1.0)
    steps = list(itertools.pairwise(bench.of("LAND_STATE")))
    periods = [bench.stamps[id(b)] - bench.stamps[id(a)] for a, b in steps]
    way = sum(0.5e-3 * (a.v + b.v) * dt for (a, b), dt in zip(steps, periods, strict=True))
    turn = sum(0.5e-3 * (a.w + b.w) * dt for (a, b), dt in zip(steps, periods, strict=True))
    s = bench.rover.state
    assert way == pytest.approx(0.5 * (s.left_ticks + s.right_ticks) / TICKS_PER_M, rel=0.01)
    wheel_turn = (s.right_ticks - s.left_ticks) / TICKS_PER_M / CONFIG.body.track_m
    assert turn == pytest.approx(wheel_turn, abs=0.02)
    assert way == pytest.approx(0.5 * 2 + 0.4 * 2 - 0.2, abs=0.1)


def test_the_wheels_stand_0_35_s_after_the_last_command_at_full_speed(bench):
    bench.shake_hands()
    bench.command(0.0, 0.0, engaged=False)
    bench.drive(0.8, 0.0, 1.5)
    assert bench.rover.state.v_mps > 0.75
    bench.command(0.8, 0.0)
    last_s = bench.clock.time_s
    while bench.rover.state.v_mps > 0.0:
        bench.step()
        assert bench.clock.time_s - last_s <= 0.35
    assert bench.clock.time_s - last_s > 0.19, "the watchdog must not bite early"


def test_a_command_that_was_held_up_is_refused(bench):
    """A frame that waited 0.3 s in a buffer is complete and in sequence, but its deadline has passed."""
    bench.shake_hands()
    bench.command(0.0, 0.0, engaged=False)
    bench.step(5)
    deadline = bench.map.controller_ms(bench.clock.time_s) + 200
    held = wire.MAVLink_land_velocity_message(bench.session, deadline, 500, 0, 99, 1)
    bench.step(75)
    bench.say(held)
    bench.step(5)
    assert bench.targets == (0.0, 0.0, True)
    assert bench.of("LAND_ACK")[-1].result == wire.LAND_RESULT_LATE


def test_noise_never_turns_a_wheel_and_the_link_recovers(bench):
    bench.shake_hands()
    bench.command(0.0, 0.0, engaged=False)
    bench.step(5)
    rng = random.Random(4)
    for _ in range(200):
        bench.write(rng.randbytes(rng.randint(1, 300)))
        bench.step()
        assert bench.targets == (0.0, 0.0, True)
    bench.drive(0.3, 0.0, 0.5)
    assert bench.rover.state.v_mps > 0.25


@pytest.mark.slow
def test_nobody_listening_stops_nothing(bench):
    bench.port.close()
    for _ in range(2500):
        bench.clock.time_s += DT
        targets = bench.twin.step(bench.clock.time_s, Inputs(19.0, 1.0, True, False, 0, 0))
    assert targets == (0.0, 0.0, True)
    assert bench.twin.dropped_frames > 0


def test_unplugged_and_replugged_gets_a_link_under_the_same_name(tmp_path):
    link = tmp_path / "usb-LABR"
    twin = LandController(CONFIG, FakeClock(), 3, link_path=link)
    assert link.is_char_device()
    twin.unplug()
    assert not link.exists()
    assert twin.fileno() == -1
    twin.step(100.1, Inputs(19.0, 1.0, True, False, 0, 0))
    twin.replug()
    assert link.is_char_device()
    twin.close()
    twin.close()
    assert not link.exists()
