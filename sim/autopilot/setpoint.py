"""SET_POSITION_TARGET_LOCAL_NED to a `Target`, by its type_mask."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import development as mavlink

from sim.autopilot.controller import Target
from sim.autopilot.estimator import Estimate
from sim.autopilot.vectors import Vector, turn

FORCE = 512
YAW = 1024
YAW_RATE = 2048
_BODY_FRAMES = (mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_FRD)


def target_of(message: mavlink.MAVLink_message, now: Estimate) -> Target | None:
    """What the message demands; None when PX4 would drop it.

    PX4 takes LOCAL_NED, and BODY_NED for velocity and acceleration; it drops force set-points and messages
    that leave position, velocity and acceleration all out. NaN counts as left out.
    """
    mask = message.type_mask
    if mask & FORCE or message.target_system not in (0, 1):
        return None
    position = _masked((message.x, message.y, message.z), mask)
    velocity = _masked((message.vx, message.vy, message.vz), mask >> 3)
    acceleration = _masked((message.afx, message.afy, message.afz), mask >> 6)
    if message.coordinate_frame in _BODY_FRAMES:
        if any(map(math.isfinite, position)):
            return None
        velocity = turn(velocity, now.yaw_rad)
        acceleration = turn(acceleration, now.yaw_rad)
    elif message.coordinate_frame != mavlink.MAV_FRAME_LOCAL_NED:
        return None
    if not any(map(math.isfinite, (*position, *velocity, *acceleration))):
        return None
    return Target(
        position,
        velocity,
        acceleration,
        yaw_rad=math.nan if mask & YAW else message.yaw,
        yaw_rate_rps=math.nan if mask & YAW_RATE else message.yaw_rate,
    )


def _masked(vector: Vector, bits: int) -> Vector:
    x, y, z = (math.nan if bits >> i & 1 else float(v) for i, v in enumerate(vector))
    return x, y, z
