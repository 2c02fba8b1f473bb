"""From spinning up to standing again: PX4's take-off ramp and land detector. Pure.

Times are those of the recordings: 1.0 s at idle after arming, then the thrust grows to that of hovering in
1.8 s; "in the air" is reported 1.85 s after arming, still on the wheels; at the end "landed" about 1.9 s
after touch-down, with the thrust cut 1.3 s after it.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

SPOOL_UP_S = 1.0  # COM_SPOOLUP_TIME
RAMP_S = 1.8
AIRBORNE_S = 0.85  # into the ramp
CUT_S = 1.3  # after touch-down
LANDED_S = 1.9  # after touch-down
TOUCH_SPEED_MPS = 0.25  # LNDMC_Z_VEL_MAX


class Phase(enum.Enum):
    """What the rotors are allowed to do."""

    DISARMED = "disarmed"
    SPOOL_UP = "spool up"
    READY = "ready"  # idle on the ground until a climb is wanted
    RAMP = "ramp"  # thrust limited by the time since it began
    FLIGHT = "flight"


@dataclass(frozen=True, slots=True)
class PhaseState:
    """Phase, and when it and a ground contact began."""

    phase: Phase = Phase.DISARMED
    since_s: float = 0.0
    touch_s: float | None = None

    def landed(self, now_s: float) -> bool:
        """What EXTENDED_SYS_STATE reports as on the ground."""
        if self.phase is Phase.FLIGHT:
            return False
        return not (self.phase is Phase.RAMP and now_s - self.since_s >= AIRBORNE_S)

    def cut(self, now_s: float) -> bool:
        """Whether the thrust is off because it seems to stand."""
        return self.touch_s is not None and now_s - self.touch_s >= CUT_S

    def thrust_share(self, now_s: float) -> float:
        """Upper limit of the thrust over that of hovering."""
        if self.phase is Phase.FLIGHT:
            return 100.0
        return (now_s - self.since_s) / RAMP_S if self.phase is Phase.RAMP else 0.0


@dataclass(frozen=True, slots=True)
class PhaseInputs:
    """What the phases depend on."""

    armed: bool
    climb_wanted: bool
    descent_wanted: bool  # or so little thrust that it cannot fly
    touching: bool  # a wheel carries load
    speed_down_mps: float
    lifted: bool  # thrust demand below the ramp's limit, or off the ground


def step(state: PhaseState, inputs: PhaseInputs, now_s: float) -> PhaseState:
    """Move on by one tick."""
    if not inputs.armed:
        return state if state.phase is Phase.DISARMED else PhaseState(Phase.DISARMED, now_s)
    elapsed_s = now_s - state.since_s
    match state.phase:
        case Phase.DISARMED:
            return PhaseState(Phase.SPOOL_UP, now_s)
        case Phase.SPOOL_UP if elapsed_s >= SPOOL_UP_S:
            return PhaseState(Phase.READY, now_s)
        case Phase.READY if inputs.climb_wanted:
            return PhaseState(Phase.RAMP, now_s)
        case Phase.RAMP if not inputs.climb_wanted and elapsed_s < AIRBORNE_S:
            return PhaseState(Phase.READY, now_s)
        case Phase.RAMP if elapsed_s >= AIRBORNE_S and inputs.lifted:
            return PhaseState(Phase.FLIGHT, now_s)
        case Phase.RAMP | Phase.FLIGHT:
            return _watch_ground(state, inputs, now_s)
    return state


def _watch_ground(state: PhaseState, inputs: PhaseInputs, now_s: float) -> PhaseState:
    touching = inputs.touching and inputs.descent_wanted and abs(inputs.speed_down_mps) < TOUCH_SPEED_MPS
    if not touching:
        return PhaseState(state.phase, state.since_s) if state.touch_s is not None else state
    if state.touch_s is None:
        return PhaseState(state.phase, state.since_s, now_s)
    return PhaseState(Phase.READY, now_s) if now_s - state.touch_s >= LANDED_S else state
