"""The mission's steps, as a pure state machine: which goal now, and is it reached. Odom ENU, seconds."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from labr_autonomy.types import Array, Mode

REST_MPS = 0.15  # slower than this counts as standing at the goal
REST_S = 0.4  # and it must last this long
BESIDE_M = 0.6  # as near as this a goal that has no room for the robot counts as reached ...
BESIDE_S = 2.0  # ... once the robot has stood for so long where it gets no nearer


class Kind(enum.Enum):
    """What a step asks for."""

    GOTO = "goto"
    WAIT = "wait"
    LAND = "land"


class OnFail(enum.Enum):
    """What follows a step that ran out of time."""

    STOP = "stop"
    SKIP = "skip"
    HOLD = "hold"


class Policy(enum.Enum):
    """Which modes a step allows."""

    AUTO = "auto"
    GROUND = "ground"
    AIR = "air"


@dataclass(frozen=True, slots=True)
class Step:
    """One item of the mission, resolved to figures."""

    kind: Kind
    label: str
    goal_m: Array | None = None  # (3,) odom; z matters when in_air
    in_air: bool = False
    policy: Policy = Policy.AUTO
    accept_m: float = 0.25
    wait_s: float = 0.0
    timeout_s: float = 180.0
    on_fail: OnFail = OnFail.STOP
    here: bool = False  # of a landing: right here, whatever the map shows below


class Status(enum.Enum):
    """How the mission stands."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    HOLDING = "holding"


@dataclass(frozen=True, slots=True)
class State:
    """Progress through the steps."""

    index: int = 0
    entered_s: float = 0.0
    rest_since_s: float | None = None
    status: Status = Status.RUNNING


@dataclass(frozen=True, slots=True)
class Inputs:
    """One look at the robot."""

    position_m: Array  # (3,) odom
    speed_mps: float
    mode: Mode
    settled: bool  # driving or flying, not in between
    nearest: bool = False  # there is no room for it beyond
    stuck: str = ""  # why it gets no farther, "" while it may


@dataclass(frozen=True, slots=True)
class Outputs:
    """What the flight does now."""

    step: Step | None
    distance_m: float  # to the goal; 0 without one
    reached: Step | None = None  # the step that was completed in this tick
    failed: Step | None = None
    say: str = ""


def goal_distance_m(step: Step, position_m: Array) -> float:
    """Distance that counts: in the plane for a goal on land, in space for one in the air [m]."""
    if step.goal_m is None:
        return 0.0
    d = np.asarray(step.goal_m) - position_m
    return float(math.hypot(d[0], d[1]) if not step.in_air else math.sqrt(float(d @ d)))


def _at_goal(step: Step, i: Inputs) -> bool:
    match step.kind:
        case Kind.WAIT:
            return False
        case Kind.LAND:
            return i.settled and i.mode is Mode.LAND
        case Kind.GOTO:
            right_mode = i.mode is (Mode.AIR if step.in_air else Mode.LAND) and i.settled
            distance_m = goal_distance_m(step, i.position_m)
            near = distance_m <= step.accept_m or (i.nearest and distance_m <= BESIDE_M)
            return right_mode and near and i.speed_mps <= REST_MPS


def step(state: State, steps: Sequence[Step], i: Inputs, now_s: float) -> tuple[State, Outputs]:
    """One tick of the mission."""
    if state.status is not Status.RUNNING or state.index >= len(steps):
        done = state.status if state.status is not Status.RUNNING else Status.DONE
        return replace(state, status=done), Outputs(None, 0.0)
    current = steps[state.index]
    distance = goal_distance_m(current, i.position_m)
    if current.kind is Kind.WAIT and now_s - state.entered_s >= current.wait_s:
        return _next(state, steps, current, now_s)
    if _at_goal(current, i):
        since_s = now_s if state.rest_since_s is None else state.rest_since_s
        beside = current.kind is Kind.GOTO and distance > current.accept_m
        if now_s - since_s >= (BESIDE_S if beside else REST_S):
            how = f", {distance:.2f} m off: as near as there is room for the robot" if beside else ""
            return _next(state, steps, current, now_s, how)
        return replace(state, rest_since_s=since_s), Outputs(current, distance)
    if now_s - state.entered_s > current.timeout_s:
        return _failed(state, current, f"not reached within {current.timeout_s:.0f} s", distance, now_s)
    if i.stuck and current.kind is Kind.GOTO:
        return _failed(state, current, i.stuck, distance, now_s)
    return replace(state, rest_since_s=None), Outputs(current, distance)


def _next(
    state: State, steps: Sequence[Step], current: Step, now_s: float, how: str = ""
) -> tuple[State, Outputs]:
    index = state.index + 1
    done = index >= len(steps)
    following = None if done else steps[index]
    say = f"{current.label}: done{how}" + (f"; next {following.label}" if following else "; mission complete")
    status = Status.DONE if done else Status.RUNNING
    return State(index, now_s, None, status), Outputs(following, 0.0, reached=current, say=say)


def _failed(state: State, current: Step, why: str, distance_m: float, now_s: float) -> tuple[State, Outputs]:
    say = f"{current.label}: {why} ({distance_m:.1f} m left)"
    match current.on_fail:
        case OnFail.SKIP:
            moved = State(state.index + 1, now_s)
        case OnFail.HOLD:
            moved = replace(state, status=Status.HOLDING)
        case OnFail.STOP:
            moved = replace(state, status=Status.FAILED)
    return moved, Outputs(None, distance_m, failed=current, say=f"{say}; {current.on_fail.value}")
