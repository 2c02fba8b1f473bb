"""Arming, modes and take-off of ArduCopter with a local position from vision. Pure."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace

CALIBRATED_S = 2.0  # after its start; until then it says "boot"
# The two inertial units of the recorded flight agreed only so long after its start.
ACCELS_AGREE_S = 13.0
GYROS_AGREE_S = 23.0
SPIN_UP_S = 3.8  # from NAV_TAKEOFF to leaving the floor, as recorded
DISARM_LANDED_S = 0.2
DISARM_IDLE_S = 10.0  # DISARM_DELAY


class Mode(enum.IntEnum):
    """Mode::Number of ArduCopter, those that this stand-in knows."""

    STABILIZE = 0
    GUIDED = 4
    LOITER = 5
    LAND = 9
    POSHOLD = 16
    BRAKE = 17


NEEDS_POSITION = frozenset({Mode.GUIDED, Mode.LOITER, Mode.POSHOLD, Mode.BRAKE})


class Result(enum.IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


@dataclass(frozen=True, slots=True)
class State:
    """Everything that it remembers."""

    mode: Mode = Mode.STABILIZE
    armed: bool = False
    armed_s: float = 0.0
    take_off_m: float | None = None  # height of a take-off under way
    take_off_s: float = 0.0  # when it was asked for
    flown: bool = False
    landed_s: float | None = None  # since when it stands after a flight


@dataclass(frozen=True, slots=True)
class Inputs:
    """What it sees."""

    boot_s: float = math.inf  # time since its start
    positioned: bool = True  # the estimate knows its position
    landed: bool = True
    height_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Answer:
    """Result of a request, and what it says to it."""

    result: Result
    text: str = ""


def arm(s: State, i: Inputs, now_s: float) -> tuple[State, Answer]:
    """MAV_CMD_COMPONENT_ARM_DISARM, param1 = 1."""
    if s.armed:
        return s, Answer(Result.ACCEPTED)
    if i.boot_s < GYROS_AGREE_S:
        what = "Accels" if i.boot_s < ACCELS_AGREE_S else "Gyros"
        return s, Answer(Result.FAILED, f"Arm: {what} inconsistent")
    if not i.positioned and s.mode in NEEDS_POSITION:
        return s, Answer(Result.FAILED, "Arm: Need Position Estimate")
    return State(s.mode, True, now_s), Answer(Result.ACCEPTED)


def disarm(s: State, i: Inputs) -> tuple[State, Answer]:
    """The same with param1 = 0; refused in the air."""
    if s.armed and not i.landed:
        return s, Answer(Result.FAILED)
    return State(s.mode), Answer(Result.ACCEPTED)


def change_mode(s: State, number: int, i: Inputs) -> tuple[State, Answer]:
    """MAV_CMD_DO_SET_MODE."""
    if number not in set(Mode):
        return s, Answer(Result.FAILED, f"No such mode {number}")
    mode = Mode(number)
    if s.armed and mode in NEEDS_POSITION and not i.positioned:
        return s, Answer(Result.FAILED, f"Mode change to {mode.name} failed: requires position")
    if mode is s.mode:
        return s, Answer(Result.ACCEPTED)
    return replace(s, mode=mode, take_off_m=None), Answer(Result.ACCEPTED)


def take_off(s: State, height_m: float, i: Inputs, now_s: float) -> tuple[State, Answer]:
    """MAV_CMD_NAV_TAKEOFF: armed, in GUIDED, on the floor."""
    if not s.armed or s.mode is not Mode.GUIDED or not i.landed or not height_m > 0.0:
        return s, Answer(Result.FAILED)
    return replace(s, take_off_m=height_m, take_off_s=now_s), Answer(Result.ACCEPTED)


def step(s: State, i: Inputs, now_s: float) -> State:
    """Let time pass: the end of a take-off, landing, disarming by itself."""
    if not s.armed:
        return s
    flown = s.flown or not i.landed
    standing = flown and i.landed
    landed_s = (s.landed_s if s.landed_s is not None else now_s) if standing else None
    taking_off = s.take_off_m
    if taking_off is not None and i.height_m >= taking_off - 0.1:
        taking_off = None
    s = replace(s, flown=flown, landed_s=landed_s, take_off_m=taking_off)
    down = s.mode is Mode.LAND and landed_s is not None and now_s - landed_s >= DISARM_LANDED_S
    idle = not flown and s.take_off_m is None and now_s - s.armed_s >= DISARM_IDLE_S
    return State(s.mode) if down or idle else s


def lifts(s: State, now_s: float) -> bool:
    """Whether a take-off has spun up."""
    return s.take_off_m is not None and now_s - s.take_off_s >= SPIN_UP_S


def base_mode(s: State, i: Inputs) -> int:
    """HEARTBEAT.base_mode, as recorded."""
    manual = 0x51 if s.mode is Mode.STABILIZE and i.boot_s >= CALIBRATED_S else 0x59
    return manual | (0x80 if s.armed else 0)


def system_status(s: State, i: Inputs, now_s: float) -> int:
    """HEARTBEAT.system_status: boot, standby on the floor, armed or not; active from lifting off on."""
    if i.boot_s < CALIBRATED_S:
        return 1
    return 4 if s.armed and (not i.landed or lifts(s, now_s)) else 3
