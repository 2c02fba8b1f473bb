"""The land controller's decisions: deny by default, no I/O, no clock, integer milliseconds.

`firmware_bridge/core/land_gate.c` follows it line by line: one state, one function per message, one `tick`.
The wheels turn only while ALL of these hold: a session is open, the computer engaged by going through a
disengaged command first, its heartbeat is alive, the last accepted command is at most 200 ms old and before
its deadline, no emergency stop, no air lock, the wheels carry the robot, the rotors have no power, and no
latched fault. Everything else is braked.
"""

from __future__ import annotations

from typing import NamedTuple

from firmware_bridge.dialect import labr_land as wire
from firmware_bridge.parameters import Parameters
from firmware_bridge.pins import Inputs

COMMAND_MS = 200  # watchdog of a velocity command
DEADLINE_SLACK_MS = 50  # a deadline further ahead than COMMAND_MS + this comes from a wrong clock
HEARTBEAT_MS = 1000
TOKEN_MS = 5000
LATCH_MS = 600  # a wheel or the current must misbehave this long
STALL_MPS, STALL_SHARE = 0.10, 0.2
RUNAWAY_MPS, RUNAWAY_RATIO = 0.30, 2.0
MEASURE_MS = 40  # window of the speed measurement; one tick is 6 mm/s over it
AGE_MAX_MS = 65534  # of a command, in telemetry
NEVER_MS = 65535
EARLY_MS = 10  # a stamp may be this far in the future, no more

_CLEARED_BY_COMMAND = (
    wire.LAND_FAULT_COMMAND_TIMEOUT | wire.LAND_FAULT_COMMAND_REFUSED | wire.LAND_FAULT_HEARTBEAT_LOST
)
_LATCHED = (
    wire.LAND_FAULT_WHEEL_STALL
    | wire.LAND_FAULT_WHEEL_RUNAWAY
    | wire.LAND_FAULT_OVERCURRENT
    | wire.LAND_FAULT_DRIVER
)


class Command(NamedTuple):
    """A velocity command as received."""

    session: int
    deadline_ms: int
    v_mmps: int
    w_mradps: int
    sequence: int
    engaged: bool
    air_lock: bool


class Drive(NamedTuple):
    """What the motor stage is told."""

    left_mps: float = 0.0
    right_mps: float = 0.0
    braked: bool = True


class State(NamedTuple):
    """Everything the controller remembers."""

    boot_count: int = 1
    nonce: int = 0
    session: int = 0  # 0: none
    sessions: int = 0  # opened since boot
    heartbeat_ms: int | None = None
    neutral_seen: bool = False  # a disengaged command came since engaging was last forbidden
    engaged: bool = False
    air_lock: bool = False
    estop: bool = False
    token: int = 0
    token_ms: int = 0
    sequence: int | None = None
    accepted_ms: int | None = None  # when the last command was accepted
    deadline_ms: int = 0
    moving: bool = False  # the last accepted command still counts
    v_mmps: int = 0
    w_mradps: int = 0
    faults: int = 0
    last_result: int = wire.LAND_RESULT_OK
    wheel_load: bool = False
    rotors: bool = True  # unknown until the first tick: assume the worse
    drive: Drive = Drive()
    stalled_ms: int | None = None  # since when
    runaway_ms: int | None = None
    overcurrent_ms: int | None = None
    samples: tuple[tuple[int, int, int], ...] = ()  # (ms, left, right) ticks, oldest first
    left_mps: float = 0.0  # measured
    right_mps: float = 0.0

    @property
    def mode(self) -> int:
        """LAND_MODE of this state."""
        if self.estop:
            return wire.LAND_MODE_ESTOP
        if not self.session:
            return wire.LAND_MODE_WAITING
        if self.air_lock:
            return wire.LAND_MODE_AIR
        return wire.LAND_MODE_ENGAGED if self.engaged else wire.LAND_MODE_IDLE

    @property
    def status(self) -> int:
        """LAND_STATUS flags of this state."""
        return (
            wire.LAND_STATUS_ENGAGED * self.engaged
            | wire.LAND_STATUS_WHEEL_LOAD * self.wheel_load
            | wire.LAND_STATUS_ROTORS * self.rotors
            | wire.LAND_STATUS_AIR_LOCK * self.air_lock
            | wire.LAND_STATUS_BRAKED * self.drive.braked
        )


def _mix(*words: int) -> int:
    """A 32-bit number other than 0 that differs from its neighbours (multiplicative hash)."""
    h = 0x811C9DC5
    for word in words:
        h = ((h ^ (word & 0xFFFFFFFF)) * 0x9E3779B1) & 0xFFFFFFFF
        h ^= h >> 15
    return h or 1


def ahead(later: int, earlier: int, bits: int) -> int:
    """Signed difference of two counters that wrap at `bits` bits."""
    half = 1 << (bits - 1)
    return ((later - earlier + half) & ((1 << bits) - 1)) - half


def young(now_ms: int, stamp_ms: int, limit_ms: int) -> bool:
    """Whether a stamp is at most `limit_ms` old.

    After half a turn of the counter, 24.9 days, a stamp that nobody has touched seems to lie in the future:
    that is not young either.
    """
    return -EARLY_MS <= ahead(now_ms, stamp_ms, 32) <= limit_ms


def disengage(s: State) -> State:
    """Stop, and ask for a disengaged command before the next engaged one."""
    return s._replace(engaged=False, neutral_seen=False, moving=False)


def on_hello(s: State, nonce: int, protocol: int, dialect_hash: int, now_ms: int) -> State:
    """Open a session; the same nonce keeps it, another one ends it, a stranger's dialect opens none."""
    if (protocol, dialect_hash) != (wire.PROTOCOL, wire.DIALECT_HASH):
        return disengage(s)._replace(session=0, nonce=0)
    if s.session and s.nonce == nonce:
        return s
    return disengage(s)._replace(
        nonce=nonce,
        session=_mix(nonce, s.boot_count, s.sessions),
        sessions=s.sessions + 1,
        sequence=None,
        heartbeat_ms=now_ms,
        token=0,
        faults=s.faults & ~_CLEARED_BY_COMMAND,
        last_result=wire.LAND_RESULT_OK,
    )


def on_heartbeat(s: State, session: int, engaged: bool, now_ms: int) -> State:
    """The computer lives. Its word that it is not engaged counts at once, its word that it is does not."""
    if not s.session or session != s.session:
        return s
    s = s._replace(heartbeat_ms=now_ms)
    return s if engaged else s._replace(engaged=False, moving=False)


def on_velocity(s: State, c: Command, p: Parameters, now_ms: int) -> State:
    """Accept or refuse a command; a refused one neither moves the wheels nor feeds the watchdog."""
    if not s.session or c.session != s.session:
        return s._replace(last_result=wire.LAND_RESULT_SESSION)
    if c.air_lock:
        s = s._replace(air_lock=True)  # a restriction is believed even in a command that is refused
    if not c.engaged:
        s = s._replace(engaged=False, moving=False)  # and so is this one
    result = _judge(s, c, p, now_ms)
    if result != wire.LAND_RESULT_OK:
        return s._replace(last_result=result, faults=s.faults | wire.LAND_FAULT_COMMAND_REFUSED)
    faults = s.faults & ~_CLEARED_BY_COMMAND
    if not c.engaged:
        faults &= ~_LATCHED
    return s._replace(
        last_result=result,
        faults=faults,
        sequence=c.sequence,
        accepted_ms=now_ms,
        deadline_ms=c.deadline_ms,
        air_lock=c.air_lock,
        engaged=c.engaged,
        neutral_seen=s.neutral_seen or not c.engaged,
        moving=c.engaged,
        v_mmps=c.v_mmps,
        w_mradps=c.w_mradps,
    )


def _judge(s: State, c: Command, p: Parameters, now_ms: int) -> int:
    """LAND_RESULT for a command of the open session."""
    left = ahead(c.deadline_ms, now_ms, 32)
    asks_motion = bool(c.v_mmps or c.w_mradps)
    # The order matters where several hold: what is wrong with the command, then what is wrong with the robot.
    checks = (
        (s.sequence is not None and ahead(c.sequence, s.sequence, 16) <= 0, wire.LAND_RESULT_SEQUENCE),
        (left <= 0 or left > COMMAND_MS + DEADLINE_SLACK_MS, wire.LAND_RESULT_LATE),
        (not p.allows(c.v_mmps, c.w_mradps), wire.LAND_RESULT_RANGE),
        (c.engaged and s.estop, wire.LAND_RESULT_ESTOP),
        (c.engaged and not s.neutral_seen, wire.LAND_RESULT_ENGAGE),
        (c.engaged and not _alive(s, now_ms), wire.LAND_RESULT_HEARTBEAT),
        (asks_motion and not c.engaged, wire.LAND_RESULT_ENGAGE),
        (asks_motion and c.air_lock, wire.LAND_RESULT_AIR),
        (asks_motion and not s.wheel_load, wire.LAND_RESULT_LOAD),
        (asks_motion and s.rotors, wire.LAND_RESULT_ROTORS),
    )
    return next((result for wrong, result in checks if wrong), wire.LAND_RESULT_OK)


def _alive(s: State, now_ms: int) -> bool:
    return s.heartbeat_ms is not None and young(now_ms, s.heartbeat_ms, HEARTBEAT_MS)


def on_estop(s: State) -> State:
    """Latch the emergency stop, whoever asks."""
    return disengage(s)._replace(estop=True, token=0)


def _age_token(s: State, now_ms: int) -> State:
    """Called in each period: a token of weeks ago must not look young when the counter wraps."""
    old = s.token and not young(now_ms, s.token_ms, TOKEN_MS)  # most of the time there is none
    return s._replace(token=0) if old else s


def _age_command(s: State, now_ms: int) -> State:
    """The same for the last command: its stamp is carried along, at the age that telemetry can tell."""
    if s.accepted_ms is None or young(now_ms, s.accepted_ms, AGE_MAX_MS):
        return s
    return s._replace(accepted_ms=(now_ms - AGE_MAX_MS) & 0xFFFFFFFF)


def on_release(s: State, session: int, step: int, token: int, now_ms: int) -> tuple[State, int, int]:
    """One of the two steps that end an emergency stop; returns state, LAND_RESULT and the token."""
    if not s.session or session != s.session:
        return s, wire.LAND_RESULT_SESSION, 0
    s = _age_token(s, now_ms)
    if step == 1 and s.estop:
        if not s.token:  # a repeated question gets the same answer
            s = s._replace(token=_mix(s.session, now_ms), token_ms=now_ms)
        return s, wire.LAND_RESULT_OK, s.token
    if step == 2 and s.estop and s.token and token == s.token:
        return disengage(s)._replace(estop=False, token=0), wire.LAND_RESULT_OK, 0
    return s._replace(token=0), wire.LAND_RESULT_UNKNOWN, 0


def tick(s: State, i: Inputs, p: Parameters, now_ms: int, dt_s: float) -> State:
    """Advance by one period; `state.drive` is what the motors get. Call it at 250 Hz or faster."""
    s = _measure(s, i, p, now_ms)
    if i.estop_pressed:
        s = on_estop(s)
    s = _watch_computer(_age_command(_age_token(s, now_ms), now_ms), now_ms)
    s = _watch_wheels(s, i, p, now_ms)
    faults = s.faults & ~(wire.LAND_FAULT_BATTERY_LOW | wire.LAND_FAULT_ESTOP)
    faults |= wire.LAND_FAULT_BATTERY_LOW * (i.battery_v < p.battery_low)
    faults |= wire.LAND_FAULT_ESTOP * s.estop
    drive = _drive(s, p, dt_s)
    return s if faults == s.faults and drive == s.drive else s._replace(faults=faults, drive=drive)


def may_move(s: State) -> bool:
    """All conditions for motion except the age of the command, which `tick` has just checked."""
    return (
        bool(s.session)
        and s.engaged
        and s.moving
        and not s.estop
        and not s.air_lock
        and s.wheel_load
        and not s.rotors
        and not s.faults & _LATCHED
    )


def _watch_computer(s: State, now_ms: int) -> State:
    """Heartbeat and command watchdogs."""
    if s.session and not _alive(s, now_ms):
        lost = wire.LAND_FAULT_HEARTBEAT_LOST * s.engaged
        # An hour-old stamp must not look fresh again when the counter wraps.
        s = disengage(s)._replace(heartbeat_ms=None, faults=s.faults | lost)
    if s.moving and s.accepted_ms is not None:
        old = not young(now_ms, s.accepted_ms, COMMAND_MS)
        if old or ahead(s.deadline_ms, now_ms, 32) < 0:
            s = s._replace(moving=False, faults=s.faults | wire.LAND_FAULT_COMMAND_TIMEOUT)
    return s


def _measure(s: State, i: Inputs, p: Parameters, now_ms: int) -> State:
    """The pins, and wheel speeds over the last MEASURE_MS of encoder ticks."""
    samples = (*s.samples, (now_ms, i.left_ticks, i.right_ticks))
    while len(samples) > 2 and ahead(now_ms, samples[1][0], 32) >= MEASURE_MS:
        samples = samples[1:]
    then_ms, left, right = samples[0]
    span_s = ahead(now_ms, then_ms, 32) * 1e-3
    if span_s <= 0.0:
        return s._replace(samples=samples, wheel_load=i.wheel_load, rotors=i.rotors_possible)
    per_tick = 1.0 / (p.ticks_per_m * span_s)
    return s._replace(
        samples=samples,
        wheel_load=i.wheel_load,
        rotors=i.rotors_possible,
        left_mps=ahead(i.left_ticks, left, 32) * per_tick,
        right_mps=ahead(i.right_ticks, right, 32) * per_tick,
    )


def _watch_wheels(s: State, i: Inputs, p: Parameters, now_ms: int) -> State:
    """Latch stalled or racing wheels and too high a current, when it lasts."""
    pairs = ((s.drive.left_mps, s.left_mps), (s.drive.right_mps, s.right_mps))
    driving = not s.drive.braked
    stall = driving and any(
        abs(asked) > STALL_MPS and got * asked < STALL_SHARE * asked * asked for asked, got in pairs
    )
    race = any(abs(got) > max(RUNAWAY_MPS, RUNAWAY_RATIO * abs(asked)) for asked, got in pairs)
    hot = driving and i.current_a > p.current_max
    stalled = _since(s.stalled_ms, stall, now_ms)
    runaway = _since(s.runaway_ms, race, now_ms)
    current = _since(s.overcurrent_ms, hot, now_ms)
    lasted = (
        wire.LAND_FAULT_WHEEL_STALL * _lasted(stalled, now_ms)
        | wire.LAND_FAULT_WHEEL_RUNAWAY * _lasted(runaway, now_ms)
        | wire.LAND_FAULT_OVERCURRENT * _lasted(current, now_ms)
        | wire.LAND_FAULT_DRIVER * i.driver_fault
    )
    since = (stalled, runaway, current)
    if lasted or since != (s.stalled_ms, s.runaway_ms, s.overcurrent_ms):
        faults = s.faults | lasted
        s = s._replace(stalled_ms=stalled, runaway_ms=runaway, overcurrent_ms=current, faults=faults)
    return disengage(s) if lasted else s


def _since(since_ms: int | None, holds: bool, now_ms: int) -> int | None:
    if not holds:
        return None
    return now_ms if since_ms is None else since_ms


def _lasted(since_ms: int | None, now_ms: int) -> bool:
    return since_ms is not None and ahead(now_ms, since_ms, 32) >= LATCH_MS


def _drive(s: State, p: Parameters, dt_s: float) -> Drive:
    """Ramp towards the command, or brake at once."""
    if not may_move(s):
        return Drive()
    v, half = s.v_mmps * 1e-3, s.w_mradps * 1e-3 * p.track * 0.5
    step = p.acceleration * dt_s
    return Drive(
        left_mps=_ramp(s.drive.left_mps, v - half, step),
        right_mps=_ramp(s.drive.right_mps, v + half, step),
        braked=False,
    )


def _ramp(now: float, target: float, step: float) -> float:
    return now + max(-step, min(step, target - now))
