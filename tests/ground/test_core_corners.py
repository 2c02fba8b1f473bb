"""Corners of the C core that no wire and no robot reaches by itself, or only after hours."""

from __future__ import annotations

import itertools

import pytest

from firmware_bridge.dialect import labr_land as wire
from firmware_bridge.host.library import HostController
from firmware_bridge.link import COMPUTER, Link
from firmware_bridge.pins import Inputs

GROUND = Inputs(18.5, 2.0, True, False, 0, 0)
HELLO = wire.MAVLink_land_hello_message(1, wire.DIALECT_HASH, wire.PROTOCOL)


class Core:
    """A C core in this process with a computer's ear."""

    def __init__(self, library) -> None:
        self.core = HostController(library)
        self.mouth, self.ear = Link(COMPUTER), Link(COMPUTER)
        self.now, self.session, self.sequence = 1000, 0, 0

    def say(self, message) -> None:
        self.raw(self.mouth.encode(message))

    def raw(self, data: bytes) -> None:
        self.core.receive(data, self.now)

    def step(self, ms: int = 4, pins: Inputs = GROUND, sampled_ms: int | None = None) -> list:
        self.now += ms
        self.duty = self.core.step(pins, self.now, sampled_ms)
        return [r.message for r in self.ear.feed(self.core.take(), 1e-3 * self.now)]

    def state(self):
        """The newest telemetry, made now."""
        return [m for m in self.step(20) if m.get_type() == "LAND_STATE"][-1]

    def hello(self) -> None:
        self.say(HELLO)
        self.session = next(m.session for m in self.step() if m.get_type() == "LAND_IDENTITY")

    def velocity(self, v: int = 0, flags: int = 0) -> None:
        self.sequence += 1
        deadline = (self.now + 200) % 2**32
        self.say(wire.MAVLink_land_velocity_message(self.session, deadline, v, 0, self.sequence, flags))

    def engage(self) -> None:
        self.hello()
        self.velocity()
        self.velocity(300, 1)
        self.step()
        assert not self.duty.braked


@pytest.fixture
def core(library):
    c = Core(library)
    yield c
    c.core.close()


def test_motion_only_if_every_condition_holds(library):
    assert [all(c) for c in itertools.product((True, False), repeat=8)] == [
        library.would_move(c) for c in itertools.product((True, False), repeat=8)
    ]


def edited(frame: bytes, at: int, value: int) -> bytes:
    damaged = bytearray(frame)
    damaged[at] = value
    return bytes(damaged)


@pytest.mark.parametrize(
    ("at", "value"),
    [(0, 0xFE), (0, 0x12), (1, 0), (1, 60), (2, 1), (8, 0), (-1, None), (-2, None)],
    ids=[
        "MAVLink 1",
        "no start",
        "no payload",
        "longer than its message",
        "signed",
        "unknown message",
        "checksum",
        "checksum low",
    ],
)
def test_a_frame_that_cannot_be_one_is_skipped_and_the_next_is_found(core, at, value):
    core.hello()
    frame = core.mouth.encode(wire.MAVLink_land_estop_message(7))
    wrong = edited(frame, at, frame[at] ^ 0x55 if value is None else value)
    core.raw(wrong)
    assert core.state().mode == wire.LAND_MODE_IDLE
    core.raw(b"\x00")  # after the gap: nothing of it is left
    core.raw(wrong + core.mouth.encode(wire.MAVLink_land_estop_message(8)))
    assert core.state().mode == wire.LAND_MODE_ESTOP


def test_a_frame_behind_a_false_start_counts_after_an_idle_gap(core):
    core.hello()
    stop = core.mouth.encode(wire.MAVLink_land_estop_message(7))
    log = core.mouth.encode(wire.MAVLink_land_log_message(1, 1, b"x" * 50))
    core.raw(log[:12] + stop)  # waits for the rest of the long one
    assert core.state().mode == wire.LAND_MODE_IDLE
    core.now += 20
    core.raw(b"\x00")
    assert core.state().mode == wire.LAND_MODE_ESTOP


def test_the_gap_counts_from_20_ms_on(core):
    for gap, mode in ((19, wire.LAND_MODE_IDLE), (20, wire.LAND_MODE_ESTOP)):
        core.hello()
        frame = core.mouth.encode(wire.MAVLink_land_log_message(1, 1, b"x" * 50))
        core.raw(frame[:12] + core.mouth.encode(wire.MAVLink_land_estop_message(7)))
        core.now += gap
        core.raw(b"\x00")
        assert core.state().mode == mode
        core.raw(b"\x00" * 80)


def test_frames_of_another_system_are_not_obeyed(core):
    core.hello()
    from firmware_bridge.dialect.labr_land import MAVLink

    stranger = MAVLink(None, srcSystem=2, srcComponent=COMPUTER)
    core.raw(wire.MAVLink_land_estop_message(1).pack(stranger))
    assert core.state().mode == wire.LAND_MODE_IDLE


def test_what_only_a_controller_says_is_not_answered(core):
    core.hello()
    core.step(20)
    core.say(wire.MAVLink_land_ack_message(0, 1, 2, 0))
    assert core.step(1) == []


def test_bytes_are_given_in_pieces(core):
    core.hello()
    core.core.step(GROUND, core.now + 20)
    pieces = []
    while piece := core.core.take(5):
        pieces.append(piece)
    assert {len(p) for p in pieces[:-1]} == {5}
    assert [r.message.get_type() for r in core.ear.feed(b"".join(pieces), 9.0)] == ["LAND_STATE"]


def test_a_token_lives_for_five_seconds(core):
    for wait_ms, result in ((4996, wire.LAND_RESULT_OK), (4997, wire.LAND_RESULT_UNKNOWN)):
        core.say(wire.MAVLink_land_estop_message(1))
        core.hello()
        core.say(wire.MAVLink_land_estop_release_message(core.session, 0, 1, 1))
        token = next(m.token for m in core.step() if m.get_type() == "LAND_ACK" and m.token)
        core.step(wait_ms)
        core.say(wire.MAVLink_land_estop_release_message(core.session, token, 2, 2))
        assert next(m.result for m in core.step() if m.get_type() == "LAND_ACK") == result
    core.say(wire.MAVLink_land_estop_release_message(core.session, 0, 3, 1))
    assert next(m.token for m in core.step() if m.get_type() == "LAND_ACK") not in (0, token)


def token_of_a_stop(core) -> int:
    core.say(wire.MAVLink_land_estop_message(1))
    core.hello()
    core.say(wire.MAVLink_land_estop_release_message(core.session, 0, 1, 1))
    return next(m.token for m in core.step() if m.get_type() == "LAND_ACK" and m.token)


def test_a_token_is_judged_at_once_and_not_with_the_next_step(core):
    token = token_of_a_stop(core)
    core.now += 5000
    core.say(wire.MAVLink_land_estop_release_message(core.session, token, 2, 2))
    assert core.state().mode == wire.LAND_MODE_ESTOP


def test_an_old_token_does_not_look_young_when_the_counter_wraps(core):
    """24.9 days after the question: half the counter's range, where its differences change their sign."""
    token = token_of_a_stop(core)
    core.step(6000)
    core.step(2**31)
    core.say(wire.MAVLink_land_estop_release_message(core.session, token, 2, 2))
    assert core.state().mode == wire.LAND_MODE_ESTOP


def test_the_age_of_a_command_stops_at_its_field(core):
    core.engage()
    assert core.state().command_age < 100
    core.step(65_400)
    core.step(84)
    assert core.state().command_age == 65_528
    core.step(20_000)
    assert core.state().command_age == 65_534


def test_that_it_is_not_engaged_is_believed_of_a_command_that_is_refused_too(core):
    core.engage()
    core.velocity(300)  # it asks for motion all the same
    core.step()
    assert core.duty.braked
    assert core.state().last_result == wire.LAND_RESULT_ENGAGE
    assert core.state().mode == wire.LAND_MODE_IDLE


def test_an_old_command_stays_old_when_the_counter_wraps(core):
    """Two turns of the counter, 99 days, in steps as long as a pause may be."""
    core.engage()
    for _ in range(70):
        core.step(2**27)
        assert core.duty.braked
        assert core.state().command_age == 65_534
    core.hello()
    core.velocity()
    assert core.state().command_age < 100


@pytest.mark.parametrize("jump_ms", [2**31 - 100, 2**31 + 100, 2**32 - 1000])
def test_wheels_stop_however_far_the_clock_jumps(core, jump_ms):
    core.engage()
    core.step(jump_ms)
    assert core.duty.braked


@pytest.mark.parametrize(("early_ms", "stops"), [(10, False), (11, True)])
def test_a_command_may_be_a_moment_early(core, early_ms, stops):
    core.engage()
    core.velocity(300, 1)
    core.now -= early_ms
    core.step(0)
    assert core.duty.braked is stops


def test_time_that_wraps_stops_nothing_and_starts_nothing(core):
    core.now = 2**32 - 150
    core.engage()
    for _ in range(30):
        core.step(4)
    assert not core.duty.braked
    for _ in range(30):
        core.step(4)
    assert core.duty.braked


def test_old_stamps_do_not_look_fresh_when_the_counter_wraps(core):
    """24.9 days without a word: half the counter's range, where its differences change their sign."""
    core.engage()
    core.step(1500)
    core.step(2**31)
    core.step(1000)
    core.velocity()
    core.velocity(300, 1)
    assert core.state().last_result == wire.LAND_RESULT_HEARTBEAT
    assert core.duty.braked


def test_a_sample_at_the_same_time_replaces_the_last_and_many_do_no_harm(core):
    core.hello()
    for k in range(60):  # a clock that goes back, as no port has
        core.step(1, GROUND._replace(left_ticks=k), sampled_ms=5000 - k)
    for k in range(200):
        core.step(1, GROUND._replace(left_ticks=4 * k, right_ticks=-4 * k), sampled_ms=6000 + k)
        core.step(0, GROUND._replace(left_ticks=4 * k, right_ticks=-4 * k), sampled_ms=6000 + k)
    core.now = 7000
    state = [m for m in core.step(0, GROUND, sampled_ms=6200) if m.get_type() == "LAND_STATE"]
    assert not state or state[-1].v == 0


def test_speed_is_measured_over_40_ms_and_ticks_wrap(core):
    core.hello()
    for k in range(100):
        ticks = 2**31 - 100 + 8 * k
        core.step(4, GROUND._replace(left_ticks=ticks, right_ticks=-ticks))
    turn = 1000 * -2 * 0.5 / 0.3
    pins = GROUND._replace(left_ticks=ticks + 40, right_ticks=-ticks - 40)
    state = next(m for m in core.step(20, pins) if m.get_type() == "LAND_STATE")
    assert state.v == 0
    assert state.w == pytest.approx(turn, abs=2)


def test_a_long_line_is_cut(core):
    core.core.log(wire.LAND_SEVERITY_ERROR, "x" * 80)
    (line,) = [m for m in core.step() if m.get_type() == "LAND_LOG"]
    assert line.text == "x" * 50
    assert line.severity == wire.LAND_SEVERITY_ERROR


def test_reports_that_were_missed_are_skipped(core):
    core.step(4)
    assert [m.get_type() for m in core.step(1004)].count("LAND_STATE") == 1
    assert "LAND_STATE" not in [m.get_type() for m in core.step(4)]


def test_extremes_of_the_pins_do_not_leave_their_fields(core):
    wild = Inputs(1e9, -5.0, True, False, 2**40, -(2**40), left_a=1e9, right_a=-1e9)
    core.hello()
    state = next(m for m in core.step(20, wild) if m.get_type() == "LAND_STATE")
    assert (state.battery_mv, state.current_ma) == (65535, 0)
    assert (state.current_left, state.current_right) == (32767, -32768)


def test_calls_without_bytes_do_not_hide_an_idle_gap(core):
    """A port asks every millisecond, and mostly nothing has come."""
    core.hello()
    log = core.mouth.encode(wire.MAVLink_land_log_message(1, 1, b"x" * 50))
    core.raw(log[:12] + core.mouth.encode(wire.MAVLink_land_estop_message(7)))
    for _ in range(25):
        core.now += 1
        core.raw(b"")
    core.raw(b"\x00")
    assert core.state().mode == wire.LAND_MODE_ESTOP


def stalls(core, asked_mmps: int, left_share: float, right_share: float) -> bool:
    """Whether wheels that turn at these shares of what is asked latch a stall within a second."""
    core.hello()
    core.velocity()
    left = right = 0.0
    for k in range(260):
        if k % 5 == 0:
            core.say(wire.MAVLink_land_heartbeat_message(core.session, 0, 0, 1))
            core.velocity(asked_mmps, 1)
        left += 4 * left_share * asked_mmps * 0.004  # 4 ticks a millimetre
        right += 4 * right_share * asked_mmps * 0.004
        for m in core.step(4, GROUND._replace(left_ticks=int(left), right_ticks=int(right))):
            if m.get_type() == "LAND_STATE" and m.faults & wire.LAND_FAULT_WHEEL_STALL:
                return True
    return False


@pytest.mark.parametrize(
    ("asked_mmps", "left", "right", "stalled"),
    [
        (400, 0.15, 1.0, True),
        (400, 1.0, 0.15, True),
        (400, 0.25, 0.25, False),
        (400, -0.5, 1.0, True),
        (-200, 0.15, 1.0, True),
        (-200, 0.5, 1.0, False),
        (110, 0.0, 0.0, True),
        (100, 0.0, 0.0, False),
        (90, 0.0, 0.0, False),
    ],
)
def test_a_wheel_stalls_below_a_fifth_of_more_than_a_tenth_of_a_metre_a_second(
    core, asked_mmps, left, right, stalled
):
    assert stalls(core, asked_mmps, left, right) == stalled


@pytest.mark.parametrize(
    ("asked_mmps", "ratio", "latched"),
    [(400, 1.9, False), (400, 2.1, True), (100, 2.9, False), (100, 3.2, True)],
)
def test_a_wheel_races_at_twice_what_is_asked_and_more_than_0_3_m_per_s(core, asked_mmps, ratio, latched):
    for side in ("left_ticks", "right_ticks"):
        core.hello()
        core.velocity()
        seen, ticks, other = 0, 0.0, 0.0
        for k in range(260):
            if k % 5 == 0:
                core.say(wire.MAVLink_land_heartbeat_message(core.session, 0, 0, 1))
                core.velocity(asked_mmps, 1)
            ticks += 4 * ratio * asked_mmps * 0.004
            other += 4 * asked_mmps * 0.004
            pins = GROUND._replace(left_ticks=int(other), right_ticks=int(other))
            for m in core.step(4, pins._replace(**{side: int(ticks)})):
                if m.get_type() == "LAND_STATE" and k > 30:
                    seen |= m.faults & wire.LAND_FAULT_WHEEL_RUNAWAY
        assert bool(seen) == latched
        core.velocity()
        for _ in range(30):
            core.step(4, GROUND)


@pytest.mark.parametrize(("current_a", "after_ms"), [(15.0, None), (15.01, 600)])
def test_the_current_may_be_at_its_limit_for_ever_and_above_it_for_600_ms(core, current_a, after_ms):
    core.engage()
    left = 0.0
    begun = core.now + 4
    for k in range(300):
        if k % 5 == 0:
            core.say(wire.MAVLink_land_heartbeat_message(core.session, 0, 0, 1))
            core.velocity(300, 1)
        left += 4 * 300 * 0.004
        core.step(4, GROUND._replace(current_a=current_a, left_ticks=int(left), right_ticks=int(left)))
        if core.duty.braked:
            assert core.now - begun == after_ms
            return
    assert after_ms is None


@pytest.mark.parametrize(
    ("silent_ms", "result"), [(1000, wire.LAND_RESULT_OK), (1001, wire.LAND_RESULT_HEARTBEAT)]
)
def test_a_heartbeat_lasts_a_second(core, silent_ms, result):
    core.hello()
    core.say(wire.MAVLink_land_heartbeat_message(core.session, 0, 0, 1))
    core.velocity()
    core.now += silent_ms
    core.velocity(300, 1)
    assert core.state().last_result == result


@pytest.mark.parametrize(
    ("ahead_ms", "result"), [(250, 0), (251, wire.LAND_RESULT_LATE), (1, 0), (0, wire.LAND_RESULT_LATE)]
)
def test_a_deadline_lies_ahead_but_not_far(core, ahead_ms, result):
    core.hello()
    core.say(wire.MAVLink_land_velocity_message(core.session, core.now + ahead_ms, 0, 0, 1, 0))
    assert core.state().last_result == result


def test_a_command_drives_up_to_its_deadline_and_up_to_200_ms(core):
    for ahead_ms, until_ms in ((100, 100), (240, 200)):
        core.hello()
        core.velocity()
        core.step(4)
        said = core.now
        core.sequence += 1
        core.say(wire.MAVLink_land_velocity_message(core.session, said + ahead_ms, 300, 0, core.sequence, 1))
        core.step(1)
        while not core.duty.braked:
            driven = core.now
            core.step(1)
        assert driven - said == until_ms


def test_the_same_sequence_again_is_refused_and_half_a_turn_ahead_is_old(core):
    core.hello()
    for sequence, result in (
        (7, 0),
        (7, wire.LAND_RESULT_SEQUENCE),
        (7 + 32768, wire.LAND_RESULT_SEQUENCE),
        (7 + 32767, 0),
    ):
        message = wire.MAVLink_land_velocity_message(core.session, core.now + 200, 0, 0, sequence, 0)
        core.say(message)
        assert core.state().last_result == result


def test_a_token_is_of_its_session(core):
    core.hello()
    core.say(wire.MAVLink_land_estop_message(1))
    core.say(wire.MAVLink_land_estop_release_message(core.session, 0, 1, 1))
    token = next(m.token for m in core.step() if m.get_type() == "LAND_ACK" and m.token)
    core.say(wire.MAVLink_land_hello_message(2, wire.DIALECT_HASH, wire.PROTOCOL))
    core.session = next(m.session for m in core.step() if m.get_type() == "LAND_IDENTITY")
    core.say(wire.MAVLink_land_estop_release_message(core.session, token, 2, 2))
    assert core.state().mode == wire.LAND_MODE_ESTOP


def test_a_new_stop_spends_the_token_of_the_last(core):
    core.hello()
    core.say(wire.MAVLink_land_estop_message(1))
    core.say(wire.MAVLink_land_estop_release_message(core.session, 0, 1, 1))
    token = next(m.token for m in core.step() if m.get_type() == "LAND_ACK" and m.token)
    core.say(wire.MAVLink_land_estop_message(2))
    core.say(wire.MAVLink_land_estop_release_message(core.session, token, 2, 2))
    assert core.state().mode == wire.LAND_MODE_ESTOP
