"""What is known of the land controller, as one value."""

from __future__ import annotations

import math
from dataclasses import dataclass

from firmware_bridge.dialect import labr_land as dialect
from labr_autonomy.ground.words import fault_words, mode_word

STALE_S = 0.3  # telemetry older than this is not called connected: 15 missing frames


@dataclass(frozen=True, slots=True)
class GroundState:
    """What is known of the land controller at `stamp_s`."""

    stamp_s: float  # our clock, when the newest telemetry was measured; 0 before the first
    connected: bool
    engaged: bool  # the controller obeys velocity commands
    mode: str
    faults: tuple[str, ...]
    wheel_load: bool
    battery_v: float
    current_a: float
    speed_mps: float
    yaw_rate_rps: float
    age_s: float  # of the telemetry; infinite before the first

    @property
    def estop(self) -> bool:
        """The emergency stop is latched, by the newest word of the controller."""
        return self.mode == mode_word(dialect.LAND_MODE_ESTOP)


@dataclass(frozen=True, slots=True)
class Telemetry:
    """One telemetry frame and when it was measured and received, on our clock."""

    stamp_s: float
    received_s: float
    message: dialect.MAVLink_land_state_message


def describe(seen: Telemetry | None, ready: bool, reason: str, now_s: float) -> GroundState:
    """The newest telemetry, aged to `now_s`.

    Args:
        seen: Newest telemetry, if any.
        ready: The link is open and the handshake is done.
        reason: Why it is not, as a sentence.
        now_s: Our clock.
    """
    if seen is None:
        return GroundState(0.0, False, False, "unknown", (reason,), False, 0.0, 0.0, 0.0, 0.0, math.inf)
    m, silent_s = seen.message, now_s - seen.received_s
    connected = ready and silent_s <= STALE_S
    faults = fault_words(m.faults, m.last_result)
    if not ready:
        faults += (reason,)
    elif not connected:
        faults += (f"no telemetry for {silent_s:.1f} s",)
    return GroundState(
        stamp_s=seen.stamp_s,
        connected=connected,
        engaged=connected and bool(m.status & dialect.LAND_STATUS_ENGAGED),
        mode=mode_word(m.mode),
        faults=faults,
        wheel_load=bool(m.status & dialect.LAND_STATUS_WHEEL_LOAD),
        battery_v=m.battery_mv * 1e-3,
        current_a=m.current_ma * 1e-3,
        speed_mps=m.v * 1e-3,
        yaw_rate_rps=m.w * 1e-3,
        age_s=now_s - seen.stamp_s,
    )
