"""External poses off the wire: which frames PX4 takes, and what it makes of them."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import development as mavlink

from sim.autopilot.estimator import (
    FRAME_BODY_FRD,
    FRAME_LOCAL_FRD,
    FRAME_LOCAL_NED,
    FRAME_MOCAP_NED,
    VisionPose,
)
from sim.autopilot.vectors import UNKNOWN, Vector, matrix, rotate, yaw_of

MAX_AGE_S = 0.5
SAME_CLOCK_S = 0.1


def pose_of_odometry(message: mavlink.MAVLink_message, stamp_s: float) -> VisionPose | None:
    """ODOMETRY: LOCAL_NED and LOCAL_FRD give a position, MOCAP_NED drops it, the rest is ignored.

    Measured on PX4 1.18: with frame 14 no position is fused, velocity and heading still are.
    """
    if message.frame_id not in (FRAME_LOCAL_NED, FRAME_LOCAL_FRD, FRAME_MOCAP_NED):
        return None
    q = tuple(float(v) for v in message.q)
    norm = math.sqrt(sum(v * v for v in q))
    if not math.isfinite(norm) or norm < 0.5:
        return None
    attitude = (q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm)
    velocity: Vector = (message.vx, message.vy, message.vz)
    if message.child_frame_id == FRAME_BODY_FRD:
        velocity = rotate(matrix(attitude), velocity)
    elif message.child_frame_id not in (FRAME_LOCAL_NED, FRAME_LOCAL_FRD):
        velocity = UNKNOWN
    dropped = message.frame_id == FRAME_MOCAP_NED
    position = UNKNOWN if dropped else (message.x, message.y, message.z)
    return VisionPose(stamp_s, position, velocity, yaw_of(attitude))


def pose_of_vision_estimate(message: mavlink.MAVLink_message, stamp_s: float) -> VisionPose | None:
    """VISION_POSITION_ESTIMATE: local NED, without velocity."""
    if not math.isfinite(message.yaw):
        return None
    return VisionPose(stamp_s, (message.x, message.y, message.z), UNKNOWN, message.yaw)


class ClockOffset:
    """The client's clocks against ours, from the answers to our TIMESYNC requests.

    A companion may answer twice, MAVSDK with one clock and the program on top of it with another. Each clock
    keeps its offset, and a stamp belongs to the one by which it is young.
    """

    def __init__(self) -> None:
        self._offsets_s: list[float] = [0.0]  # ours minus theirs; some clients know our clock

    def answer(self, theirs_ns: int, sent_ns: int, now_s: float) -> None:
        """Take a TIMESYNC answer: their time, and when we asked."""
        sent_s = sent_ns * 1e-9
        if not 0.0 <= now_s - sent_s < 0.2:
            return
        offset_s = 0.5 * (sent_s + now_s) - theirs_ns * 1e-9
        near = [o for o in self._offsets_s[1:] if abs(o - offset_s) < SAME_CLOCK_S]
        others = [o for o in self._offsets_s[1:] if o not in near]
        kept_s = near[0] + 0.05 * (offset_s - near[0]) if near else offset_s
        self._offsets_s = [0.0, *others[-2:], kept_s]

    def local_s(self, theirs_us: int, now_s: float) -> float:
        """A stamp of theirs on our clock; a stamp that makes no sense counts as now, as in PX4."""
        for offset_s in reversed(self._offsets_s):
            stamp_s = theirs_us * 1e-6 + offset_s
            if -0.02 <= now_s - stamp_s <= MAX_AGE_S:
                return min(stamp_s, now_s)
        return now_s
