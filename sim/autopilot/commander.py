"""Arming, modes and failsafe of a PX4 that has a local position but no global one. Pure.

What was measured (reference flights, GPS denied) and is kept here:
- Hold, take-off, return and mission need a global position. Disarmed they may be selected, but not armed
  in; in the air Hold is refused, and NAV_TAKEOFF is accepted and ends in the failsafe.
- Offboard may be selected at any time on the ground; it needs fresh set-points to arm in and to go on.
- Losing the set-points, or a mode that cannot run, lands. The intention stays, so that returning
  set-points bring offboard back by themselves.
- It disarms 2 s after landing and goes back to the mode from before the landing.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace

from sim.autopilot.modes import FlightMode

DISARM_LANDED_S = 2.0  # COM_DISARM_LAND
DISARM_PREFLIGHT_S = 10.0  # COM_DISARM_PRFLT
TIP_RAD = math.radians(60.0)  # FD_FAIL_P, FD_FAIL_R
TIP_S = 0.3  # FD_FAIL_P_TTRI
TIP_WINDOW_S = 5.0  # PX4 disarms on a tip-over only this soon after lift-off


class Result(enum.IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


class Kind(enum.Enum):
    """What a client can ask the commander for."""

    ARM = "arm"
    DISARM = "disarm"
    MODE = "mode"
    TAKEOFF = "takeoff"
    LAND = "land"


@dataclass(frozen=True, slots=True)
class Request:
    """One command."""

    kind: Kind
    mode: FlightMode | None = None  # of Kind.MODE; None = a mode that does not exist
    force: bool = False  # of arming and disarming: param2 = 21196


@dataclass(frozen=True, slots=True)
class CommanderState:
    """Everything the commander remembers."""

    intended: FlightMode = FlightMode.HOLD  # what was asked for
    previous: FlightMode = FlightMode.HOLD  # what was asked for before a landing
    armed: bool = False
    failsafe: bool = False
    armed_s: float = 0.0  # when it armed
    flown_s: float | None = None  # when it left the ground since arming
    landed_s: float | None = None  # since when it stands, armed, after a flight
    tipped_s: float | None = None  # since when it lies over

    @property
    def mode(self) -> FlightMode:
        """The mode that runs: what was asked for, or the landing of the failsafe."""
        return FlightMode.LAND if self.failsafe else self.intended


@dataclass(frozen=True, slots=True)
class CommanderInputs:
    """What the commander sees at one instant."""

    setpoint_age_s: float = math.inf
    loss_s: float = 1.0  # COM_OF_LOSS_T
    setpoint_usable: bool = True  # the estimate knows what the set-points refer to
    landed: bool = True
    tilt_rad: float = 0.0


def can_run(mode: FlightMode, inputs: CommanderInputs) -> bool:
    """Whether a mode may be armed in, and may go on, without a global position and without a pilot."""
    if mode is FlightMode.OFFBOARD:
        return inputs.setpoint_age_s <= inputs.loss_s and inputs.setpoint_usable
    return mode is FlightMode.LAND


def can_arm(state: CommanderState, inputs: CommanderInputs) -> bool:
    """Whether arming would be accepted now."""
    return state.intended is FlightMode.OFFBOARD and can_run(state.intended, inputs)


def request(
    state: CommanderState, asked: Request, inputs: CommanderInputs, now_s: float
) -> tuple[CommanderState, Result]:
    """Answer one command."""
    match asked.kind:
        case Kind.ARM:
            return _arm(state, asked, inputs, now_s)
        case Kind.DISARM:
            if state.armed and not inputs.landed and not asked.force:
                return state, Result.TEMPORARILY_REJECTED
            return _disarmed(state), Result.ACCEPTED
        case Kind.TAKEOFF:
            return replace(state, intended=FlightMode.TAKEOFF), Result.ACCEPTED
        case Kind.LAND:
            return _land(state), Result.ACCEPTED
        case Kind.MODE:
            return _change_mode(state, asked.mode, inputs)


def step(state: CommanderState, inputs: CommanderInputs, now_s: float) -> CommanderState:
    """Let time pass: failsafe on and off, landing, automatic disarming."""
    if not state.armed:
        return state
    flown_s = state.flown_s
    if flown_s is None and not inputs.landed:
        flown_s = now_s
    standing = inputs.landed and flown_s is not None
    state = replace(
        state,
        failsafe=not can_run(state.intended, inputs),
        flown_s=flown_s,
        landed_s=(state.landed_s if state.landed_s is not None else now_s) if standing else None,
        tipped_s=_since(state.tipped_s, inputs.tilt_rad > TIP_RAD, now_s),
    )
    return _disarmed(state) if _must_disarm(state, now_s) else state


def system_status(state: CommanderState, inputs: CommanderInputs) -> int:
    """HEARTBEAT.system_status: MAV_STATE uninitialised, standby, active or critical, as recorded."""
    if state.armed:
        return 5 if state.failsafe else 4
    return 3 if can_arm(state, inputs) else 0


def base_mode(state: CommanderState, *, setpoint_seen: bool) -> int:
    """HEARTBEAT.base_mode, as recorded."""
    flags = 1 | (128 if state.armed else 0)  # custom mode, armed
    if state.mode is FlightMode.OFFBOARD:
        return flags | (16 if setpoint_seen else 0)  # stabilised
    if state.mode.automatic:
        return flags | 16 | 8 | 4  # stabilised, guided, auto
    return flags | 64 | 16  # manual input


def _arm(
    state: CommanderState, asked: Request, inputs: CommanderInputs, now_s: float
) -> tuple[CommanderState, Result]:
    if state.armed:
        return state, Result.ACCEPTED
    if not asked.force and not can_arm(state, inputs):
        return state, Result.TEMPORARILY_REJECTED
    return (
        replace(state, armed=True, failsafe=False, armed_s=now_s, flown_s=None, landed_s=None, tipped_s=None),
        Result.ACCEPTED,
    )


def _land(state: CommanderState) -> CommanderState:
    if state.intended is FlightMode.LAND:
        return state
    return replace(state, intended=FlightMode.LAND, previous=state.intended, failsafe=False)


def _change_mode(
    state: CommanderState, mode: FlightMode | None, inputs: CommanderInputs
) -> tuple[CommanderState, Result]:
    if mode is None or (state.armed and not can_run(mode, inputs)):
        return state, Result.TEMPORARILY_REJECTED
    if mode is FlightMode.LAND:
        return _land(state), Result.ACCEPTED
    return replace(state, intended=mode, failsafe=False), Result.ACCEPTED


def _disarmed(state: CommanderState) -> CommanderState:
    intended = state.previous if state.armed and state.intended is FlightMode.LAND else state.intended
    return replace(
        state, intended=intended, armed=False, failsafe=False, flown_s=None, landed_s=None, tipped_s=None
    )


def _must_disarm(state: CommanderState, now_s: float) -> bool:
    if state.landed_s is not None and now_s - state.landed_s >= DISARM_LANDED_S:
        return True
    if state.flown_s is None and now_s - state.armed_s >= DISARM_PREFLIGHT_S:
        return True
    early = state.flown_s is None or now_s - state.flown_s <= TIP_WINDOW_S
    return state.tipped_s is not None and now_s - state.tipped_s >= TIP_S and early


def _since(since_s: float | None, true: bool, now_s: float) -> float | None:
    """When a condition began that holds now."""
    if not true:
        return None
    return now_s if since_s is None else since_s
