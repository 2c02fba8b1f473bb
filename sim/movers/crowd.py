"""All movers of a world over time, and how near they are to the robot. The rules are the package's.

The state follows from the movers, the steps and the robot's true way alone, so the same seed gives the same
flight.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import yaw_of
from labr_autonomy.types import Array
from sim.movers.mover import Mover, Placed
from sim.quad.state import QuadState

ACCELERATION_MPS2 = 1.5  # a person is at walking speed after about a second
KEEP_M = 0.3  # how short of a standing robot a person stops
TURN_BACK_S = 2.0  # how long one who has been stopped stands before going back
SET_OUT_M = 1.0  # nobody sets out towards a robot nearer than this
PATIENCE_S = 3.0  # unless it has stood in the way for so long
NOTICED_S = 0.5  # a person sees that the robot stands when it has been at rest for so long
STANDING_S = 1.0  # at rest for so long, the robot has done what it could
UNSEEN_S = 1.0  # out of the camera's view for so long, no image could have told of a mover
REST_MPS = 0.05  # on wheels, slower than this is at rest
HOVER_MPS = 0.2  # in the air: a hover sways by so much in gusts
NEAR_M = 4.0  # farther movers are not measured
FAR_M = math.inf


@dataclass(slots=True)
class _Walk:
    """Where one mover is on its track."""

    along_m: float
    way: float  # 1 towards the second end, -1 towards the first
    speed_mps: float = 0.0
    wait_s: float = 0.0
    held_s: float = 0.0  # how long it has put off setting out
    unseen_s: float = math.inf  # how long it has been out of the camera's field of view


class Crowd:
    """Movers at work.

    Args:
        movers: Who.
        robot: Its outline, and where its camera looks.
    """

    def __init__(self, movers: Sequence[Mover], robot: RobotConfig) -> None:
        self.movers = tuple(movers)
        self._body = robot.body
        self._half_view_rad = math.atan(0.5 * robot.camera.width / robot.camera.fx)
        self._view_m = robot.camera.range_max_m
        self._walks = [_Walk(m.along_m, 1.0 if m.forth else -1.0) for m in self.movers]
        self._rest_s = 0.0
        self.placed: tuple[Placed, ...] = tuple(m.at(m.along_m) for m in self.movers)
        self.clearance_m = FAR_M  # of the nearest mover to the robot; inf while none is near
        self.nearest: int | None = None  # its number

    @property
    def along_m(self) -> list[float]:
        """How far along its track each mover is [m]."""
        return [walk.along_m for walk in self._walks]

    @property
    def robot_stands(self) -> bool:
        """Whether the robot has been at rest for the last `STANDING_S`."""
        return self._rest_s >= STANDING_S - 1e-9

    @property
    def nearest_unseen(self) -> bool:
        """Whether the nearest mover has been out of the camera's view for the last `UNSEEN_S`."""
        return self.nearest is not None and self._walks[self.nearest].unseen_s >= UNSEEN_S

    def step(
        self,
        dt_s: float,
        position_m: Array,
        velocity_mps: Array,
        *,
        on_wheels: bool,
        yaw_rad: float = 0.0,
    ) -> None:
        """Everybody walks on.

        Args:
            dt_s: Length of the step.
            position_m: (3,) true body origin of the robot, odom.
            velocity_mps: (3,) true, odom.
            on_wheels: The robot stands or drives.
            yaw_rad: Its true heading, along which the camera looks.
        """
        x, y, z = (float(v) for v in position_m)
        vx, vy, vz = (float(v) for v in velocity_mps)
        limit = REST_MPS if on_wheels else HOVER_MPS
        still = vx * vx + vy * vy + vz * vz < limit * limit
        self._rest_s = self._rest_s + dt_s if still else 0.0
        best, nearest = FAR_M, None
        placed = []
        for number, (mover, walk, now) in enumerate(zip(self.movers, self._walks, self.placed, strict=True)):
            near = abs(now.x_m - x) < NEAR_M and abs(now.y_m - y) < NEAR_M
            gap_m = now.clearance_m(x, y, z, self._body) if near else FAR_M
            there = self._walked(mover, walk, now, dt_s, gap_m, (x, y, z))
            if near and there is not now:
                gap_m = there.clearance_m(x, y, z, self._body)
            self._look(walk, there, dt_s, (x, y), yaw_rad)
            if gap_m < best:
                best, nearest = gap_m, number
            placed.append(there)
        self.placed = tuple(placed)
        self.clearance_m, self.nearest = best, nearest

    def watch(self, dt_s: float, robot: QuadState) -> None:
        """Everybody walks on, beside the robot as it truly is."""
        self.step(
            dt_s,
            robot.position_m,
            robot.velocity_mps,
            on_wheels=robot.on_wheels,
            yaw_rad=yaw_of(robot.quaternion),
        )

    def _look(
        self, walk: _Walk, there: Placed, dt_s: float, robot_m: tuple[float, float], yaw_rad: float
    ) -> None:
        """Whether the mover's middle is in the camera's field of view; walls are not looked at."""
        dx, dy = there.x_m - robot_m[0], there.y_m - robot_m[1]
        aside = math.remainder(math.atan2(dy, dx) - yaw_rad, math.tau)
        seen = abs(aside) < self._half_view_rad and math.hypot(dx, dy) < self._view_m
        walk.unseen_s = 0.0 if seen else walk.unseen_s + dt_s

    def _walked(
        self,
        mover: Mover,
        walk: _Walk,
        now: Placed,
        dt_s: float,
        gap_m: float,
        robot_m: tuple[float, float, float],
    ) -> Placed:
        """One mover's step; where it is then."""
        if walk.wait_s > 0.0:
            walk.wait_s -= dt_s
            return now
        rest_m = mover.length_m - walk.along_m if walk.way > 0.0 else walk.along_m
        if rest_m <= 1e-3:
            pause_s = mover.pauses_s[1 if walk.way > 0.0 else 0]
            walk.way, walk.speed_mps, walk.wait_s = -walk.way, 0.0, pause_s
            return now
        speed = min(mover.speed_mps, walk.speed_mps + ACCELERATION_MPS2 * dt_s)
        speed = min(speed, math.sqrt(2.0 * ACCELERATION_MPS2 * rest_m))
        there = mover.at(walk.along_m + walk.way * min(speed * dt_s, rest_m))
        if gap_m < SET_OUT_M and there.clearance_m(*robot_m, self._body) < gap_m:
            if gap_m <= 0.0 or self._stops_short(mover, gap_m):
                walk.way, walk.speed_mps, walk.wait_s = -walk.way, 0.0, TURN_BACK_S
                return now
            if walk.speed_mps == 0.0 and walk.held_s < PATIENCE_S:
                walk.held_s += dt_s
                return now
        walk.speed_mps, walk.held_s = speed, 0.0
        walk.along_m += walk.way * min(speed * dt_s, rest_m)
        return there

    def _stops_short(self, mover: Mover, gap_m: float) -> bool:
        return mover.shape.kind == "person" and self._rest_s >= NOTICED_S and gap_m <= KEEP_M
