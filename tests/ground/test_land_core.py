"""The controller's decisions on a simulated clock: deny by default."""

from __future__ import annotations

import itertools
import random

import pytest

from firmware_bridge.dialect import labr_land as wire
from firmware_bridge.parameters import Parameters
from firmware_bridge.pins import Inputs
from labr_autonomy.config import RobotConfig
from sim import land_core as core
from sim.land_core import Command, State

P = Parameters.of(RobotConfig())
GROUND = Inputs(19.0, 2.0, wheel_load=True, rotors_possible=False, left_ticks=0, right_ticks=0)
NOW = 50_000
OK = wire.LAND_RESULT_OK


def fresh_session(now_ms: int = NOW) -> State:
    s = core.on_hello(State(), 7, wire.PROTOCOL, wire.DIALECT_HASH, now_ms)
    return core.tick(s, GROUND, P, now_ms, 0.004)


def command(s: State, sequence: int, v: int = 400, now_ms: int = NOW, **changes) -> Command:
    plain = Command(s.session, (now_ms + 200) % 2**32, v, 0, sequence, engaged=True, air_lock=False)
    return plain._replace(**changes)


def say(s: State, c: Command, now_ms: int = NOW) -> State:
    return core.on_velocity(s, c, P, now_ms)


def neutral(s: State, sequence: int = 1, now_ms: int = NOW) -> State:
    return say(s, command(s, sequence, v=0, now_ms=now_ms, engaged=False), now_ms)


def driving(now_ms: int = NOW) -> State:
    s = neutral(fresh_session(now_ms), 1, now_ms)
    s = say(s, command(s, 2, now_ms=now_ms), now_ms)
    s = core.tick(s, GROUND, P, now_ms + 4, 0.004)
    assert not s.drive.braked
    return s


def tick(s: State, now_ms: int, inputs: Inputs = GROUND) -> State:
    return core.tick(s, inputs, P, now_ms, 0.004)


def test_without_a_hello_nothing_is_obeyed():
    s = tick(State(), NOW)
    for session in (0, 1):
        s = say(s, command(s, 1, session=session, v=0, engaged=False))
        s = tick(say(s, command(s, 2, session=session)), NOW)
        assert s.drive.braked
        assert s.mode == wire.LAND_MODE_WAITING


CONDITIONS = {
    "session": lambda s: s._replace(session=0),
    "engaged": lambda s: s._replace(engaged=False),
    "fresh": lambda s: s._replace(accepted_ms=NOW - 196),  # 200 ms old at NOW + 4, and 204 ms at NOW + 8
    "deadline": lambda s: s._replace(deadline_ms=NOW + 7),
    "estop": core.on_estop,
    "air lock": lambda s: s._replace(air_lock=True),
    "heartbeat": lambda s: s._replace(heartbeat_ms=NOW - 993),
    "stall": lambda s: s._replace(faults=wire.LAND_FAULT_WHEEL_STALL),
    "runaway": lambda s: s._replace(faults=wire.LAND_FAULT_WHEEL_RUNAWAY),
    "current": lambda s: s._replace(faults=wire.LAND_FAULT_OVERCURRENT),
}


@pytest.mark.parametrize("name", CONDITIONS)
def test_each_missing_condition_brakes_at_once(name):
    assert not tick(driving(), NOW + 8).drive.braked
    assert tick(CONDITIONS[name](driving()), NOW + 8).drive == core.Drive()


@pytest.mark.parametrize(("load", "rotors"), [(False, False), (False, True), (True, True)])
def test_wheels_stand_without_load_or_with_rotors(load, rotors):
    inputs = GROUND._replace(wheel_load=load, rotors_possible=rotors)
    assert tick(driving(), NOW + 8, inputs).drive.braked
    assert not tick(tick(driving(), NOW + 8, inputs), NOW + 12).drive.braked  # a bounce is over


def test_motion_only_if_every_condition_holds():
    """Every combination of eight conditions: one of 256 may move."""
    may = 0
    for bits in itertools.product((True, False), repeat=8):
        session, engaged, moving, calm, ground, load, rotors_off, sound = bits
        s = State(
            session=5 * session,
            engaged=engaged,
            moving=moving,
            estop=not calm,
            air_lock=not ground,
            wheel_load=load,
            rotors=not rotors_off,
            faults=0 if sound else wire.LAND_FAULT_WHEEL_STALL,
        )
        may += core.may_move(s)
        assert core.may_move(s) == all(bits)
    assert may == 1


REFUSALS = {
    "other session": ({"session": 1}, wire.LAND_RESULT_SESSION),
    "repeated": ({"sequence": 2}, wire.LAND_RESULT_SEQUENCE),
    "older": ({"sequence": 1}, wire.LAND_RESULT_SEQUENCE),
    "half a turn ahead": ({"sequence": 2 + 32768}, wire.LAND_RESULT_SEQUENCE),
    "late": ({"deadline_ms": NOW}, wire.LAND_RESULT_LATE),
    "far deadline": ({"deadline_ms": NOW + 251}, wire.LAND_RESULT_LATE),
    "fast": ({"v_mmps": 1001}, wire.LAND_RESULT_RANGE),
    "fast back": ({"v_mmps": -251}, wire.LAND_RESULT_RANGE),
    "fast left": ({"w_mradps": 1876}, wire.LAND_RESULT_RANGE),
    "fast right": ({"w_mradps": -1876}, wire.LAND_RESULT_RANGE),
    "not engaged": ({"engaged": False}, wire.LAND_RESULT_ENGAGE),
    "in the air": ({"air_lock": True}, wire.LAND_RESULT_AIR),
}


@pytest.mark.parametrize("name", REFUSALS)
def test_a_refused_command_neither_moves_nor_feeds_the_watchdog(name):
    changes, result = REFUSALS[name]
    s = driving()
    after = say(s, command(s, 3, v=800)._replace(**changes))
    assert after.last_result == result
    assert (after.v_mmps, after.accepted_ms, after.sequence) == (s.v_mmps, s.accepted_ms, s.sequence)


@pytest.mark.parametrize(("v", "w"), [(1000, 0), (-250, 0), (0, 1875), (0, -1875)])
def test_the_limits_themselves_are_allowed(v, w):
    s = driving()
    assert say(s, command(s, 3, v=v, w_mradps=w)).last_result == OK


def test_refused_because_of_the_robot():
    for inputs, result in (
        (GROUND._replace(wheel_load=False), wire.LAND_RESULT_LOAD),
        (GROUND._replace(rotors_possible=True), wire.LAND_RESULT_ROTORS),
    ):
        s = tick(driving(), NOW + 8, inputs)
        assert say(s, command(s, 3)).last_result == result
        assert say(s, command(s, 3, v=0)).last_result == OK  # standing is always fine
    s = core.on_estop(driving())
    assert say(s, command(s, 3)).last_result == wire.LAND_RESULT_ESTOP
    s = driving()._replace(heartbeat_ms=NOW - 1001)
    assert say(s, command(s, 3)).last_result == wire.LAND_RESULT_HEARTBEAT


def test_the_sequence_wraps():
    s = driving()._replace(sequence=65535)
    s = say(s, command(s, 0))
    assert (s.last_result, s.sequence) == (OK, 0)


def test_times_wrap():
    start = 2**32 - 100
    s = driving(start)
    assert not tick(s, (start + 190) % 2**32).drive.braked
    assert tick(s, (start + 210) % 2**32).drive.braked


def test_an_engaged_command_needs_a_disengaged_one_first():
    s = fresh_session()
    refused = say(s, command(s, 1))
    assert refused.last_result == wire.LAND_RESULT_ENGAGE
    assert tick(refused, NOW + 4).drive.braked
    s = neutral(refused, 2)
    assert say(s, command(s, 3)).engaged


def test_a_new_session_ends_the_old_one():
    s = driving()
    new = core.on_hello(s, 8, wire.PROTOCOL, wire.DIALECT_HASH, NOW)
    assert new.session not in (0, s.session)
    assert tick(new, NOW + 8).drive.braked
    assert say(new, command(s, 3)).last_result == wire.LAND_RESULT_SESSION
    assert say(new, command(new, 1)).last_result == wire.LAND_RESULT_ENGAGE


def test_the_repeated_hello_changes_nothing():
    s = driving()
    assert core.on_hello(s, 7, wire.PROTOCOL, wire.DIALECT_HASH, NOW) == s


@pytest.mark.parametrize(("protocol", "dialect"), [(wire.PROTOCOL + 1, 0), (wire.PROTOCOL, 1)])
def test_a_strangers_hello_opens_no_session_and_stops(protocol, dialect):
    s = core.on_hello(driving(), 9, protocol, dialect or wire.DIALECT_HASH, NOW)
    assert s.session == 0
    assert tick(s, NOW + 8).drive.braked


def test_heartbeat_that_is_not_engaged_stops_and_silence_disengages():
    s = core.on_heartbeat(driving(), driving().session, False, NOW)
    assert tick(s, NOW + 8).drive.braked
    s = driving()
    for sequence, at in enumerate(range(NOW + 20, NOW + 1100, 20), start=3):  # commands, but no heartbeat
        s = tick(say(s, command(s, sequence, v=0, now_ms=at), at), at)
    assert s.drive.braked
    assert s.faults & wire.LAND_FAULT_HEARTBEAT_LOST
    s = core.on_heartbeat(s, s.session, True, NOW + 1100)
    assert say(s, command(s, 99, now_ms=NOW + 1100), NOW + 1100).last_result == wire.LAND_RESULT_ENGAGE


def test_watchdog_speaks_and_a_fresh_command_clears_it():
    s = tick(driving(), NOW + 201)
    assert s.faults & wire.LAND_FAULT_COMMAND_TIMEOUT
    s = say(s, command(s, 3, now_ms=NOW + 210), NOW + 210)
    assert s.faults == 0
    assert not tick(s, NOW + 214).drive.braked


def test_emergency_stop_needs_two_steps_and_a_new_engagement():
    s = core.on_estop(driving())
    s, result, token = core.on_release(s, s.session, 2, 1234, NOW)
    assert (result, s.estop) == (wire.LAND_RESULT_UNKNOWN, True)
    s, result, token = core.on_release(s, s.session, 1, 0, NOW)
    assert (result, s.estop) == (OK, True)
    assert core.on_release(s, s.session, 1, 0, NOW + 50)[2] == token  # a repeated question
    assert core.on_release(s, s.session ^ 1, 2, token, NOW)[1] == wire.LAND_RESULT_SESSION
    assert core.on_release(s, s.session, 2, token + 1, NOW)[0].estop
    assert core.on_release(s, s.session, 2, token, NOW + core.TOKEN_MS + 1)[0].estop
    s, result, _ = core.on_release(s, s.session, 2, token, NOW + 100)
    assert (result, s.estop, s.mode) == (OK, False, wire.LAND_MODE_IDLE)
    assert say(s, command(s, 9)).last_result == wire.LAND_RESULT_ENGAGE


def test_an_old_token_does_not_look_young_when_the_counter_wraps():
    s, _, token = core.on_release(core.on_estop(driving()), driving().session, 1, 0, NOW)
    later = (NOW + 2**31 + 100) % 2**32
    s = tick(tick(s, NOW + core.TOKEN_MS + 1), later)
    assert core.on_release(s, s.session, 2, token, later)[0].estop


def test_an_old_command_stays_old_when_the_counter_wraps():
    s, at = driving(), NOW
    for _ in range(70):
        at += 2**27
        s = tick(s, at % 2**32)
        assert s.drive.braked
        assert core.ahead(at % 2**32, s.accepted_ms, 32) == core.AGE_MAX_MS


@pytest.mark.parametrize("jump_ms", [2**31 - 100, 2**31 + 100, 2**32 - 1000])
def test_wheels_stop_however_far_the_clock_jumps(jump_ms):
    s = tick(driving(), (NOW + jump_ms) % 2**32)
    assert s.drive.braked
    assert core.ahead((NOW + jump_ms) % 2**32, s.accepted_ms, 32) == core.AGE_MAX_MS


@pytest.mark.parametrize(("early_ms", "stops"), [(core.EARLY_MS, False), (core.EARLY_MS + 1, True)])
def test_a_command_may_be_a_moment_early(early_ms, stops):
    assert tick(driving(), NOW - early_ms).drive.braked is stops


def test_that_it_is_not_engaged_is_believed_of_a_command_that_is_refused_too():
    s = driving()
    s = say(s, command(s, 3, engaged=False), NOW + 8)  # it asks for motion all the same
    assert s.last_result == wire.LAND_RESULT_ENGAGE
    assert tick(s, NOW + 8).drive.braked
    assert s.mode == wire.LAND_MODE_IDLE
    assert say(s, command(s, 4), NOW + 12).engaged, "engaging needs no more than it did before"


def test_a_stranger_does_not_disengage():
    s = driving()
    assert say(s, command(s, 3, session=s.session ^ 1, engaged=False), NOW + 8).engaged


def test_a_wrong_token_spends_the_right_one():
    s, _, token = core.on_release(core.on_estop(driving()), driving().session, 1, 0, NOW)
    s, _, _ = core.on_release(s, s.session, 2, token ^ 1, NOW)
    assert core.on_release(s, s.session, 2, token, NOW)[0].estop


def keep_commanding(s: State, inputs_at, until_ms: int = 2000) -> tuple[State, int]:
    """Drive on at 50 Hz with 250 Hz ticks; returns the state and when it braked [ms], -1 for never."""
    braked_ms = -1
    for k, at in enumerate(range(NOW + 4, NOW + until_ms, 4)):
        if k % 5 == 0:
            s = core.on_heartbeat(s, s.session, True, at)
            s = say(s, command(s, 3 + k, now_ms=at), at)
        s = tick(s, at, inputs_at(at - NOW))
        if s.drive.braked and braked_ms < 0:
            braked_ms = at - NOW
    return s, braked_ms


@pytest.mark.parametrize(
    ("inputs_at", "fault"),
    [
        (lambda t: GROUND, wire.LAND_FAULT_WHEEL_STALL),
        (lambda t: GROUND._replace(left_ticks=8 * t, right_ticks=8 * t), wire.LAND_FAULT_WHEEL_RUNAWAY),
        (
            lambda t: GROUND._replace(left_ticks=int(1.6 * t), right_ticks=int(1.6 * t), current_a=30.0),
            wire.LAND_FAULT_OVERCURRENT,
        ),
    ],
    ids=["stalled", "races", "current"],
)
def test_wheel_faults_latch_within_a_second_until_a_disengaged_command(inputs_at, fault):
    s, braked_ms = keep_commanding(driving(), inputs_at)
    assert core.LATCH_MS <= braked_ms <= 1000
    assert s.faults & fault
    assert s.drive.braked
    s = neutral(s, 5000, NOW + 2000)
    assert not s.faults & fault


def test_turning_wheels_are_no_fault():
    inputs_at = lambda t: GROUND._replace(left_ticks=int(1.6 * t), right_ticks=int(1.6 * t))  # noqa: E731
    s, braked_ms = keep_commanding(driving(), inputs_at)
    assert (s.faults, braked_ms) == (0, -1)
    assert s.left_mps == pytest.approx(0.4, abs=0.01)


def test_low_battery_is_told_and_does_not_stop():
    s = tick(driving(), NOW + 8, GROUND._replace(battery_v=14.9))
    assert s.faults == wire.LAND_FAULT_BATTERY_LOW
    assert not s.drive.braked


def test_wheels_ramp_up_but_never_ramp_down_in_an_emergency():
    s = driving()
    assert 0.0 < s.drive.left_mps <= P.acceleration * 0.004 + 1e-9
    for k in range(200):
        s = tick(s._replace(accepted_ms=NOW + 4 * k, deadline_ms=NOW + 4 * k + 200), NOW + 4 * k,
                 GROUND._replace(left_ticks=int(1.6 * 4 * k), right_ticks=int(1.6 * 4 * k)))  # fmt: skip
    assert s.drive.left_mps == pytest.approx(0.4)
    assert core.tick(core.on_estop(s), GROUND, P, NOW + 804, 0.004).drive == core.Drive()


def oldest_command_obeyed(seed: int) -> int:
    """Random schedule of everything; returns the greatest age of a command while not braked [ms]."""
    rng = random.Random(seed)
    s, now, sequence = fresh_session(0), 0, 0
    sent: dict[int, int] = {}  # session -> when its last sensible engaged command was said
    oldest = 0
    while now < 4000:
        now += rng.choice((1, 1, 2, 4, 4, 7))
        chance = rng.random()
        if chance < 0.10:
            s = core.on_heartbeat(s, s.session, rng.random() < 0.97, now)
        elif chance < 0.13:
            sequence += 1
            engaged = rng.random() < 0.8
            c = command(s, sequence, v=rng.choice((0, 300, 5000)), now_ms=now, engaged=engaged)
            c = c._replace(v_mmps=c.v_mmps if engaged else 0, sequence=sequence - rng.choice((0, 0, 0, 2)))
            c = c._replace(deadline_ms=now + rng.choice((200, 200, 200, 90, 240, -5, 900)))
            s = say(s, c, now)
            if engaged and c.v_mmps <= 1000 and 0 < c.deadline_ms - now <= 250:
                sent[s.session] = now
        elif chance < 0.1305:
            s = core.on_hello(s, rng.getrandbits(8), wire.PROTOCOL, wire.DIALECT_HASH, now)
        elif chance < 0.1310:
            s = core.on_estop(s)
        elif chance < 0.1400 and s.estop:
            s, _, token = core.on_release(s, s.session, 1, 0, now)
            s, _, _ = core.on_release(s, s.session, 2, token, now)
        inputs = GROUND._replace(wheel_load=rng.random() < 0.99, left_ticks=now, right_ticks=now)
        s = core.tick(s, inputs, P, now, 0.004)
        if not s.drive.braked:
            oldest = max(oldest, now - sent.get(s.session, -(10**9)))
    return oldest


@pytest.mark.slow
def test_never_driven_without_a_command_at_most_200_ms_old():
    ages = [oldest_command_obeyed(seed) for seed in range(8)]
    assert max(ages) <= 200
    assert max(ages) > 190, "the schedules must come near the limit"


@pytest.mark.slow
def test_that_property_would_catch_a_watchdog_of_210_ms(monkeypatch):
    monkeypatch.setattr(core, "COMMAND_MS", 210)
    assert any(oldest_command_obeyed(seed) > 200 for seed in range(8))


def test_parameters_are_checked():
    assert P.written("track", float("nan")) is None
    assert P.written("track", 0.01) is None
    assert P.written("no such", 1.0) is None
    changed = P.written("track", 0.31)
    assert changed is not None
    assert changed.get("track") == 0.31
    assert all(len(name) <= 16 for name in P.names())
