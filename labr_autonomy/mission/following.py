"""From the course to what leaves: wheel speeds and air set-points, each past the guard. No I/O, no clock."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import yaw_of
from labr_autonomy.ground.tracking import LOST_M, follow
from labr_autonomy.guard.fence import Zone
from labr_autonomy.guard.setpoint import check_setpoint
from labr_autonomy.mission.course import Course
from labr_autonomy.planner.messages import PlanResult
from labr_autonomy.types import Mode, Odometry, SetPoint

LATE_PLAN_S = 0.3  # a plan whose beginning is longer ago than this is not followed
SAY_AGAIN_S = 5.0  # the guard's word on the same matter


class Following:
    """Follows a course, as far as the guard lets it.

    Args:
        config: The robot.

    Attributes:
        course: What is followed.
        zones: Fences.
        floor_z_m: Floor below the robot, odom.
    """

    def __init__(self, config: RobotConfig) -> None:
        self.course = Course()
        self.zones: Sequence[Zone] = ()
        self.floor_z_m = 0.0
        self._config = config
        self._said_s: dict[str, float] = {}
        self._staying = False  # a place in the air is held, whatever the planner says
        self._passed: SetPoint | None = None  # the last air set-point that the guard let pass

    def take(self, result: PlanResult, mode: Mode | None, now_s: float) -> None:
        """Follow a plan, unless it came too late, is for another mode or a place is held."""
        plan = result.trajectory
        if plan is None or plan.mode is not mode or now_s > plan.start_s + LATE_PLAN_S:
            return
        if plan.mode is Mode.AIR and self._staying:
            return
        self.course.take(plan, result.frame_stamp_s)

    def drive(
        self, odometry: Odometry | None, now_s: float, events: list[str]
    ) -> tuple[SetPoint | None, float, float]:
        """Reference, speed [m/s] and yaw rate [rad/s] of the wheels; they rest without a reference."""
        reference = self.course.land(now_s)
        if reference is None or odometry is None:
            return None, 0.0, 0.0
        pose = odometry.pose
        wanted = follow(
            reference, float(pose.position_m[0]), float(pose.position_m[1]), yaw_of(pose.quaternion)
        )
        if wanted.error_m > LOST_M:
            events.append(f"{wanted.error_m:.2f} m off the trajectory; planning anew")
            self.course.drop()
            return None, 0.0, 0.0
        asked = replace(reference, speed_mps=wanted.speed_mps, yaw_rate_rps=wanted.yaw_rate_rps)
        checked = self._checked(asked, now_s, events)
        if checked is None:
            return reference, 0.0, 0.0
        return reference, checked.speed_mps, checked.yaw_rate_rps

    def fly(self, flying: bool, held: bool, now_s: float, events: list[str]) -> SetPoint | None:
        """The set-point in the air.

        Args:
            flying: Neither on the way up nor down.
            held: Stay where the set-points have come to.
            now_s: The present.
            events: Gets what the guard says.
        """
        course = self.course
        self._staying = flying and held
        if self._staying:
            course.hold_reference(now_s)
        checked = self._checked(course.air(now_s), now_s, events)
        if checked is None and flying and self._passed is not None:  # stay where the guard let it be
            course.hold_place(self._passed, now_s)
            checked = course.air(now_s)
        self._passed = checked
        return checked

    def _checked(self, setpoint: SetPoint, now_s: float, events: list[str]) -> SetPoint | None:
        verdict = check_setpoint(setpoint, self._config, self.zones, self.floor_z_m, now_s)
        if verdict.setpoint is None and now_s - self._said_s.get(verdict.code, -math.inf) > SAY_AGAIN_S:
            events.append(f"guard: {verdict.reason}")
            self._said_s[verdict.code] = now_s
        return verdict.setpoint
