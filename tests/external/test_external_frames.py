"""How the autopilot's own world is laid over ours, and what of its messages is turned."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from labr_autonomy.frames import (
    quaternion_from_rpy,
    quaternion_ned_frd_to_enu_flu,
    rotation_matrix,
    yaw_enu_ned,
    yaw_of,
)
from sim.autopilot.sih import hil_state, sim_state
from sim.external.alignment import Alignment
from sim.external.truth import TruthReader
from sim.external.turned import add_rover, specific_force_mps2, to_autopilot, to_executive
from sim.quad.state import QuadState

coordinate = st.floats(-50.0, 50.0)
angle = st.floats(-math.pi, math.pi)
place = st.tuples(coordinate, coordinate, coordinate)
NAN = math.nan
QUARTER = Alignment(math.pi / 2.0, (10.0, 20.0, 1.0))  # their east is our north


def quad(position, velocity=(0.0, 0.0, 0.0), rpy=(0.0, 0.0, 0.0), rates=(0.0, 0.0, 0.0)):
    return QuadState(
        np.array(position, float),
        np.array(velocity, float),
        quaternion_from_rpy(*rpy),
        np.array(rates, float),
        np.array([0.0, 0.0, 9.80665]),
        0.0,
        np.zeros(4),
    )


# -- alignment --------------------------------------------------------------------------------------


@given(place, angle, place, angle)
def test_an_alignment_lays_their_pose_on_ours(ours, ours_yaw, theirs, theirs_yaw):
    a = Alignment.of(ours, ours_yaw, theirs, theirs_yaw)
    assert a.ours(theirs) == pytest.approx(ours, abs=1e-9)
    assert a.theirs(ours) == pytest.approx(theirs, abs=1e-9)
    assert math.remainder(theirs_yaw + a.yaw_rad - ours_yaw, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


@given(place, place, angle)
def test_there_and_back_is_the_same(shift, point, yaw):
    a = Alignment(yaw, shift)
    assert a.theirs(a.ours(point)) == pytest.approx(point, abs=1e-9)
    assert a.theirs_vector(a.ours_vector(point)) == pytest.approx(point, abs=1e-9)


# -- truth ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("message", [lambda s: hil_state(s, 1.0), sim_state])
def test_the_truth_comes_back_in_metres_from_where_it_was_first_seen(message):
    reader = TruthReader()
    assert reader.take(message(quad((3.0, -2.0, 0.12))), 10.0).position_m == (0.0, 0.0, 0.0)
    moved = quad((13.0, 18.0, 1.62), (1.0, -0.5, 0.25), (0.1, -0.2, 2.0), (0.1, 0.2, 0.3))
    truth = reader.take(message(moved), 12.0)  # a gap: nothing is carried over it
    assert truth.position_m == pytest.approx((10.0, 20.0, 1.5), abs=0.012)  # 1e-7 degrees are 1.1 cm
    assert truth.velocity_mps == pytest.approx((1.0, -0.5, 0.25), abs=0.006)
    assert truth.rates_rps == pytest.approx((0.1, 0.2, 0.3), abs=1e-6)
    np.testing.assert_allclose(rotation_matrix(truth.attitude), rotation_matrix(moved.quaternion), atol=1e-6)
    assert truth.at(12.1) == pytest.approx((10.1, 19.95, 1.525), abs=0.013)


def test_the_grid_of_the_globe_does_not_reach_the_robot():
    """Flown straight at 0.3 m/s: steps of 1.1 cm in the messages, none in what is made of them."""
    reader, seen, raw = TruthReader(), [], []
    for k in range(250):
        t = k * 0.04
        message = hil_state(quad((0.3 * t, 0.0, 1.0), (0.3, 0.0, 0.0)), t)
        raw.append(message.lon)
        seen.append(reader.take(message, t).position_m[0])
    assert max(np.diff(raw)) >= 2 * min(np.diff(raw))
    steps = np.diff(seen)[20:]
    assert np.ptp(steps) < 0.003
    assert seen[-1] == pytest.approx(0.3 * 249 * 0.04, abs=0.012)


def test_an_autopilot_that_was_put_elsewhere_is_there_at_once():
    reader = TruthReader()
    reader.take(hil_state(quad((0.0, 0.0, 0.0)), 0.0), 0.0)
    assert reader.take(hil_state(quad((5.0, 0.0, 0.0)), 0.04), 0.04).position_m[0] == pytest.approx(
        5, abs=0.02
    )


def test_simstate_has_neither_height_nor_speed():
    from pymavlink.dialects.v20 import ardupilotmega

    said = ardupilotmega.MAVLink_simstate_message(
        0.0, 0.0, 0.5, 0, 0, -9.8, 0.1, 0.2, 0.3, 473977420, 85455940
    )
    frame = said.pack(ardupilotmega.MAVLink(None, 1, 1))
    (m,) = mavlink.MAVLink(None).parse_buffer(frame)  # our dialect does not know it
    truth = TruthReader().take(m, 1.0)
    assert truth.position_m == (0.0, 0.0, 0.0)
    assert yaw_enu_ned(truth.yaw_rad) == pytest.approx(0.5)
    assert truth.rates_rps == pytest.approx((0.1, -0.2, -0.3))


def test_other_messages_are_no_truth():
    assert TruthReader().take(mavlink.MAVLink_ping_message(0, 0, 0, 0), 1.0) is None


# -- messages ---------------------------------------------------------------------------------------


def setpoint(**changes):
    m = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, 0, 20.0, 10.0, -2.0, 1.0, 0.0, -0.1, 0.0, 0.5, 0.0, 0.3, 0.1
    )
    for name, value in changes.items():
        setattr(m, name, value)
    return m


def test_a_set_point_is_turned_into_their_world():
    m = setpoint()
    to_autopilot(m, QUARTER)  # ours (10, 20, 2) is their origin, one metre up
    assert (m.x, m.y, m.z) == pytest.approx((0.0, 0.0, -1.0), abs=1e-9)
    assert (m.vx, m.vy, m.vz) == pytest.approx((0.0, 1.0, -0.1), abs=1e-9)  # our north is their east
    assert (m.afx, m.afy) == pytest.approx((-0.5, 0.0), abs=1e-9)
    assert m.yaw == pytest.approx(0.3 + math.pi / 2)
    assert m.yaw_rate == 0.1


def test_what_a_set_point_leaves_out_stays_left_out():
    m = setpoint(x=NAN, y=NAN, z=NAN, yaw=NAN)
    to_autopilot(m, QUARTER)
    assert all(map(math.isnan, (m.x, m.y, m.z, m.yaw)))
    assert (m.vx, m.vy) == pytest.approx((0.0, 1.0), abs=1e-9)


def test_a_set_point_in_body_axes_is_left_alone():
    m = setpoint(coordinate_frame=mavlink.MAV_FRAME_BODY_NED)
    to_autopilot(m, QUARTER)
    assert (m.x, m.y, m.z, m.yaw) == (20.0, 10.0, -2.0, 0.3)


@given(place, angle, place, angle)
def test_a_pose_goes_there_and_comes_back(shift, turn, where, yaw):
    a = Alignment(turn, shift)
    q = [math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)]
    m = mavlink.MAVLink_odometry_message(0, 20, 12, *where, q, 1.0, 2.0, 3.0, 0, 0, 0, [0] * 21, [0] * 21)
    to_autopilot(m, a)
    there = quaternion_ned_frd_to_enu_flu(np.array(m.q))
    ours = quaternion_ned_frd_to_enu_flu(np.array(q))
    assert math.remainder(yaw_of(there) + turn - yaw_of(ours), 2 * math.pi) == pytest.approx(0, abs=1e-6)
    assert (m.vx, m.vy, m.vz) == (1.0, 2.0, 3.0)  # in the body
    to_executive(m, a)
    assert (m.x, m.y, m.z) == pytest.approx(where, abs=1e-9)


def test_positions_and_attitudes_of_the_autopilot_come_back_in_our_world():
    m = mavlink.MAVLink_local_position_ned_message(0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0)
    to_executive(m, QUARTER)
    assert (m.x, m.y, m.z) == pytest.approx((20.0, 10.0, -2.0), abs=1e-9)
    assert (m.vx, m.vy) == pytest.approx((1.0, 0.0), abs=1e-9)
    m = mavlink.MAVLink_attitude_quaternion_message(0, 1.0, 0.0, 0.0, 0.0, 0, 0, 0)
    to_executive(m, QUARTER)
    ours = quaternion_ned_frd_to_enu_flu(np.array([m.q1, m.q2, m.q3, m.q4]))
    assert abs(math.remainder(yaw_of(ours) - math.pi, 2 * math.pi)) < 1e-9  # their north is our west
    m = mavlink.MAVLink_attitude_message(0, 0.0, 0.0, 0.0, 0, 0, 0)
    to_executive(m, QUARTER)
    assert m.yaw == pytest.approx(-math.pi / 2)


def test_what_is_not_about_places_passes_as_it_is():
    m = mavlink.MAVLink_battery_status_message(0, 0, 0, 0, [1] * 10, 1, 2, 3, 4)
    before = m.to_dict()
    to_executive(m, QUARTER)
    to_autopilot(m, QUARTER)
    assert m.to_dict() == before


@pytest.mark.parametrize("name", ["HIGHRES_IMU", "RAW_IMU"])
def test_a_rover_in_a_bend_is_felt_by_an_autopilot_that_stands_still(name):
    if name == "HIGHRES_IMU":
        m = mavlink.MAVLink_highres_imu_message(0, 0.1, 0, -9.8, 0.01, 0, 0, 0, 0, 0, 0, 0, 0, 0, 63)
        force, rate = 1.0, 1.0
    else:
        m = mavlink.MAVLink_raw_imu_message(0, 10, 0, -1000, 10, 0, 0, 0, 0, 0)
        force, rate = 9.80665e-3, 1e-3
    assert specific_force_mps2(m) == pytest.approx(9.8, abs=0.02)
    add_rover(m, (0.5, 0.8, 9.80665), (0.0, 0.0, 1.2))  # speeding up and turning left
    assert (m.xacc * force, m.yacc * force, m.zacc * force) == pytest.approx((0.6, -0.8, -9.8), abs=0.02)
    assert (m.xgyro * rate, m.ygyro * rate, m.zgyro * rate) == pytest.approx((0.01, 0.0, -1.2), abs=1e-3)
    m.pack(mavlink.MAVLink(None, 1, 1))  # still fits its fields
