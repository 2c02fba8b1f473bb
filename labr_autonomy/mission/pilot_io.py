"""What the pilot is shown at one instant, and what it answers."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from labr_autonomy.guard import failsafe
from labr_autonomy.guard.failsafe import Reaction
from labr_autonomy.mission.steps import Step
from labr_autonomy.modes.transition import Command, Phase
from labr_autonomy.types import Mode, Odometry, SetPoint


class Order(enum.IntEnum):
    """What the operator asked for, by severity."""

    FLY = 0
    HOLD = 1
    LAND = 2


@dataclass(frozen=True, slots=True)
class Look:
    """Everything the pilot may know at one instant."""

    odometry: Odometry | None  # predicted to now
    wheel_speed_mps: float
    wheel_yaw_rate_rps: float
    wheel_load: bool
    armed: bool
    autopilot_mode: str  # "offboard", "guided", "land", ...
    landed: bool
    health: failsafe.Health
    order: Order = Order.FLY
    lifts_by_command: bool = False  # the autopilot ignores set-points on the floor
    in_doubt: bool = False  # somebody else may be about to fly: nothing may be sent to the autopilot


@dataclass(frozen=True, slots=True)
class Actions:
    """What leaves now. Wheels get a command in every tick; the rotors only where `air` is set."""

    speed_mps: float
    yaw_rate_rps: float
    engaged: bool
    air_lock: bool
    air: SetPoint | None
    reference: SetPoint | None  # what is being followed, for the log
    command: Command | None
    events: tuple[str, ...]
    reached: Step | None
    failed: Step | None
    phase: Phase
    mode: Mode
    step: Step | None
    distance_m: float
    reaction: Reaction
    plan_used_s: float | None  # exposure stamp of the depth frame behind the followed plan
    finished: bool
