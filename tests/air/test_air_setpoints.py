from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labr_autonomy.air.setpoints import USE_ALL, covariance_upper, setpoint_fields, vision_fields
from labr_autonomy.errors import Refused
from labr_autonomy.frames import (
    enu_ned,
    flu_frd,
    quaternion_from_rpy,
    quaternion_ned_frd_to_enu_flu,
    rotation_matrix,
    wrap_pi,
    yaw_enu_ned,
)
from labr_autonomy.types import Mode, Odometry, Pose, SetPoint

METRES = st.floats(-1e3, 1e3)
ANGLE = st.floats(-math.pi, math.pi)
VECTOR = st.tuples(METRES, METRES, METRES).map(np.array)
ATTITUDE = st.tuples(ANGLE, st.floats(-1.5, 1.5), ANGLE).map(lambda a: quaternion_from_rpy(*a))


def setpoint(p=(0.0, 0.0, 0.0), v=(0.0, 0.0, 0.0), a=(0.0, 0.0, 0.0), yaw=0.0, rate=0.0, stamp=1.0):
    return SetPoint(stamp, Mode.AIR, np.array(p), np.array(v), np.array(a), yaw, rate, 0.0)


def odometry(
    p=(0.0, 0.0, 0.0), q=(1.0, 0.0, 0.0, 0.0), v=(0.0, 0.0, 0.0), w=(0.0, 0.0, 0.0), cov=None, stamp=1.0
):
    covariance = np.eye(6) if cov is None else cov
    return Odometry(stamp, Pose(np.array(p), np.array(q)), np.array(v), np.array(w), covariance)


def test_one_metre_east_and_two_up_is_y_one_and_z_minus_two():
    f = setpoint_fields(setpoint(p=(1.0, 0.0, 2.0), v=(0.0, 3.0, 0.0), a=(0.0, 0.0, 4.0)), 0.0, 1, 1)
    assert (f["x"], f["y"], f["z"]) == (0.0, 1.0, -2.0)
    assert (f["vx"], f["vy"], f["vz"]) == (3.0, 0.0, 0.0)
    assert (f["afx"], f["afy"], f["afz"]) == (0.0, 0.0, -4.0)
    assert f["coordinate_frame"] == 1
    assert f["type_mask"] == USE_ALL == 0


def test_facing_north_is_yaw_zero_and_turning_left_is_a_negative_rate():
    f = setpoint_fields(setpoint(yaw=math.pi / 2, rate=0.3), 0.0, 1, 1)
    assert f["yaw"] == pytest.approx(0.0)
    assert f["yaw_rate"] == pytest.approx(-0.3)


@given(VECTOR, VECTOR, VECTOR, ANGLE, METRES)
def test_a_set_point_survives_the_way_to_ned_and_back(p, v, a, yaw, rate):
    f = setpoint_fields(setpoint(p, v, a, yaw, rate), 0.0, 1, 1)
    np.testing.assert_allclose(enu_ned(np.array([f["x"], f["y"], f["z"]])), p)
    np.testing.assert_allclose(enu_ned(np.array([f["vx"], f["vy"], f["vz"]])), v)
    np.testing.assert_allclose(enu_ned(np.array([f["afx"], f["afy"], f["afz"]])), a)
    assert wrap_pi(yaw_enu_ned(f["yaw"]) - yaw) == pytest.approx(0.0, abs=1e-9)
    assert f["yaw_rate"] == -rate


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("where", ["p", "v", "a", "yaw", "rate", "stamp"])
def test_a_set_point_that_is_not_finite_is_refused(bad, where):
    value = (0.0, bad, 0.0) if where in "pva" else bad
    with pytest.raises(Refused, match="not finite"):
        setpoint_fields(setpoint(**{where: value}), 0.0, 1, 1)


@pytest.mark.parametrize(("stamp", "ms"), [(10.0, 0), (11.5, 1500), (9.0, 0), (10.0 + 2**32 / 1e3 + 1, 1000)])
def test_time_boot_ms_counts_from_the_start_and_wraps(stamp, ms):
    assert setpoint_fields(setpoint(stamp=stamp), 10.0, 1, 1)["time_boot_ms"] == pytest.approx(ms, abs=1)


def test_forward_speed_facing_north_is_x_in_body_and_in_local():
    q = quaternion_from_rpy(0.0, 0.0, math.pi / 2)
    f = vision_fields(odometry(p=(0.0, 5.0, 1.0), q=q, v=(0.0, 2.0, 0.0)))
    assert (f["frame_id"], f["child_frame_id"]) == (20, 12)
    assert (f["x"], f["y"], f["z"]) == (5.0, 0.0, -1.0)
    np.testing.assert_allclose([f["vx"], f["vy"], f["vz"]], [2.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(f["q"], [1.0, 0.0, 0.0, 0.0], atol=1e-12)


@given(VECTOR, ATTITUDE, VECTOR, VECTOR)
def test_a_pose_survives_the_way_to_frd_and_back(p, q, v, w):
    f = vision_fields(odometry(p, q, v, w, stamp=12.5))
    np.testing.assert_allclose(enu_ned(np.array([f["x"], f["y"], f["z"]])), p)
    back = quaternion_ned_frd_to_enu_flu(np.array(f["q"]))
    np.testing.assert_allclose(rotation_matrix(back), rotation_matrix(q), atol=1e-9)
    body = flu_frd(np.array([f["vx"], f["vy"], f["vz"]]))
    np.testing.assert_allclose(rotation_matrix(q) @ body, v, atol=1e-8)
    np.testing.assert_allclose(flu_frd(np.array([f["rollspeed"], f["pitchspeed"], f["yawspeed"]])), w)
    assert f["time_usec"] == 12_500_000


@pytest.mark.parametrize("where", ["p", "q", "v", "w"])
def test_a_pose_that_is_not_finite_is_refused(where):
    value = (math.nan, 0.0, 0.0, 0.0)[: 4 if where == "q" else 3]
    with pytest.raises(Refused, match="not finite"):
        vision_fields(odometry(**{where: value}))


def test_covariance_changes_axes_with_the_pose():
    full = np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    full[0, 2] = full[2, 0] = 0.5  # east-up
    full[3, 4] = full[4, 3] = 0.25  # forward-left
    upper = covariance_upper(full)
    assert len(upper) == 21
    assert [upper[i] for i in (0, 6, 11, 15, 18, 20)] == [2.0, 1.0, 3.0, 4.0, 5.0, 6.0]
    assert upper[7] == -0.5  # east-down
    assert upper[16] == -0.25  # forward-right


def test_unknown_covariance_and_velocity_covariance_become_null():
    full = np.eye(6)
    full[0, 0] = math.nan
    assert None in covariance_upper(full)
    assert vision_fields(odometry())["velocity_covariance"] == [None] * 21
