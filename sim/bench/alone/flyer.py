"""Following a path in the air, rolled forward into a trajectory that ends at rest at the path's end.

The land follower's law (`sim.bench.iplanner.follower`) for a mass that can be pushed any way: aim at the
first point of the path beyond the look-ahead distance, as fast as the rest of the path can be braked on, and
only while the camera looks there. Velocity is chased by a bounded acceleration of bounded jerk.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from labr_autonomy.config import AirLimits, RobotConfig
from labr_autonomy.planner.messages import Motion
from labr_autonomy.refine.air import YAW_ACCELERATION_RPS2
from labr_autonomy.types import Array, Mode, Source, Trajectory

TICK_S = 0.01
STRIDE = 5  # ticks from one point of the trajectory to the next
LONGEST_S = 25.0  # a 9 m path with a turn takes 14 s
HALT_S = 4.0  # more than coming to rest takes
LOOK_AHEAD_M = 0.4
CRUISE = 0.92  # of the speed limits: tracking needs the rest
PUSH = 0.5  # of the limits of acceleration and jerk, for the same reason
BRAKE = 0.25  # of the limit of acceleration is planned with before the end
END_GAIN = 1.2  # [1/s] speed over the distance left, close to the end
SPEED_GAIN = 3.0  # [1/s]
FACE_M = 0.3  # a point nearer than this in the plane needs no turn
ALIGNED_RAD, ASIDE_RAD = 0.3, 0.8  # full speed up to the first bearing, none from the second on
THERE_M, REST_MPS, REST_RPS = 0.01, 0.01, 0.01


def fly_along(
    path_m: Array, motion: Motion, limits: AirLimits, start_s: float, source: Source, *, stay: bool = False
) -> Trajectory:
    """Where a robot gets that flies along a path, from the point of it that it has come to.

    Args:
        path_m: (n, 3) odom.
        motion: At the start.
        limits: Of the robot.
        start_s: Stamp of the first point.
        source: Who proposed the path.
        stay: Come to rest instead.
    """
    path = np.ascontiguousarray(path_m, dtype=np.float64)
    here = motion.position_m
    passed = int(np.argmin(np.linalg.norm(path - here, axis=1)))
    state = np.concatenate(
        [here, motion.velocity_mps, motion.acceleration_mps2, [motion.yaw_rad, motion.yaw_rate_rps]]
    )
    rows = _roll(path[passed:], state, _vector(limits), stay)
    velocity, yaw = rows[:, 3:6].copy(), rows[:, 9].copy()
    return Trajectory(
        mode=Mode.AIR,
        start_s=start_s,
        step_s=TICK_S * STRIDE,
        position_m=rows[:, :3].copy(),
        velocity_mps=velocity,
        acceleration_mps2=rows[:, 6:9].copy(),
        yaw_rad=yaw,
        yaw_rate_rps=rows[:, 10].copy(),
        speed_mps=velocity[:, 0] * np.cos(yaw) + velocity[:, 1] * np.sin(yaw),
        source=source,
    )


def warm_up() -> None:
    """Compile the loop."""
    zero = np.zeros(3)
    fly_along(np.zeros((1, 3)), Motion(zero, zero, zero, 0.0, 0.0, 0.0), RobotConfig().air, 0.0, Source.BRAKE)


def _vector(limits: AirLimits) -> Array:
    """In the order that `_roll` reads."""
    return np.array(
        [
            CRUISE * limits.speed_mps,
            CRUISE * limits.climb_mps,
            CRUISE * limits.descend_mps,
            PUSH * limits.acceleration_mps2,
            PUSH * limits.jerk_mps3,
            BRAKE * limits.acceleration_mps2,
            limits.yaw_rate_rps,
            YAW_ACCELERATION_RPS2,
        ]
    )


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _shortened(vector: np.ndarray, most: float) -> np.ndarray:
    """The vector (3,), at most so long."""
    length = math.sqrt((vector * vector).sum())
    return vector if length <= most else vector * (most / length)


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _roll(path: np.ndarray, state: np.ndarray, limits: np.ndarray, stay: bool) -> np.ndarray:
    """States (k, 11), the last one at rest: place, velocity, acceleration, yaw and its rate."""
    top, climb, descend, push, jerk, brake, turn_top, turn_push = limits
    p, v, a = state[0:3].copy(), state[3:6].copy(), state[6:9].copy()
    yaw, rate = state[9], state[10]
    last = len(path) - 1
    rest = np.zeros(last + 1)  # of the path beyond each point
    for i in range(last - 1, -1, -1):
        leg = path[i + 1] - path[i]
        rest[i] = rest[i + 1] + math.sqrt((leg * leg).sum())
    ticks, longest = int(LONGEST_S / TICK_S), int((LONGEST_S + HALT_S) / TICK_S)
    rows = np.empty((longest // STRIDE + 2, 11))
    used, at = 0, 0
    for tick in range(longest):
        if tick % STRIDE == 0:
            rows[used, 0:3], rows[used, 3:6], rows[used, 6:9] = p, v, a
            rows[used, 9], rows[used, 10] = yaw, rate
            used += 1
        to = path[at] - p
        while at < last and math.sqrt((to * to).sum()) < LOOK_AHEAD_M:
            at += 1
            to = path[at] - p
        away = math.sqrt((to * to).sum())
        halts = stay or tick >= ticks
        wanted = np.zeros(3)
        turn = 0.0
        if not halts and away > 0.0:
            left = away + rest[at]
            wanted = to / away * min(top, END_GAIN * left, math.sqrt(2.0 * brake * left))
            flat = math.hypot(to[0], to[1])
            if flat > FACE_M:
                off = (math.atan2(to[1], to[0]) - yaw + math.pi) % (2.0 * math.pi) - math.pi
                turn = math.copysign(
                    min(turn_top, math.sqrt(1.6 * turn_push * abs(off)), 4.0 * abs(off)), off
                )
                wanted *= min(max((ASIDE_RAD - abs(off)) / (ASIDE_RAD - ALIGNED_RAD), 0.0), 1.0)
            up = climb if wanted[2] > 0.0 else descend
            if abs(wanted[2]) > up:
                wanted *= up / abs(wanted[2])
        pushed = _shortened(SPEED_GAIN * (wanted - v), push)
        change = _shortened(pushed - a, jerk * TICK_S)
        p = p + v * TICK_S + 0.5 * a * TICK_S * TICK_S
        v = v + (a + 0.5 * change) * TICK_S
        a = a + change
        turned = min(max(turn - rate, -turn_push * TICK_S), turn_push * TICK_S)
        yaw += (rate + 0.5 * turned) * TICK_S
        rate += turned
        slow = math.sqrt((v * v).sum()) < REST_MPS and math.sqrt((a * a).sum()) < push * 0.1
        if slow and abs(rate) < REST_RPS and (halts or (at == last and away < THERE_M)):
            break
    rows[used, 0:3], rows[used, 3:9] = p, 0.0
    rows[used, 9], rows[used, 10] = yaw, 0.0
    return rows[: used + 1]
