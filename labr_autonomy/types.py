"""Values that cross rooms. Frames: odom ENU, body FLU, level = yaw-only body. SI units, radians.

Quaternions are (w, x, y, z), Hamilton, rotating body vectors into odom. Stamps are seconds of the
injected clock (`labr_autonomy.clock`). Arrays are read-only by convention: build a new value instead.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Image = NDArray[np.float32]


class Mode(enum.Enum):
    """Which means of locomotion carries the robot."""

    LAND = "land"
    AIR = "air"


class Source(enum.Enum):
    """Who proposed the path that a trajectory follows; written into every log record."""

    GKPN = "gkpn"  # the network's key points
    SEARCH = "search"  # shortest path on the rolling map, used when the network's path is not usable
    PREVIOUS = "previous"  # the previous plan, shifted
    TURN = "turn"  # turning on the spot towards the path
    BRAKE = "brake"  # coming to rest
    DIRECT = "direct"  # straight up, down, or to the goal where nothing is in the way


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """Pinhole camera without distortion."""

    width: int
    height: int
    fx: float  # [px]
    fy: float  # [px]
    cx: float  # [px]
    cy: float  # [px]


@dataclass(frozen=True, slots=True)
class Pose:
    """Pose of body in odom."""

    position_m: Array  # (3,) odom
    quaternion: Array  # (4,) wxyz, body to odom


@dataclass(frozen=True, slots=True)
class Odometry:
    """Estimated motion of the body at one instant."""

    stamp_s: float
    pose: Pose
    velocity_mps: Array  # (3,) odom
    angular_velocity_rps: Array  # (3,) body
    covariance: Array  # (6, 6) position [m^2] odom, then rotation [rad^2] body


@dataclass(frozen=True, slots=True)
class ImuSample:
    """One inertial measurement."""

    stamp_s: float
    specific_force_mps2: Array  # (3,) body; +g on z at rest
    angular_velocity_rps: Array  # (3,) body


@dataclass(frozen=True, slots=True)
class WheelOdometry:
    """Motion reported by the land controller's encoders."""

    stamp_s: float
    speed_mps: float  # forward, body
    yaw_rate_rps: float
    left_ticks: int
    right_ticks: int


@dataclass(frozen=True, slots=True)
class DepthFrame:
    """One depth image."""

    sequence: int
    stamp_s: float  # mid-exposure
    depth_m: Image  # (h, w) float32 along the optical axis; 0 = invalid
    intrinsics: Intrinsics


@dataclass(frozen=True, slots=True)
class KeyPoints:
    """A coarse path from the robot to the goal."""

    points_m: Array  # (n, 3) odom
    air: NDArray[np.bool_]  # (n,) True where the point is flown to
    mu: float  # collision probability of the path, 0..1
    source: Source


@dataclass(frozen=True, slots=True)
class SetPoint:
    """Where the robot should be at one instant, and how it should be moving."""

    stamp_s: float
    mode: Mode
    position_m: Array  # (3,) odom
    velocity_mps: Array  # (3,) odom
    acceleration_mps2: Array  # (3,) odom
    yaw_rad: float  # odom
    yaw_rate_rps: float
    speed_mps: float  # along the body's x axis; negative when backing


@dataclass(frozen=True, slots=True)
class Trajectory:
    """A path in time on an even grid; the robot rests at its last point from then on."""

    mode: Mode
    start_s: float
    step_s: float
    position_m: Array  # (k, 3) odom
    velocity_mps: Array  # (k, 3) odom
    acceleration_mps2: Array  # (k, 3) odom
    yaw_rad: Array  # (k,) odom, unwrapped
    yaw_rate_rps: Array  # (k,)
    speed_mps: Array  # (k,) along body x, signed
    source: Source = field(default=Source.GKPN)

    @property
    def end_s(self) -> float:
        """Stamp of the last point [s]."""
        return self.start_s + self.step_s * (len(self.yaw_rad) - 1)

    def sample(self, now_s: float) -> SetPoint:
        """Interpolate at `now_s`; before the start the first point, after the end rest at the last.

        Positions follow the cubic through places and velocities of both ends of an interval, in the air
        velocities its derivative: what piecewise constant jerk flies, exactly. On chords instead, a place
        would be up to a h^2 / 8 off, and a velocity j h^2 / 8, which is a state that the plan never has.
        """
        last = len(self.yaw_rad) - 1
        u = min(max((now_s - self.start_s) / self.step_s, 0.0), float(last))
        i = min(int(u), last - 1) if last > 0 else 0
        f = u - i if last > 0 else 0.0
        j = min(i + 1, last)
        moving = now_s < self.end_s

        def mix(values: Array) -> Array:
            blended: Array = values[i] * (1.0 - f) + values[j] * f
            return blended

        zero = np.zeros(3)
        way = self.position_m[j] - self.position_m[i]
        leaves = self.step_s * self.velocity_mps[i] - way  # what the ends' velocities add to the chord
        arrives = self.step_s * self.velocity_mps[j] - way
        bend = f * (1.0 - f) * ((1.0 - f) * leaves - f * arrives)
        velocity = mix(self.velocity_mps)
        if self.mode is Mode.AIR:
            turn = (1.0 - f) * (1.0 - 3.0 * f) * leaves - f * (2.0 - 3.0 * f) * arrives
            velocity = (way + turn) / self.step_s
        return SetPoint(
            stamp_s=now_s,
            mode=self.mode,
            position_m=mix(self.position_m) + bend,
            velocity_mps=velocity if moving else zero,
            acceleration_mps2=mix(self.acceleration_mps2) if moving else zero,
            yaw_rad=float(mix(self.yaw_rad)),
            yaw_rate_rps=float(mix(self.yaw_rate_rps)) if moving else 0.0,
            speed_mps=float(mix(self.speed_mps)) if moving else 0.0,
        )
