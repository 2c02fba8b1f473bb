"""What the companion sends to the autopilot, as MAVLink fields; pure.

Set-points: SET_POSITION_TARGET_LOCAL_NED in MAV_FRAME_LOCAL_NED. Poses: ODOMETRY in MAV_FRAME_LOCAL_FRD
with child MAV_FRAME_BODY_FRD, the only pair that both PX4 and ArduPilot fuse (PX4 drops the position of
frame 14 without a word). "FRD" here is odom turned to north, east, down: the autopilot has no compass and
takes its heading from these poses, so its local NED frame becomes ours.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from labr_autonomy.errors import Refused
from labr_autonomy.frames import (
    enu_ned,
    flu_frd,
    quaternion_conjugate,
    quaternion_enu_flu_to_ned_frd,
    rotation_matrix,
    yaw_enu_ned,
)
from labr_autonomy.types import Array, Odometry, SetPoint

Scalar = float | int | str | None
Fields = Mapping[str, Scalar | Sequence[float | None]]

LOCAL_NED = 1  # MAV_FRAME_LOCAL_NED
BODY_FRD = 12  # MAV_FRAME_BODY_FRD
LOCAL_FRD = 20  # MAV_FRAME_LOCAL_FRD
ESTIMATOR_VIO = 3  # MAV_ESTIMATOR_TYPE_VIO
# POSITION_TARGET_TYPEMASK: no bit set = position, velocity, acceleration, yaw and yaw rate all count
USE_ALL = 0
ORIGIN_DEGE7 = (473_977_420, 85_455_940)  # latitude, longitude of ArduPilot's recorded flight
ORIGIN_MM = 489_400  # above mean sea level

_ENU_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_FLU_FRD = np.diag([1.0, -1.0, -1.0])
_TO_NED_FRD = np.block([[_ENU_NED, np.zeros((3, 3))], [np.zeros((3, 3)), _FLU_FRD]])
_UPPER = np.triu_indices(6)


def setpoint_fields(setpoint: SetPoint, start_s: float, system: int, component: int) -> Fields:
    """Fields of SET_POSITION_TARGET_LOCAL_NED (84).

    Args:
        setpoint: Where to be, odom ENU.
        start_s: Stamp that becomes `time_boot_ms` 0 [s].
        system: Target system id.
        component: Target component id.

    Raises:
        Refused: A value is not finite, or it is older than the link.
    """
    odom = np.array([setpoint.position_m, setpoint.velocity_mps, setpoint.acceleration_mps2])
    position, velocity, acceleration = enu_ned(odom).tolist()
    values = [*position, *velocity, *acceleration, setpoint.yaw_rad, setpoint.yaw_rate_rps, setpoint.stamp_s]
    if not all(map(math.isfinite, values)):
        raise Refused(
            "a set-point with a value that is not finite was not sent", "Look at the planner's log."
        )
    return {
        "time_boot_ms": max(0, int((setpoint.stamp_s - start_s) * 1e3)) & 0xFFFFFFFF,
        "target_system": system,
        "target_component": component,
        "coordinate_frame": LOCAL_NED,
        "type_mask": USE_ALL,
        "x": position[0],
        "y": position[1],
        "z": position[2],
        "vx": velocity[0],
        "vy": velocity[1],
        "vz": velocity[2],
        "afx": acceleration[0],
        "afy": acceleration[1],
        "afz": acceleration[2],
        "yaw": yaw_enu_ned(setpoint.yaw_rad),
        "yaw_rate": -setpoint.yaw_rate_rps,
    }


def origin_fields(system: int) -> Fields:
    """Fields of SET_GPS_GLOBAL_ORIGIN (48): ArduPilot's EKF wants one, and without GPS any place will do.

    Never for PX4: with vision its local position jumped by 5227 km.
    """
    return {
        "target_system": system,
        "latitude": ORIGIN_DEGE7[0],
        "longitude": ORIGIN_DEGE7[1],
        "altitude": ORIGIN_MM,
        "time_usec": 0,
    }


def vision_fields(odometry: Odometry) -> Fields:
    """Fields of ODOMETRY (331), time_usec on our monotonic clock.

    The autopilot translates the stamp with what it learnt from our TIMESYNC answers. The velocity's
    covariance is unknown to `Odometry` and is sent as NaN, which PX4 replaces by its own parameter.

    Raises:
        Refused: Pose or velocity are not finite.
    """
    q = odometry.pose.quaternion
    position = enu_ned(odometry.pose.position_m).tolist()
    v_body = rotation_matrix(quaternion_conjugate(q)) @ odometry.velocity_mps
    velocity, rates = flu_frd(np.array([v_body, odometry.angular_velocity_rps])).tolist()
    turned = quaternion_enu_flu_to_ned_frd(q).tolist()
    if not all(map(math.isfinite, (*position, *velocity, *rates, *turned, odometry.stamp_s))):
        raise Refused("a pose with a value that is not finite was not sent", "Look at the estimator's log.")
    return {
        "time_usec": int(odometry.stamp_s * 1e6),
        "frame_id": LOCAL_FRD,
        "child_frame_id": BODY_FRD,
        "x": position[0],
        "y": position[1],
        "z": position[2],
        "q": turned,
        "vx": velocity[0],
        "vy": velocity[1],
        "vz": velocity[2],
        "rollspeed": rates[0],
        "pitchspeed": rates[1],
        "yawspeed": rates[2],
        "pose_covariance": covariance_upper(odometry.covariance),
        "velocity_covariance": [None] * 21,
        "reset_counter": 0,
        "estimator_type": ESTIMATOR_VIO,
        "quality": 0,
    }


def covariance_upper(covariance: Array) -> list[float | None]:
    """Upper triangle, row by row, of (6, 6) turned from odom/FLU to NED/FRD; None where not finite."""
    turned = _TO_NED_FRD @ covariance @ _TO_NED_FRD.T
    return [v if math.isfinite(v) else None for v in turned[_UPPER].tolist()]
