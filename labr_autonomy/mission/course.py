"""What is being followed: the trajectory, or the place to hold, and where a new plan has to begin. Pure."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from labr_autonomy.frames import wrap_pi, yaw_of
from labr_autonomy.modes.vertical import vertical
from labr_autonomy.planner.messages import Motion
from labr_autonomy.types import Array, Mode, Odometry, SetPoint, Trajectory

FRESH_ERROR_M = 0.25  # further off its trajectory than this, the robot is planned from where it is


class Course:
    """The trajectory that is being followed, or the place in the air that is being held."""

    def __init__(self) -> None:
        self.trajectory: Trajectory | None = None
        self.frame_stamp_s: float | None = None  # exposure behind the followed plan
        self._hold: SetPoint | None = None
        self._fresh = True

    def drop(self) -> None:
        """Forget the trajectory; the next plan starts from where the robot is."""
        self.trajectory = None
        self._fresh = True

    def hold_here(self, odometry: Odometry, now_s: float) -> None:
        """Hold the place where the robot is."""
        self.drop()
        self._hold = _rest(odometry.pose.position_m, yaw_of(odometry.pose.quaternion), now_s)

    def hold_reference(self, now_s: float) -> None:
        """Hold the place that the set-points have come to."""
        self.hold_place(self.air(now_s), now_s)

    def hold_place(self, place: SetPoint, now_s: float) -> None:
        """Hold the place and heading of a set-point."""
        self.drop()
        self._hold = _rest(place.position_m, place.yaw_rad, now_s)

    def climb(
        self,
        to_z_m: float,
        speed_mps: float,
        now_s: float,
        heading_rad: float = math.nan,
        yaw_rate_rps: float = 1.0,
    ) -> None:
        """Go straight up or down from the present set-point, turning to a heading unless it is NaN."""
        start = self.air(now_s)
        turn_rad = 0.0 if math.isnan(heading_rad) else wrap_pi(heading_rad - start.yaw_rad)
        turn = (turn_rad, yaw_rate_rps)
        self.trajectory = vertical(start.position_m, start.yaw_rad, to_z_m, speed_mps, now_s, turn)
        self._hold = None
        self._fresh = True

    def take(self, plan: Trajectory, frame_stamp_s: float) -> None:
        """Follow a new plan."""
        self.trajectory = plan
        self.frame_stamp_s = frame_stamp_s
        if plan.mode is Mode.AIR:
            self._hold = None

    def wants_fresh(self) -> bool:
        """Whether the planner shall forget its previous plan; asked once per request."""
        fresh, self._fresh = self._fresh, False
        return fresh

    def land(self, now_s: float) -> SetPoint | None:
        """The reference on land; None without a land trajectory."""
        plan = self.trajectory
        return plan.sample(now_s) if plan is not None and plan.mode is Mode.LAND else None

    def air(self, now_s: float) -> SetPoint:
        """The set-point in the air: the trajectory's, else the place to hold."""
        if self.trajectory is not None and self.trajectory.mode is Mode.AIR:
            return self.trajectory.sample(now_s)
        assert self._hold is not None, "the rotors are commanded from ARMING on, which sets the place to hold"
        return replace(self._hold, stamp_s=now_s)

    def motion_at(self, start_s: float, mode: Mode | None, odometry: Odometry, now_s: float) -> Motion:
        """Where the robot will be at `start_s`: on its trajectory while it tracks it, else where it is.

        Args:
            start_s: When a new plan begins.
            mode: What is being planned for; None during a hand-over.
            odometry: The present estimate.
            now_s: The present.
        """
        position, yaw = odometry.pose.position_m, yaw_of(odometry.pose.quaternion)
        plan = self.trajectory
        if plan is not None and plan.mode is mode:
            axes = 2 if mode is Mode.LAND else 3
            if math.dist(plan.sample(now_s).position_m[:axes], position[:axes]) < FRESH_ERROR_M:
                then = plan.sample(start_s)
                there = then.position_m.copy()
                there[axes:] = position[axes:]
                v, a = then.velocity_mps, then.acceleration_mps2
                return Motion(there, v, a, then.yaw_rad, then.yaw_rate_rps, then.speed_mps)
        if mode is Mode.AIR and self._hold is not None:
            return Motion(self._hold.position_m, np.zeros(3), np.zeros(3), self._hold.yaw_rad, 0.0, 0.0)
        v = odometry.velocity_mps
        speed = float(v[0] * math.cos(yaw) + v[1] * math.sin(yaw))
        return Motion(position, v, np.zeros(3), yaw, float(odometry.angular_velocity_rps[2]), speed)


def _rest(position_m: Array, yaw_rad: float, now_s: float) -> SetPoint:
    zero = np.zeros(3)
    return SetPoint(now_s, Mode.AIR, position_m.copy(), zero, zero, yaw_rad, 0.0, 0.0)
