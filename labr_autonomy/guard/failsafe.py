"""The failsafe table: each cause with its limit and its reaction on land and in the air. Pure.

A cause that holds its reaction is the *first cause* until it clears; of several the most severe reaction
wins. Reactions further down the enum take precedence (as in PX4's failsafe framework).
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass

from labr_autonomy.types import Mode


class Reaction(enum.IntEnum):
    """What the executive must do, by severity."""

    NONE = 0
    HOLD = 1  # wheels to zero, or hover
    LAND = 2  # come down here and end the mission
    YIELD = 3  # somebody else flies: send nothing, follow and report


@dataclass(frozen=True, slots=True)
class Health:
    """What the guard looks at; ages in seconds, inf before the first datum."""

    mode: Mode
    vio_age_s: float
    depth_age_s: float
    ground_age_s: float
    air_age_s: float
    plan_age_s: float
    vio_rejected: int  # VIO samples refused in a row by the filter
    estop: bool  # the land controller's latch
    taken_over: str  # why the autopilot no longer follows us, "" while it does
    battery_left: float  # 0..1
    battery_reserve: float  # 0..1
    depth_fault: str = ""  # why depth images cannot be believed, "" while they can
    wheel_fault: str = ""  # why the wheels have to rest, "" while they need not


@dataclass(frozen=True, slots=True)
class Row:
    """One cause."""

    code: str
    holds: Callable[[Health], bool]
    on_land: Reaction
    in_air: Reaction
    sentence: Callable[[Health], str]


VIO_LATE_S = 0.3  # faults.md rows 29 and 33
VIO_LOST_S = 3.0  # in the air: no pose for this long means landing while PX4 still can
DEPTH_LATE_S = 0.5
GROUND_LATE_S = 0.3
AIR_LATE_S = 2.5  # the heartbeat is 1 Hz
PLAN_LATE_S = 1.5
VIO_REJECTED_MAX = 15  # half a second of refused poses

TABLE: tuple[Row, ...] = (
    Row(
        "vio-late",
        lambda h: h.vio_age_s > VIO_LATE_S,
        Reaction.HOLD,
        Reaction.HOLD,
        lambda h: f"no pose from VIO for {h.vio_age_s:.1f} s (limit {VIO_LATE_S} s)",
    ),
    Row(
        "vio-lost",
        lambda h: h.vio_age_s > VIO_LOST_S,
        Reaction.HOLD,
        Reaction.LAND,
        lambda h: f"no pose from VIO for {h.vio_age_s:.1f} s (limit {VIO_LOST_S} s)",
    ),
    Row(
        "vio-disagrees",
        lambda h: h.vio_rejected > VIO_REJECTED_MAX,
        Reaction.HOLD,
        Reaction.HOLD,
        lambda h: f"{h.vio_rejected} VIO poses in a row disagree with IMU and wheels",
    ),
    Row(
        "depth-late",
        lambda h: h.depth_age_s > DEPTH_LATE_S,
        Reaction.HOLD,
        Reaction.HOLD,
        lambda h: f"no depth image for {h.depth_age_s:.1f} s (limit {DEPTH_LATE_S} s)",
    ),
    Row(
        "depth-untrusted",  # faults.md row 36
        lambda h: bool(h.depth_fault),
        Reaction.HOLD,
        Reaction.HOLD,
        lambda h: h.depth_fault,
    ),
    Row(
        "plan-late",
        lambda h: h.plan_age_s > PLAN_LATE_S,
        Reaction.HOLD,
        Reaction.HOLD,
        lambda h: f"no plan for {h.plan_age_s:.1f} s (limit {PLAN_LATE_S} s)",
    ),
    Row(
        "ground-late",
        lambda h: h.ground_age_s > GROUND_LATE_S,
        Reaction.HOLD,
        Reaction.NONE,
        lambda h: f"land controller silent for {h.ground_age_s:.1f} s (limit {GROUND_LATE_S} s)",
    ),
    Row(
        "air-late",
        lambda h: h.air_age_s > AIR_LATE_S,
        Reaction.HOLD,
        Reaction.HOLD,
        lambda h: f"autopilot silent for {h.air_age_s:.1f} s (limit {AIR_LATE_S} s)",
    ),
    Row(
        "estop",
        lambda h: h.estop,
        Reaction.HOLD,
        Reaction.NONE,
        lambda h: "emergency stop is latched on the land controller",
    ),
    Row(
        "wheel-fault",
        lambda h: bool(h.wheel_fault),
        Reaction.HOLD,
        Reaction.NONE,
        lambda h: h.wheel_fault,
    ),
    Row(
        "battery",
        lambda h: h.battery_left < h.battery_reserve,
        Reaction.LAND,
        Reaction.LAND,
        lambda h: f"battery at {h.battery_left * 100:.0f} % (reserve {h.battery_reserve * 100:.0f} %)",
    ),
    Row(
        "taken-over",
        lambda h: bool(h.taken_over),
        Reaction.NONE,
        Reaction.YIELD,
        lambda h: h.taken_over,
    ),
)


@dataclass(frozen=True, slots=True)
class State:
    """The reaction in force and the cause that came first."""

    reaction: Reaction = Reaction.NONE
    code: str = ""
    sentence: str = ""
    since_s: float = 0.0


def step(state: State, health: Health, now_s: float) -> State:
    """One look at the table. A landing or a yield lasts for the rest of the mission."""
    active = [
        (row.on_land if health.mode is Mode.LAND else row.in_air, row) for row in TABLE if row.holds(health)
    ]
    active = [(reaction, row) for reaction, row in active if reaction is not Reaction.NONE]
    lasting = state.reaction >= Reaction.LAND
    if not active:
        return state if lasting else State()
    worst, row = max(active, key=lambda pair: pair[0])
    if lasting and worst <= state.reaction:
        return state
    if state.reaction is Reaction.NONE:
        return State(worst, row.code, row.sentence(health), now_s)
    if worst > state.reaction:  # more severe; the first cause stays on record
        return State(worst, state.code, f"{row.sentence(health)}; first: {state.sentence}", state.since_s)
    still = any(r.code == state.code for _, r in active)
    return state if still and worst is state.reaction else State(worst, row.code, row.sentence(health), now_s)
