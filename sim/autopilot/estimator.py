"""The stand-in's state estimate: truth plus the error of the vision poses it was given.

The local frame is the vision's frame, as in PX4 with EKF2_EV_CTRL=15: whatever the client sends, shifted or
turned against the world, is where the autopilot believes to be. The error against the truth of the same
instant is low-passed; between and after the samples the truth's motion carries the estimate on, and the
last velocity error makes it drift, as dead reckoning does.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from dataclasses import dataclass

from sim.autopilot.vectors import UNKNOWN, ZERO, Quaternion, Vector, from_angles, multiply, turn, wrap, yaw_of

TIMEOUT_S = 5.0  # EKF2_NOAID_TOUT
JUMP_M = 1.0  # a sample further off than this is refused ...
RESET_S = 1.0  # ... until nothing has been fused for so long; then the estimate jumps to it
SMOOTHING_S = 0.25
HISTORY_S = 0.5

FRAME_LOCAL_NED = 1
FRAME_MOCAP_NED = 14
FRAME_LOCAL_FRD = 20
FRAME_BODY_FRD = 12


@dataclass(frozen=True, slots=True)
class Truth:
    """True motion at one instant, NED and FRD."""

    stamp_s: float
    position_m: Vector
    velocity_mps: Vector
    attitude: Quaternion
    rates_rps: Vector


@dataclass(frozen=True, slots=True)
class VisionPose:
    """One external pose; unknown parts are NaN."""

    stamp_s: float
    position_m: Vector
    velocity_mps: Vector  # in the same frame as the position
    yaw_rad: float


@dataclass(frozen=True, slots=True)
class Estimate:
    """What the autopilot believes, in its local frame."""

    position_m: Vector = UNKNOWN
    velocity_mps: Vector = ZERO
    attitude: Quaternion = (1.0, 0.0, 0.0, 0.0)
    rates_rps: Vector = ZERO
    position_valid: bool = False
    velocity_valid: bool = False

    @property
    def yaw_rad(self) -> float:
        """Heading in the local frame."""
        return yaw_of(self.attitude)


class Estimator:
    """Fuses vision poses onto the truth."""

    def __init__(self) -> None:
        self._history: deque[Truth] = deque()
        self._offset_m: Vector = ZERO
        self._velocity_error_mps: Vector = ZERO
        self._yaw_error_rad = 0.0
        self._position_s: float | None = None  # stamp of the last fused position
        self._velocity_s: float | None = None  # ... of anything fused
        self._last_sample_s = -math.inf
        self._anchor_m: Vector | None = None  # where it stood before the first vision pose: PX4's zero
        self.resets = 0
        self.counts: Counter[str] = Counter()

    def step(self, truth: Truth) -> Estimate:
        """Advance to `truth` and return the estimate there."""
        history = self._history
        if history:
            self._drift(truth.stamp_s - history[-1].stamp_s)
        history.append(truth)
        while history[0].stamp_s < truth.stamp_s - HISTORY_S:
            history.popleft()
        if self._anchor_m is None:
            self._anchor_m = truth.position_m
            self._yaw_error_rad = -yaw_of(truth.attitude)
        position_valid = _recent(self._position_s, truth.stamp_s)
        velocity_valid = _recent(self._velocity_s, truth.stamp_s)
        velocity = turn(truth.velocity_mps, self._yaw_error_rad)
        error = self._velocity_error_mps
        return Estimate(
            position_m=self._position(truth, position_valid),
            velocity_mps=(velocity[0] + error[0], velocity[1] + error[1], velocity[2] + error[2]),
            attitude=multiply(from_angles(0.0, 0.0, self._yaw_error_rad), truth.attitude),
            rates_rps=truth.rates_rps,
            position_valid=position_valid,
            velocity_valid=velocity_valid,
        )

    def fuse(self, pose: VisionPose) -> bool:
        """Take one external pose; False when it is refused."""
        if not self._history:
            return False
        truth = self._truth_at(pose.stamp_s)
        now_s = self._history[-1].stamp_s
        gain = 1.0 - math.exp(-min(0.2, max(0.0, now_s - self._last_sample_s)) / SMOOTHING_S)
        fused_position = math.isfinite(sum(pose.position_m))
        first = self._position_s is None if fused_position else self._velocity_s is None
        yaw_error = wrap(pose.yaw_rad - yaw_of(truth.attitude))
        if first:
            self._yaw_error_rad = yaw_error
        turned = turn(truth.position_m, yaw_error)
        offset = tuple(p - t for p, t in zip(pose.position_m, turned, strict=True))
        if fused_position and not first:
            believed = self._believed_position(truth)
            if math.dist(pose.position_m, believed) > JUMP_M:
                self.counts["jump"] += 1
                if now_s - (self._position_s or 0.0) < RESET_S:
                    return False
                first = True
                self.resets += 1
        gain = 1.0 if first else gain
        self._yaw_error_rad = wrap(self._yaw_error_rad + gain * wrap(yaw_error - self._yaw_error_rad))
        if fused_position:
            self._offset_m = _blend(self._offset_m, offset, gain)  # type: ignore[arg-type]
            self._position_s = now_s
        if math.isfinite(sum(pose.velocity_mps)):
            true_velocity = turn(truth.velocity_mps, yaw_error)
            error = tuple(p - t for p, t in zip(pose.velocity_mps, true_velocity, strict=True))
            self._velocity_error_mps = _blend(self._velocity_error_mps, error, gain)  # type: ignore[arg-type]
        else:
            self._velocity_error_mps = _blend(self._velocity_error_mps, ZERO, gain)
        self._velocity_s = now_s
        self._last_sample_s = now_s
        self.counts["position" if fused_position else "velocity only"] += 1
        return True

    def _position(self, truth: Truth, valid: bool) -> Vector:
        if valid:
            return self._believed_position(truth)
        if self._velocity_s is None:
            return ZERO  # at rest without any aid PX4 reports its origin
        return UNKNOWN

    def _believed_position(self, truth: Truth) -> Vector:
        turned = turn(truth.position_m, self._yaw_error_rad)
        o = self._offset_m
        return turned[0] + o[0], turned[1] + o[1], turned[2] + o[2]

    def _drift(self, dt_s: float) -> None:
        """Without fresh positions the velocity error carries the position away."""
        if self._position_s is None or self._history[-1].stamp_s - self._last_sample_s < 0.2:
            return
        o, e = self._offset_m, self._velocity_error_mps
        self._offset_m = (o[0] + e[0] * dt_s, o[1] + e[1] * dt_s, o[2] + e[2] * dt_s)

    def _truth_at(self, stamp_s: float) -> Truth:
        """The truth nearest to a stamp, as far back as the history goes."""
        history = self._history
        newest = history[-1]
        if len(history) < 2 or stamp_s >= newest.stamp_s:
            return newest
        step_s = (newest.stamp_s - history[0].stamp_s) / (len(history) - 1)
        back = round((newest.stamp_s - stamp_s) / step_s) if step_s > 0.0 else 0
        return history[max(0, len(history) - 1 - back)]


def _recent(stamp_s: float | None, now_s: float) -> bool:
    return stamp_s is not None and now_s - stamp_s <= TIMEOUT_S


def _blend(old: Vector, new: Vector, gain: float) -> Vector:
    return (
        old[0] + gain * (new[0] - old[0]),
        old[1] + gain * (new[1] - old[1]),
        old[2] + gain * (new[2] - old[2]),
    )
