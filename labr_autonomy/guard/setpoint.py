"""The last look at a set-point before it leaves: finite, fresh, within limits, inside the fences. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.guard.fence import Zone, margin_m
from labr_autonomy.types import Mode, SetPoint

AGE_MAX_S = 0.1  # an older set-point never leaves
SPEED_SLACK = 1.05  # tracking feedback may exceed the planner's limits by this factor


@dataclass(frozen=True, slots=True)
class Verdict:
    """The set-point that may leave, or the reason why none may."""

    setpoint: SetPoint | None
    code: str = ""  # the kind of reason, stable
    reason: str = ""  # the sentence, with figures


def check_setpoint(
    setpoint: SetPoint, config: RobotConfig, fences: Sequence[Zone], floor_z_m: float, now_s: float
) -> Verdict:
    """Pass, limit or refuse a set-point.

    Speeds over the limit are scaled down; a stale, non-finite or out-of-fence set-point is refused.

    Args:
        setpoint: What the pilot wants to send, odom.
        config: Limits.
        fences: Zones in odom.
        floor_z_m: Height of the floor in odom [m].
        now_s: Time of the injected clock [s].
    """
    numbers = (
        *setpoint.position_m,
        *setpoint.velocity_mps,
        *setpoint.acceleration_mps2,
        setpoint.yaw_rad,
        setpoint.yaw_rate_rps,
        setpoint.speed_mps,
    )
    if not all(math.isfinite(v) for v in numbers):
        return Verdict(None, "broken", "set-point is not finite")
    age_s = now_s - setpoint.stamp_s
    if age_s > AGE_MAX_S:
        return Verdict(
            None, "stale", f"set-point is {age_s * 1e3:.0f} ms old (limit {AGE_MAX_S * 1e3:.0f} ms)"
        )
    x, y, z = (float(v) for v in setpoint.position_m)
    room_m = margin_m(fences, x, y, z)
    if room_m < 0.0:
        return Verdict(
            None, "fence", f"set-point ({x:.2f}, {y:.2f}, {z:.2f}) is {-room_m:.2f} m outside the fence"
        )
    ceiling_m = floor_z_m + config.air.height_max_m
    if setpoint.mode is Mode.AIR and z > ceiling_m + 0.3:
        return Verdict(
            None,
            "height",
            f"set-point height {z - floor_z_m:.2f} m is above the limit {config.air.height_max_m:.2f} m",
        )
    return Verdict(_limited(setpoint, config))


def _limited(setpoint: SetPoint, config: RobotConfig) -> SetPoint:
    if setpoint.mode is Mode.LAND:
        high, low = config.land.speed_mps * SPEED_SLACK, -config.land.reverse_mps * SPEED_SLACK
        turn = config.land.yaw_rate_rps
        return replace(
            setpoint,
            speed_mps=min(max(setpoint.speed_mps, low), high),
            yaw_rate_rps=min(max(setpoint.yaw_rate_rps, -turn), turn),
        )
    limit = np.array([config.air.speed_mps, config.air.speed_mps, config.air.climb_mps]) * SPEED_SLACK
    scale = float(
        np.min(
            np.where(
                np.abs(setpoint.velocity_mps) > limit,
                limit / np.maximum(np.abs(setpoint.velocity_mps), 1e-9),
                1.0,
            )
        )
    )
    turn = config.air.yaw_rate_rps
    return replace(
        setpoint,
        velocity_mps=setpoint.velocity_mps * scale,
        yaw_rate_rps=min(max(setpoint.yaw_rate_rps, -turn), turn),
    )
