"""What every land controller does, be it the Python twin, the C core or the image in QEMU: one suite."""

from __future__ import annotations

import random

import pytest
from land_bench import PARAMETERS

from firmware_bridge.dialect import labr_land as wire
from firmware_bridge.link import CONTROLLER, Link, text_of
from firmware_bridge.parameters import TICKS_PER_M
from firmware_bridge.version import FIRMWARE

OK = wire.LAND_RESULT_OK
BRAKED = wire.LAND_STATUS_BRAKED


# -- who answers ---------------------------------------------------------------------------------------


def test_it_says_who_it_is(bench):
    who = bench.hello()
    major, minor, patch = FIRMWARE
    assert (who.protocol, who.dialect_hash) == (wire.PROTOCOL, wire.DIALECT_HASH)
    assert who.firmware == major << 16 | minor << 8 | patch
    assert who.session != 0
    assert who.nonce == 1
    assert len(text_of(who.serial)) == 24
    assert int(text_of(who.serial), 16) > 0


def test_the_repeated_hello_keeps_the_session_and_another_one_ends_it(bench):
    first = bench.hello(nonce=5).session
    assert bench.hello(nonce=5).session == first
    assert bench.hello(nonce=6).session not in (0, first)


@pytest.mark.parametrize("stranger", [{"dialect": 0x12345678}, {"protocol": wire.PROTOCOL + 1}])
def test_another_dialect_gets_the_identity_but_no_session(bench, stranger):
    bench.moving()
    who = bench.hello(nonce=9, **stranger)
    assert who.session == 0
    assert (who.protocol, who.dialect_hash) == (wire.PROTOCOL, wire.DIALECT_HASH)
    bench.until(lambda: bench.duty.braked and bench.state.mode == wire.LAND_MODE_WAITING, "stop")


def test_telemetry_at_50_hz_and_heartbeat_at_10_hz(bench):
    bench.hello()
    bench.run(1.5)
    for name, period_ms in (("LAND_STATE", 20), ("LAND_HEARTBEAT", 100)):
        times = [m.time_ms for m in bench.of(name)]
        assert (times[-1] - times[0]) / (len(times) - 1) == pytest.approx(period_ms, rel=0.1)


def test_time_synchronisation_returns_both_times(bench):
    bench.hello()
    bench.say(wire.MAVLink_land_timesync_message(123_456_789_000, 0))
    answer = bench.next("LAND_TIMESYNC")
    assert answer.computer_us == 123_456_789_000
    assert abs(answer.controller_us / 1000 - bench.state.time_ms) < 500
    bench.say(wire.MAVLink_land_timesync_message(5, 7))  # an answer is not answered
    bench.run(0.2)
    assert len(bench.of("LAND_TIMESYNC")) == 1


# -- driving -------------------------------------------------------------------------------------------


def test_it_drives_what_it_is_told_and_counts_what_it_drove(bench):
    bench.moving(0.4, 0.5)
    before = bench.next("LAND_STATE")
    bench.drive(0.4, 0.5, 0.5)
    after = bench.state
    assert 1e-3 * after.v == pytest.approx(0.4, abs=0.04)
    assert 1e-3 * after.w == pytest.approx(0.5, abs=0.2)
    left, right = (after.ticks_left - before.ticks_left), (after.ticks_right - before.ticks_right)
    span_s = 1e-3 * (after.time_ms - before.time_ms)
    assert 0.5 * (left + right) / TICKS_PER_M / span_s == pytest.approx(0.4, abs=0.03)
    assert (right - left) / TICKS_PER_M / PARAMETERS.track / span_s == pytest.approx(0.5, abs=0.12)
    assert after.mode == wire.LAND_MODE_ENGAGED
    assert after.faults == 0
    assert after.status == wire.LAND_STATUS_ENGAGED | wire.LAND_STATUS_WHEEL_LOAD
    assert after.duty_left == pytest.approx(1000 * bench.duty.left, abs=60)
    assert after.battery_mv == 18_500
    assert 0 < after.current_left < 4000


def test_both_wheels_turn_back_for_a_command_backward(bench):
    bench.engage()
    bench.drive_until(lambda: bench.state.v < -80, "speed backward", -0.15)
    assert bench.rover.state.left_ticks < 0
    assert bench.rover.state.right_ticks < 0
    assert bench.duty.left < 0.0


def test_a_wheel_ramps_up(bench):
    bench.engage()
    worst = 0.0
    while bench.rover.state.left_wheel_mps < 0.5:
        before, then_s = bench.rover.state.left_wheel_mps, bench.tier.now_s()
        bench.command(0.7)
        bench.run(0.1)
        gain = (bench.rover.state.left_wheel_mps - before) / (bench.tier.now_s() - then_s)
        worst = max(worst, gain)
    assert worst < 1.5 * PARAMETERS.acceleration


def test_the_current_of_a_blocked_wheel_is_limited(bench):
    bench.engage()
    bench.blocked = True
    seen = len(bench.of("LAND_STATE"))
    bench.drive(0.8, 0.0, 0.55)
    amps = [1e-3 * m.current_left for m in bench.of("LAND_STATE")[seen:]]
    assert max(amps) > 0.8 * PARAMETERS.wheel_current  # without the limit 12 A
    assert max(amps) < 1.25 * PARAMETERS.wheel_current


# -- deny by default -----------------------------------------------------------------------------------


def test_without_a_hello_nothing_turns(bench):
    bench.until(lambda: bench.map.known, "telemetry")
    for session in (0, 1, 77):
        bench.say(bench.velocity(engaged=False, session=session))
        assert bench.refusal(bench.velocity(0.3, session=session)) == wire.LAND_RESULT_SESSION
    assert bench.state.mode == wire.LAND_MODE_WAITING
    assert bench.state.command_age == 65535
    assert bench.moved_s < 0.0


REFUSED = {
    "another session": ({"session": 1}, {}, wire.LAND_RESULT_SESSION),
    "repeated": ({"cmd_seq": 0}, {}, wire.LAND_RESULT_SEQUENCE),
    "half a turn ahead": ({"cmd_seq": 32_800}, {}, wire.LAND_RESULT_SEQUENCE),
    "late": ({"deadline_ms": -1000}, {}, wire.LAND_RESULT_LATE),
    "far deadline": ({"deadline_ms": +1000}, {}, wire.LAND_RESULT_LATE),
    "too fast": ({}, {"v": 1.001}, wire.LAND_RESULT_RANGE),
    "too fast back": ({}, {"v": -0.251}, wire.LAND_RESULT_RANGE),
    "too fast left": ({}, {"w": 1.876}, wire.LAND_RESULT_RANGE),
    "too fast right": ({}, {"w": -1.876}, wire.LAND_RESULT_RANGE),
    "not engaged": ({}, {"engaged": False}, wire.LAND_RESULT_ENGAGE),
    "in the air": ({}, {"air_lock": True}, wire.LAND_RESULT_AIR),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_command_is_refused_with_its_reason(bench, name):
    changes, options, result = REFUSED[name]
    bench.engage()
    changes = dict(changes)
    if "deadline_ms" in changes:
        changes["deadline_ms"] = (
            changes["deadline_ms"] + bench.map.controller_ms(bench.tier.now_s())
        ) % 2**32
    accepted = bench.state.cmd_seq
    bench.beat()
    assert bench.refusal(bench.velocity(**({"v": 0.3} | options), **changes)) == result
    bench.next("LAND_STATE")
    state = bench.next("LAND_STATE")
    assert state.last_result == result
    assert state.cmd_seq == accepted
    assert bool(state.faults & wire.LAND_FAULT_COMMAND_REFUSED) == (result != wire.LAND_RESULT_SESSION)
    assert bench.moved_s < 0.0


@pytest.mark.parametrize(
    ("pins", "result"),
    [
        ({"wheel_load": False}, wire.LAND_RESULT_LOAD),
        ({"rotors_possible": True}, wire.LAND_RESULT_ROTORS),
    ],
)
def test_the_robots_pins_brake_and_refuse(bench, pins, result):
    bench.moving()
    bench.pins = pins
    bench.until(lambda: bench.duty.braked, "brake")
    bench.beat()
    assert bench.refusal(bench.velocity(0.3)) == result
    bench.pins = {}
    bench.drive_until(lambda: not bench.duty.braked, "a bounce is over")


def test_an_engaged_command_needs_a_disengaged_one_first(bench):
    bench.hello()
    bench.beat()
    assert bench.refusal(bench.velocity(0.3)) == wire.LAND_RESULT_ENGAGE
    bench.drive(0.3, 0.0, 0.1)
    assert bench.moved_s < 0.0


def test_the_watchdog_bites_after_200_ms(bench):
    bench.moving()
    seen = len(bench.of("LAND_STATE"))
    bench.until(lambda: bench.duty.braked, "watchdog")
    states = bench.of("LAND_STATE")[seen:]
    rolling = [m.command_age for m in states if not m.status & BRAKED]
    assert max(rolling) <= 200
    assert max(rolling) >= 150, "it must not bite early"
    bench.until(lambda: bench.state.faults & wire.LAND_FAULT_COMMAND_TIMEOUT, "its word")
    bench.drive_until(lambda: not bench.duty.braked, "a fresh command drives on")
    bench.next("LAND_STATE")
    assert not bench.state.faults & wire.LAND_FAULT_COMMAND_TIMEOUT


def test_a_nearer_deadline_wins_over_the_watchdog(bench):
    bench.moving()
    deadline = bench.map.controller_ms(bench.tier.now_s()) + 80
    bench.say(bench.velocity(0.4, deadline_ms=deadline))
    bench.until(lambda: bench.state.cmd_seq == bench.sequence, "accepted")
    bench.until(lambda: bench.duty.braked, "deadline")
    rolling = [m.time_ms for m in bench.of("LAND_STATE") if not m.status & BRAKED]
    assert rolling[-1] <= deadline


def test_a_disengaged_heartbeat_stops_at_once_and_silence_disengages(bench):
    bench.moving()
    bench.beat(engaged=False)
    bench.until(lambda: bench.duty.braked, "stop")
    bench.drive_until(lambda: not bench.duty.braked, "driving again")
    begun_ms = bench.state.time_ms
    while not bench.state.faults & wire.LAND_FAULT_HEARTBEAT_LOST:
        assert bench.state.time_ms - begun_ms < 2500
        bench.say(bench.velocity(0.4))  # commands, but no heartbeat
        bench.run(0.02)
    assert bench.duty.braked
    assert bench.state.time_ms - begun_ms > 850
    bench.beat()
    assert bench.refusal(bench.velocity(0.3)) == wire.LAND_RESULT_ENGAGE


def test_heartbeats_of_another_session_do_not_count(bench):
    bench.moving()
    while not bench.state.faults & wire.LAND_FAULT_HEARTBEAT_LOST:
        bench.beat(session=bench.session ^ 1)
        bench.say(bench.velocity(0.4))
        bench.run(0.02)
        assert bench.state.time_ms < 60_000
    assert bench.duty.braked


def test_the_air_lock_brakes_and_lasts_until_it_is_taken_off(bench):
    bench.moving()
    bench.say(bench.velocity(air_lock=True, engaged=False))
    bench.until(lambda: bench.duty.braked and bench.state.mode == wire.LAND_MODE_AIR, "air lock")
    assert bench.state.status & wire.LAND_STATUS_AIR_LOCK
    bench.drive_until(lambda: not bench.duty.braked, "taken off")


def test_an_air_lock_is_believed_in_a_command_that_is_refused(bench):
    bench.moving()
    assert bench.refusal(bench.velocity(5.0, air_lock=True)) == wire.LAND_RESULT_RANGE
    bench.until(lambda: bench.state.mode == wire.LAND_MODE_AIR, "air lock")
    assert bench.duty.braked


# -- emergency stop ------------------------------------------------------------------------------------


def release(bench, step: int, token: int = 0, session: int | None = None):
    bench.sequence = (bench.sequence + 1) & 0xFFFF
    message = wire.MAVLink_land_estop_release_message(
        bench.session if session is None else session, token, bench.sequence, step
    )
    return bench.ask(message, wire.MAVLINK_MSG_ID_LAND_ESTOP_RELEASE)


def press(bench) -> None:
    bench.sequence = (bench.sequence + 1) & 0xFFFF
    ack = bench.ask(wire.MAVLink_land_estop_message(bench.sequence), wire.MAVLINK_MSG_ID_LAND_ESTOP)
    assert ack.result == OK
    bench.until(lambda: bench.state.mode == wire.LAND_MODE_ESTOP, "emergency stop")


def test_the_emergency_stop_ends_in_two_steps(bench):
    bench.moving()
    press(bench)
    assert bench.duty.braked
    assert bench.state.faults & wire.LAND_FAULT_ESTOP
    assert text_of(bench.of("LAND_LOG")[-1].text) == "emergency stop latched by command"
    press(bench)
    assert len(bench.of("LAND_LOG")) == 1
    bench.say(bench.velocity(engaged=False))
    bench.beat()
    assert bench.refusal(bench.velocity(0.3)) == wire.LAND_RESULT_ESTOP
    assert release(bench, 2, token=1234).result == wire.LAND_RESULT_UNKNOWN
    assert release(bench, 1, session=1).result == wire.LAND_RESULT_SESSION
    token = release(bench, 1).token
    assert token != 0
    assert release(bench, 1).token == token  # a repeated question
    assert release(bench, 2, token ^ 1).result == wire.LAND_RESULT_UNKNOWN
    assert release(bench, 2, token).result == wire.LAND_RESULT_UNKNOWN  # a wrong one spends the right one
    token = release(bench, 1).token
    assert release(bench, 2, token).result == OK
    bench.until(lambda: bench.state.mode == wire.LAND_MODE_IDLE, "idle")
    bench.beat()
    assert bench.refusal(bench.velocity(0.3)) == wire.LAND_RESULT_ENGAGE
    assert release(bench, 1).result == wire.LAND_RESULT_UNKNOWN
    assert release(bench, 3).result == wire.LAND_RESULT_UNKNOWN


def test_anybody_may_stop_it(bench):
    bench.until(lambda: bench.map.known, "telemetry")
    press(bench)
    assert bench.duty.braked


def test_the_button_stops_and_no_release_counts_while_it_is_pressed(bench):
    bench.moving()
    bench.pins = {"estop_pressed": True}
    bench.until(lambda: bench.state.mode == wire.LAND_MODE_ESTOP, "button")
    assert bench.duty.braked
    token = release(bench, 1).token
    bench.run(0.1)
    assert release(bench, 2, token).result == wire.LAND_RESULT_UNKNOWN
    bench.pins = {}
    for _ in range(10):  # the pin is read some time after it was let go
        bench.run(0.1)
        if release(bench, 2, release(bench, 1).token).result == OK:
            return
    raise AssertionError("not released")


def test_a_reset_ends_the_session_but_not_the_emergency_stop(bench):
    boots = bench.hello().boot_count
    press(bench)
    bench.tier.reset()
    bench.map.reset()
    bench.session = 0
    who = bench.hello(nonce=2)
    assert who.boot_count == boots + 1
    bench.until(lambda: bench.state.mode == wire.LAND_MODE_ESTOP, "still stopped")


def test_a_reset_while_driving_stands_until_it_is_engaged_anew(bench):
    bench.moving()
    bench.tier.reset()
    reset_s = bench.tier.now_s()
    bench.map.reset()
    for _ in range(10):
        bench.say(bench.velocity(0.4))  # the computer has not noticed
        bench.run(0.05)
    assert bench.duty.braked
    assert bench.moved_s < reset_s + 0.15
    bench.hello(nonce=2)
    bench.beat()
    assert bench.refusal(bench.velocity(0.3)) == wire.LAND_RESULT_ENGAGE


# -- wheels that misbehave -----------------------------------------------------------------------------


def drive_into(bench, fault: int) -> float:
    """Drive until a fault latches; after how long [s], by the controller's clock."""
    begun_ms = bench.state.time_ms
    bench.drive_until(lambda: bench.state.faults & fault, "fault")
    assert bench.duty.braked
    bench.beat()
    assert bench.refusal(bench.velocity(0.3)) == wire.LAND_RESULT_ENGAGE
    took_s = 1e-3 * (next(m for m in bench.of("LAND_STATE") if m.faults & fault).time_ms - begun_ms)
    bench.say(bench.velocity(engaged=False))
    bench.until(lambda: not bench.state.faults & fault, "cleared by a disengaged command")
    return took_s


def test_a_stalled_wheel_latches(bench):
    bench.engage()
    bench.blocked = True
    assert 0.6 <= drive_into(bench, wire.LAND_FAULT_WHEEL_STALL) < 1.2


def test_a_wheel_that_turns_three_times_too_fast_latches(bench):
    """It slips, or its encoder lies: the controller cannot hold it down."""
    bench.moving()
    begun_ms, begun_s, ticks = bench.state.time_ms, bench.tier.now_s(), bench.state.ticks_left
    while not bench.state.faults & wire.LAND_FAULT_WHEEL_RUNAWAY:
        assert bench.tier.now_s() < begun_s + 5.0
        bench.command(0.4)
        for _ in range(5):
            spun = ticks + int(3 * 0.4 * TICKS_PER_M * (bench.tier.now_s() - begun_s))
            bench.pins = {"left_ticks": spun, "right_ticks": spun}
            bench.step()
    assert bench.duty.braked
    assert bench.state.time_ms - begun_ms >= 600


def test_too_high_a_current_latches(bench):
    bench.moving()
    bench.pins = {"current_a": 30.0}
    assert 0.6 <= drive_into(bench, wire.LAND_FAULT_OVERCURRENT) < 1.2


def test_a_drivers_own_fault_latches_at_once(bench):
    bench.moving()
    bench.pins = {"driver_fault": True}
    bench.until(lambda: bench.duty.braked, "brake")
    bench.until(lambda: bench.state.faults & wire.LAND_FAULT_DRIVER, "its word")
    bench.pins = {}
    bench.drive(0.4, 0.0, 0.1)
    assert bench.duty.braked
    bench.say(bench.velocity(engaged=False))
    bench.drive_until(lambda: not bench.duty.braked, "cleared by a disengaged command")


def test_a_low_battery_is_told_and_does_not_stop(bench):
    bench.moving()
    bench.pins = {"battery_v": 14.5}
    bench.drive_until(lambda: bench.state.faults & wire.LAND_FAULT_BATTERY_LOW, "its word")
    assert not bench.duty.braked


# -- parameters ----------------------------------------------------------------------------------------


def write(bench, name: bytes, value: float, session: int | None = None) -> int:
    bench.sequence = (bench.sequence + 1) & 0xFFFF
    message = wire.MAVLink_land_param_write_message(
        bench.session if session is None else session, value, bench.sequence, name
    )
    return bench.ask(message, wire.MAVLINK_MSG_ID_LAND_PARAM_WRITE).result


def read(bench, index: int = 0, name: bytes = b""):
    bench.sequence = (bench.sequence + 1) & 0xFFFF
    seen = len(bench.of("LAND_PARAM"))
    message = wire.MAVLink_land_param_read_message(bench.sequence, index, name)
    result = bench.ask(message, wire.MAVLINK_MSG_ID_LAND_PARAM_READ).result
    if result != OK:
        return result
    bench.until(lambda: len(bench.of("LAND_PARAM")) > seen, "value")
    return bench.of("LAND_PARAM")[-1]


def test_a_limit_that_was_written_may_be_driven_itself(bench):
    bench.hello(bench.nonce)
    for name in (b"speed", b"reverse", b"yaw_rate"):
        assert write(bench, name, 0.7) == OK  # a little less in single precision
    bench.engage()
    for v, w in ((0.701, 0.0), (-0.701, 0.0), (0.0, 0.701), (0.0, -0.701)):
        assert bench.refusal(bench.velocity(v, w)) == wire.LAND_RESULT_RANGE
    for v, w in ((0.7, 0.7), (-0.7, -0.7)):
        bench.say(bench.velocity(v, w))
        bench.until(lambda: bench.state.cmd_seq == bench.sequence, "obeyed")
        assert bench.state.last_result == OK


def test_parameters_are_those_of_the_robot(bench):
    bench.hello()
    names = PARAMETERS.names()
    for index, name in enumerate(names):
        by_index, by_name = read(bench, index), read(bench, 999, name.encode())
        assert text_of(by_index.name) == text_of(by_name.name) == name
        assert (by_index.index, by_index.count) == (index, len(names))
        assert by_index.value == by_name.value == pytest.approx(PARAMETERS.get(name), rel=1e-6)
    assert read(bench, len(names)) == wire.LAND_RESULT_UNKNOWN
    assert read(bench, 0, b"colour") == wire.LAND_RESULT_UNKNOWN
    assert read(bench, 0, b"tracks") == wire.LAND_RESULT_UNKNOWN


def test_a_parameter_is_written_and_used(bench):
    bench.engage()
    assert write(bench, b"track", 0.6) == OK
    assert read(bench, 0, b"track").value == pytest.approx(0.6)
    bench.drive_until(lambda: bench.state.w > 300, "a turn", 0.0, 0.5)
    bench.drive(0.0, 0.5, 0.5)
    turning = bench.rover.state.right_wheel_mps - bench.rover.state.left_wheel_mps
    assert turning == pytest.approx(0.5 * 0.6, rel=0.25)  # twice as much as with 0.3 m
    assert 1e-3 * bench.state.w == pytest.approx(0.5, rel=0.25)
    assert write(bench, b"track", 0.3) == wire.LAND_RESULT_BUSY


def test_parameters_outlive_a_reset(bench):
    bench.hello()
    assert write(bench, b"track", 0.45) == OK
    bench.run(0.1)
    bench.tier.reset()
    bench.map.reset()
    bench.hello(nonce=2)
    assert read(bench, 0, b"track").value == pytest.approx(0.45)


def test_a_parameter_is_refused_with_its_reason(bench):
    bench.hello()
    assert write(bench, b"colour", 1.0) == wire.LAND_RESULT_UNKNOWN
    assert write(bench, b"track", 0.01) == wire.LAND_RESULT_RANGE
    assert write(bench, b"track", 2.5) == wire.LAND_RESULT_RANGE
    assert write(bench, b"track", float("nan")) == wire.LAND_RESULT_RANGE
    assert write(bench, b"track", 0.4, session=1) == wire.LAND_RESULT_SESSION
    assert read(bench, 0, b"track").value == pytest.approx(0.3)


# -- a damaged wire ------------------------------------------------------------------------------------


def test_frames_of_others_are_not_obeyed(bench):
    bench.hello()
    stranger = Link(CONTROLLER)
    bench.tier.write(stranger.encode(wire.MAVLink_land_estop_message(1)))
    bench.run(0.2)
    assert bench.state.mode == wire.LAND_MODE_IDLE


def test_noise_turns_no_wheel_and_at_most_one_good_frame_is_lost_after_it(bench):
    bench.engage()
    rng = random.Random(4)
    for k in range(25):
        bench.tier.write(rng.randbytes(rng.randint(1, 300)))
        bench.run(0.004)
        if k % 5 == 4:  # the burst is over: of two frames one must arrive
            bench.run(0.03)
            before = bench.state.rx_good
            for _ in range(2):
                bench.say(bench.velocity(engaged=False))
                bench.run(0.03)
            bench.until(lambda: bench.state.cmd_seq == bench.sequence, "the second frame")
            assert (bench.state.rx_good - before) % 65536 >= 1
    assert bench.moved_s < 0.0
    assert bench.state.rx_bad < 65535
    bench.engage()  # there were no heartbeats meanwhile
    bench.drive_until(lambda: not bench.duty.braked, "driving after the noise")


def test_a_frame_behind_a_false_start_counts_after_a_pause(bench):
    bench.hello()
    long = bench.link.encode(wire.MAVLink_land_log_message(1, 1, b"x" * 50))
    bench.tier.write(long[:12] + bench.link.encode(wire.MAVLink_land_estop_message(7)))
    bench.run(0.1)  # what waits for its end will not get it
    bench.say(wire.MAVLink_land_timesync_message(1, 0))
    bench.until(lambda: bench.state.mode == wire.LAND_MODE_ESTOP, "the frame behind it")


def test_lost_frames_are_counted(bench):
    bench.hello()
    bench.next("LAND_STATE")
    before = bench.next("LAND_STATE").rx_lost
    for k in range(10):
        frame = bench.link.encode(bench.velocity(engaged=False))
        if k not in (3, 4, 7):
            bench.tier.write(frame)
        bench.run(0.02)
    bench.until(lambda: bench.state.cmd_seq == bench.sequence, "the last one")
    assert bench.state.rx_lost - before == 3
