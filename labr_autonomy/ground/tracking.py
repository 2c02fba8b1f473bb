"""Follow a land trajectory: feed-forward plus posture feedback (Kanayama et al., ICRA 1990). Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

from labr_autonomy.frames import wrap_pi
from labr_autonomy.types import SetPoint

ALONG_GAIN = 1.5  # [1/s]
ACROSS_GAIN = 5.0  # [1/m^2]
HEADING_GAIN = 2.5  # [1/m] while rolling, [1/s] on the spot
LOST_M = 0.6  # further off the trajectory than this, following it makes no sense


@dataclass(frozen=True, slots=True)
class BodyVelocity:
    """What the wheels are asked for."""

    speed_mps: float
    yaw_rate_rps: float
    error_m: float  # distance to the reference


def follow(reference: SetPoint, x_m: float, y_m: float, yaw_rad: float) -> BodyVelocity:
    """Body velocity that brings the robot onto its moving reference.

    Args:
        reference: Where the robot should be now and how it should move, odom.
        x_m: Estimated position, odom.
        y_m: Estimated position, odom.
        yaw_rad: Estimated heading, odom.
    """
    dx, dy = float(reference.position_m[0]) - x_m, float(reference.position_m[1]) - y_m
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    along, across = c * dx + s * dy, -s * dx + c * dy
    heading = wrap_pi(reference.yaw_rad - yaw_rad)
    v_ref = reference.speed_mps
    speed = v_ref * math.cos(heading) + ALONG_GAIN * along
    if abs(v_ref) < 0.05:  # on the spot the sideways error cannot be steered out
        turn = reference.yaw_rate_rps + HEADING_GAIN * heading
    else:
        turn = (
            reference.yaw_rate_rps
            + ACROSS_GAIN * v_ref * across
            + HEADING_GAIN * max(abs(v_ref), 0.3) * math.sin(heading)
        )
    return BodyVelocity(speed, turn, math.hypot(dx, dy))
