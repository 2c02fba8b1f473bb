"""iPlanner's path follower, rolled forward on the robot's unicycle into a trajectory that ends at rest.

The 100 Hz law of MichaelFYang/iplanner_path_follow @ aa526a9 (`pathFollower.cpp`, forward driving only): aim
at the first point of the path beyond the look-ahead distance, turn in proportion to its bearing, speed up
while it lies nearly ahead and brake otherwise, slow down near the end. Its speeds and accelerations are those
of our robot (`config.land`) where they are lower, and its yaw rate, which it lets jump, is ramped as the
wheels can.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.types import Array, Mode, Source, Trajectory

TICK_S = 0.01  # the follower's loop
STRIDE = 5  # ticks from one point of the trajectory to the next
LONGEST_S = 20.0  # a 9 m path and a turn take 14 s
AT_REST = 1e-6  # [m/s, rad/s]


@dataclass(frozen=True, slots=True)
class FollowerLimits:
    """Parameters of the follower: its launch file's, lowered to the robot's."""

    look_ahead_m: float  # 0.25 and the sensor's offset
    speed_mps: float
    acceleration_mps2: float
    yaw_rate_rps: float
    yaw_acceleration_rps2: float
    yaw_gain: float = 4.0  # [1/s] while rolling
    stop_yaw_gain: float = 4.5  # [1/s] on the spot
    aligned_rad: float = 0.2  # bearing up to which it speeds up
    stop_m: float = 0.2  # from the end
    slow_m: float = 0.7  # from the end
    momentum: float = 0.25  # share of the previous tick's bearing

    @classmethod
    def of(cls, config: RobotConfig) -> FollowerLimits:
        """For a robot: published 1.5 m/s, 2.5 m/s^2 and 90 deg/s, or what its wheels may do."""
        land = config.land
        return cls(
            look_ahead_m=0.25 + abs(config.camera.x_m),
            speed_mps=min(1.5, land.speed_mps),
            acceleration_mps2=min(2.5, land.acceleration_mps2),
            yaw_rate_rps=min(math.pi / 2.0, land.yaw_rate_rps),
            yaw_acceleration_rps2=land.yaw_acceleration_rps2,
        )

    def vector(self) -> Array:
        """In the order that `_roll` reads."""
        return np.array(
            [
                self.look_ahead_m,
                self.speed_mps,
                self.acceleration_mps2,
                self.yaw_rate_rps,
                self.yaw_acceleration_rps2,
                self.yaw_gain,
                self.stop_yaw_gain,
                self.aligned_rad,
                self.stop_m,
                self.slow_m,
                self.momentum,
            ]
        )


def roll_out(
    path_xy_m: Array,
    state: Array,
    limits: FollowerLimits,
    start_s: float,
    height_m: float,
    source: Source,
) -> Trajectory:
    """Where the follower takes the robot, from the point of the path that it has come to.

    Args:
        path_xy_m: (n, 2) odom; a single point means stop.
        state: (5,) x, y [m], yaw [rad] in odom, speed [m/s], yaw rate [rad/s] at the start.
        limits: Of follower and robot.
        start_s: Stamp of the first point.
        height_m: Of the body in odom.
        source: Who proposed the path.
    """
    path = np.ascontiguousarray(path_xy_m, dtype=np.float64)
    passed = int(np.argmin(np.hypot(path[:, 0] - state[0], path[:, 1] - state[1])))
    rows = _roll(path[passed:], np.asarray(state, dtype=np.float64), limits.vector(), len(path) <= 1)
    return as_trajectory(rows, start_s, height_m, source)


def warm_up() -> None:
    """Compile the follower's loop."""
    limits = FollowerLimits.of(RobotConfig())
    roll_out(np.zeros((1, 2)), np.zeros(5), limits, 0.0, 0.0, Source.BRAKE)


def as_trajectory(rows: Array, start_s: float, height_m: float, source: Source) -> Trajectory:
    """States (k, 5) every `STRIDE` ticks as a trajectory."""
    step_s = TICK_S * STRIDE
    yaw, v, w = rows[:, 2], rows[:, 3], rows[:, 4]
    c, s, zero = np.cos(yaw), np.sin(yaw), np.zeros(len(rows))
    dv = np.append(np.diff(v) / step_s, 0.0)
    return Trajectory(
        mode=Mode.LAND,
        start_s=start_s,
        step_s=step_s,
        position_m=np.stack([rows[:, 0], rows[:, 1], np.full(len(rows), height_m)], axis=1),
        velocity_mps=np.stack([v * c, v * s, zero], axis=1),
        acceleration_mps2=np.stack([dv * c - v * w * s, dv * s + v * w * c, zero], axis=1),
        yaw_rad=yaw.copy(),
        yaw_rate_rps=w.copy(),
        speed_mps=v.copy(),
        source=source,
    )


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _toward(value: float, target: float, most: float) -> float:
    """One tick of a ramp."""
    return value + min(max(target - value, -most), most)


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _roll(path: np.ndarray, state: np.ndarray, p: np.ndarray, stay: bool) -> np.ndarray:
    """States (k, 5), the last one at rest; the follower's loop and the robot's motion between its ticks."""
    ahead, top, accel, turn_top, turn_accel, gain, stop_gain, aligned, stop, slow, momentum = p
    x, y, yaw, v, w = state
    last = len(path) - 1
    ticks = int(LONGEST_S / TICK_S)
    longest = ticks + int((top + 1.0) / (accel * TICK_S)) + int((turn_top + 1.0) / (turn_accel * TICK_S))
    rows = np.empty((longest // STRIDE + 2, 5))
    used, at, before = 0, 0, 0.0
    for tick in range(longest):
        if tick % STRIDE == 0:
            rows[used] = x, y, yaw, v, w
            used += 1
        while at < last and math.hypot(path[at, 0] - x, path[at, 1] - y) < ahead:
            at += 1
        dx, dy = path[at, 0] - x, path[at, 1] - y
        away = math.hypot(dx, dy)
        end = math.hypot(path[last, 0] - x, path[last, 1] - y)
        off = _wrapped(yaw - math.atan2(dy, dx))
        if abs(off) > aligned and away > ahead:
            # a target behind is turned to on the side it was first seen
            if before - off > math.pi:
                off += 2.0 * math.pi
            elif before - off < -math.pi:
                off -= 2.0 * math.pi
            off = (1.0 - momentum) * off + momentum * before
            off = min(max(off, -math.pi), math.pi)
            before = off
        else:
            before = 0.0
        turn = -(stop_gain if abs(v) < 2.0 * accel * TICK_S else gain) * off
        turn = min(max(turn, -turn_top), turn_top)
        over = stay or tick >= ticks
        if over or away < stop:
            turn = 0.0
        cruise = top * min(1.0, end / slow)
        goes = not over and abs(off) < aligned and away > stop
        v_next = _toward(v, cruise if goes else 0.0, accel * TICK_S)
        w_next = _toward(w, turn, turn_accel * TICK_S)
        middle = yaw + 0.25 * (w + w_next) * TICK_S
        x += 0.5 * (v + v_next) * math.cos(middle) * TICK_S
        y += 0.5 * (v + v_next) * math.sin(middle) * TICK_S
        yaw += 0.5 * (w + w_next) * TICK_S
        v, w = v_next, w_next
        rests = abs(v) < AT_REST and abs(w) < AT_REST
        if rests and (over or away < stop):
            break
    rows[used] = x, y, yaw, 0.0, 0.0
    return rows[: used + 1]
