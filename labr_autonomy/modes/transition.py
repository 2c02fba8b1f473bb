"""Hand-over between wheels and rotors, as a pure state machine (heights above the floor; monotonic seconds).

    DRIVING -> STOPPING -> ARMING -> LIFTING -> FLYING -> DESCENDING -> SETTLING -> DISARMING -> DRIVING

Outside this machine rotors and wheels are never both commanded: wheels turn in DRIVING only, rotors are
commanded from ARMING to DISARMING only, and the rotors are never switched off in the air.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace

from labr_autonomy.types import Mode

STOP_SETTLE_S = 0.3  # wheels at rest this long before the rotors may turn
ARM_TIMEOUT_S = 6.0  # PX4 reports arming with its 1 Hz heartbeat
RETRY_S = 1.5  # a command that shows no effect is repeated after this time
LIFT_TIMEOUT_S = 6.0  # no height by then: give up and come down
LIFT_COMMANDED_TIMEOUT_S = 12.0  # ArduPilot's own take-off spins up for 4 s first
LIFT_LATE_S = 20.0  # nor after this, however high it got
LIFTED_M = 0.10  # height that counts as lifted
ARMED_SHOWS_S = 2.5  # an arming on its way shows within this time (1 Hz heartbeat and the command's own time)
LAND_BELOW_M = 0.35  # from here the autopilot's own landing takes over
TOUCHDOWN_SPEED_MAX_MPS = 0.5
SETTLE_S = 0.6  # wheels must carry the weight this long before the rotors stop
RISE_AGAIN_M = 0.6  # above this a descent may be called off


class Phase(enum.Enum):
    """Where in the hand-over the robot is."""

    DRIVING = "driving"
    STOPPING = "stopping"
    ARMING = "arming"
    LIFTING = "lifting"
    FLYING = "flying"
    DESCENDING = "descending"
    SETTLING = "settling"
    DISARMING = "disarming"


class Command(enum.Enum):
    """What the air channel is asked to do once."""

    OFFBOARD = "offboard"
    ARM = "arm"
    TAKE_OFF = "take off"
    LAND = "land"
    DISARM = "disarm"


WHEELS = frozenset({Phase.DRIVING})
ROTORS = frozenset(set(Phase) - {Phase.DRIVING, Phase.STOPPING})


@dataclass(frozen=True, slots=True)
class State:
    """Phase, since when, and when the last command went out."""

    phase: Phase = Phase.DRIVING
    since_s: float = 0.0
    stopped_since_s: float | None = None
    commanded: Command | None = None
    commanded_s: float = -1e9
    arming_sent: bool = False  # an ARM is on its way and may still take effect


@dataclass(frozen=True, slots=True)
class Inputs:
    """One look at the robot."""

    wants: Mode
    wheels_stopped: bool
    armed: bool
    offboard: bool
    height_m: float  # body above its driving height
    lift_height_m: float  # height at which the climb is done
    v_down_mps: float
    landed: bool  # the autopilot's landed state
    wheel_load: bool  # the land controller's load switches
    lifts_by_command: bool = False  # the autopilot ignores set-points on the floor
    blind: bool = False  # no fresh pose: only the autopilot's own landing can bring it down


@dataclass(frozen=True, slots=True)
class Outputs:
    """What may be commanded now."""

    wheels: bool
    rotors: bool
    command: Command | None = None
    say: str = ""


def _go(phase: Phase, now_s: float, say: str) -> tuple[State, Outputs]:
    return State(phase, now_s), Outputs(phase in WHEELS, phase in ROTORS, None, say)


def _command(state: State, command: Command, now_s: float, retry_s: float = RETRY_S) -> tuple[State, Outputs]:
    """Give a command once, and again after `retry_s` without effect."""
    due = state.commanded is not command or now_s - state.commanded_s >= retry_s
    out = Outputs(state.phase in WHEELS, state.phase in ROTORS, command if due else None)
    return (replace(state, commanded=command, commanded_s=now_s) if due else state), out


def _stay(state: State) -> tuple[State, Outputs]:
    return state, Outputs(state.phase in WHEELS, state.phase in ROTORS)


def _stopping(state: State, i: Inputs, now_s: float) -> tuple[State, Outputs]:
    if i.wants is Mode.LAND:
        return _go(Phase.DRIVING, now_s, "take-off called off; driving")
    if not i.wheels_stopped:
        return _stay(replace(state, stopped_since_s=None))
    since_s = now_s if state.stopped_since_s is None else state.stopped_since_s
    if now_s - since_s >= STOP_SETTLE_S:
        return _go(Phase.ARMING, now_s, "wheels at rest and locked; arming")
    return _stay(replace(state, stopped_since_s=since_s))


def _arming(state: State, i: Inputs, now_s: float) -> tuple[State, Outputs]:
    if i.armed and i.offboard:
        return _go(Phase.LIFTING, now_s, "armed; lifting off")
    if i.wants is Mode.LAND or now_s - state.since_s > ARM_TIMEOUT_S:
        why = "take-off called off" if i.wants is Mode.LAND else f"not armed within {ARM_TIMEOUT_S:.0f} s"
        gone, out = _go(Phase.DISARMING, now_s, f"{why}; disarming")
        return replace(gone, arming_sent=state.arming_sent), out
    moved, out = _command(state, Command.ARM if i.offboard else Command.OFFBOARD, now_s)
    return replace(moved, arming_sent=moved.arming_sent or out.command is Command.ARM), out


def _lifting(state: State, i: Inputs, now_s: float) -> tuple[State, Outputs]:
    if i.height_m >= i.lift_height_m:
        return _go(Phase.FLYING, now_s, f"flying at {i.height_m:.2f} m")
    spent_s = now_s - state.since_s
    limit_s = LIFT_COMMANDED_TIMEOUT_S if i.lifts_by_command else LIFT_TIMEOUT_S
    if spent_s > LIFT_LATE_S or (i.height_m < LIFTED_M and spent_s > limit_s):
        return _go(Phase.DESCENDING, now_s, f"only {i.height_m:.2f} m up after {spent_s:.0f} s; coming down")
    if i.wants is Mode.LAND and i.height_m >= LIFTED_M:
        return _go(Phase.DESCENDING, now_s, "climb called off; descending")
    if i.lifts_by_command and i.landed:
        return _command(state, Command.TAKE_OFF, now_s, LIFT_TIMEOUT_S)  # asked again, it spins up anew
    return _stay(state)


def _descending(state: State, i: Inputs, now_s: float) -> tuple[State, Outputs]:
    if i.landed and not i.armed:
        return _go(Phase.DRIVING, now_s, "the autopilot has landed and disarmed; driving")
    if i.landed and i.wheel_load:
        hard = f" (hard: {i.v_down_mps:.2f} m/s)" if i.v_down_mps > TOUCHDOWN_SPEED_MAX_MPS else ""
        return _go(Phase.SETTLING, now_s, "touchdown" + hard)
    if i.wants is Mode.AIR and i.offboard and i.height_m > RISE_AGAIN_M:
        return _go(Phase.FLYING, now_s, "descent called off; flying")
    if i.height_m < LAND_BELOW_M or i.blind:
        return _command(state, Command.LAND, now_s)
    return _stay(state)


def _settling(state: State, i: Inputs, now_s: float) -> tuple[State, Outputs]:
    if i.landed and not i.armed:
        return _go(Phase.DRIVING, now_s, "the autopilot has disarmed; driving")
    if not i.wheel_load:
        return _go(Phase.DESCENDING, now_s, "bounced; descending again")
    if now_s - state.since_s >= SETTLE_S:
        return _go(Phase.DISARMING, now_s, "wheels carry; rotors off")
    return _stay(state)


def _disarming(state: State, i: Inputs, now_s: float) -> tuple[State, Outputs]:
    pending = state.arming_sent and now_s - state.since_s < ARMED_SHOWS_S
    if not i.armed and not pending:
        return _go(Phase.DRIVING, now_s, "disarmed; driving")
    if not i.wheel_load:
        return _go(Phase.DESCENDING, now_s, "off the floor while armed; descending")
    return _command(state, Command.DISARM, now_s)


def step(state: State, i: Inputs, now_s: float) -> tuple[State, Outputs]:
    """One tick of the hand-over."""
    match state.phase:
        case Phase.DRIVING:
            return _go(Phase.STOPPING, now_s, "stopping to take off") if i.wants is Mode.AIR else _stay(state)
        case Phase.STOPPING:
            return _stopping(state, i, now_s)
        case Phase.ARMING:
            return _arming(state, i, now_s)
        case Phase.LIFTING:
            return _lifting(state, i, now_s)
        case Phase.FLYING:
            return _go(Phase.DESCENDING, now_s, "descending") if i.wants is Mode.LAND else _stay(state)
        case Phase.DESCENDING:
            return _descending(state, i, now_s)
        case Phase.SETTLING:
            return _settling(state, i, now_s)
        case Phase.DISARMING:
            return _disarming(state, i, now_s)
