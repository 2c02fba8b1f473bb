"""Frames round trip, and agree with the definitions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labr_autonomy import frames
from labr_autonomy.types import Pose

finite = st.floats(-100.0, 100.0, allow_nan=False)
vector = st.tuples(finite, finite, finite).map(np.array)
angle = st.floats(-3.1, 3.1)
quaternion = st.tuples(angle, st.floats(-1.4, 1.4), angle).map(lambda a: frames.quaternion_from_rpy(*a))


@given(vector)
def test_enu_ned_and_flu_frd_are_their_own_inverses(v):
    assert np.array_equal(frames.enu_ned(frames.enu_ned(v)), v)
    assert np.array_equal(frames.flu_frd(frames.flu_frd(v)), v)


def test_north_east_down_of_the_axes():
    assert np.array_equal(frames.enu_ned(np.array([1.0, 0.0, 0.0])), [0.0, 1.0, 0.0])  # east
    assert np.array_equal(frames.enu_ned(np.array([0.0, 0.0, 1.0])), [0.0, 0.0, -1.0])  # up


@given(quaternion, vector)
def test_attitude_changes_frames_without_turning_the_vector(q, v_flu):
    """The same physical vector through both routes: FLU->ENU->NED equals FLU->FRD->NED."""
    q_ned = frames.quaternion_enu_flu_to_ned_frd(q)
    one = frames.enu_ned(frames.rotation_matrix(q) @ v_flu)
    other = frames.rotation_matrix(q_ned) @ frames.flu_frd(v_flu)
    assert np.allclose(one, other, atol=1e-8)
    back = frames.quaternion_ned_frd_to_enu_flu(q_ned)
    assert np.allclose(frames.rotation_matrix(back), frames.rotation_matrix(q), atol=1e-9)


@given(angle)
def test_yaw_round_trip_and_facing_north(yaw):
    assert frames.yaw_enu_ned(frames.yaw_enu_ned(yaw)) == pytest.approx(yaw, abs=1e-9)
    assert frames.yaw_enu_ned(math.pi / 2) == pytest.approx(0.0)
    q = frames.quaternion_enu_flu_to_ned_frd(frames.quaternion_from_rpy(0, 0, yaw))
    assert math.remainder(frames.yaw_of(q) - frames.yaw_enu_ned(yaw), 2 * math.pi) == pytest.approx(
        0, abs=1e-9
    )


@given(quaternion, vector, vector)
def test_level_and_odom_round_trip(q, position, point):
    pose = Pose(position, q)
    assert np.allclose(frames.level_to_odom(frames.odom_to_level(point, pose), pose), point, atol=1e-9)


@given(quaternion)
def test_rotation_vector_round_trip(q):
    r = frames.quaternion_rotation_vector(q)
    assert np.allclose(
        frames.rotation_matrix(frames.rotation_vector_quaternion(r)), frames.rotation_matrix(q), atol=1e-9
    )


@given(angle, st.floats(-1.4, 1.4), angle)
def test_euler_angles_round_trip(roll, pitch, yaw):
    q = frames.quaternion_from_rpy(roll, pitch, yaw)
    assert frames.roll_pitch_of(q) == pytest.approx((roll, pitch), abs=1e-7)
    assert frames.yaw_of(q) == pytest.approx(yaw, abs=1e-7)


@given(st.floats(-1e4, 1e4))
def test_wrap_pi_stays_in_range(a):
    assert -math.pi < frames.wrap_pi(a) <= math.pi
