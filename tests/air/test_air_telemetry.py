from __future__ import annotations

import math

import numpy as np
import pytest

from labr_autonomy.air import px4
from labr_autonomy.air.telemetry import (
    Message,
    air_state,
    attitude_odom,
    battery,
    imu_sample,
    mode_and_intention,
    position_odom,
)
from labr_autonomy.frames import yaw_of

BEAT = {"type": 2, "autopilot": 12, "base_mode": 0x91, "custom_mode": 0x00060000, "system_status": 4}
LOCAL = {"x": 2.0, "y": 1.0, "z": -0.5, "vx": 0.2, "vy": 0.1, "vz": -0.3}


def state(now_s, beat=BEAT, **others):
    latest = {"HEARTBEAT": Message(10.0, beat), **{k: Message(10.0, v) for k, v in others.items()}}
    return air_state(latest, 10.0, now_s)


# custom_mode values as recorded from PX4 1.18
@pytest.mark.parametrize(
    ("number", "word"),
    [
        (0x03040000, "hold"),
        (0x02040000, "takeoff"),
        (0x00060000, "offboard"),
        (0x05040000, "return"),
        (0x06040000, "land"),
        (0x00030000, "position"),
        (0x63040000, "mode 4.99"),
        (0, "mode 0"),
    ],
)
def test_mode_numbers_have_words(number, word):
    assert px4.mode_name(number) == word


def test_positions_and_attitudes_come_back_in_odom():
    s = state(10.1, LOCAL_POSITION_NED=LOCAL)
    np.testing.assert_allclose(s.position_m, [1.0, 2.0, 0.5])
    np.testing.assert_allclose(s.velocity_mps, [0.1, 0.2, 0.3])
    north = attitude_odom({"q1": 1.0, "q2": 0.0, "q3": 0.0, "q4": 0.0})
    assert yaw_of(north) == pytest.approx(math.pi / 2)


def test_gravity_at_rest_is_up_in_body():
    fields = {"xacc": 0.1, "yacc": 0.2, "zacc": -9.8, "xgyro": 0.01, "ygyro": 0.02, "zgyro": 0.03}
    sample = imu_sample(fields, 3.0)
    np.testing.assert_allclose(sample.specific_force_mps2, [0.1, -0.2, 9.8])
    np.testing.assert_allclose(sample.angular_velocity_rps, [0.01, -0.02, -0.03])
    assert sample.stamp_s == 3.0
    assert imu_sample({**fields, "zgyro": None}, 3.0) is None


def test_numbers_that_are_not_finite_give_no_position():
    assert position_odom({**LOCAL, "x": None}) is None
    s = state(10.1, LOCAL_POSITION_NED={**LOCAL, "z": None})
    assert s.position_m is None
    assert s.velocity_mps is not None


def test_an_old_position_is_none():
    assert state(10.99, LOCAL_POSITION_NED=LOCAL).position_m is not None
    assert state(11.01, LOCAL_POSITION_NED=LOCAL).position_m is None


@pytest.mark.parametrize(("now_s", "connected"), [(11.4, True), (11.6, False)])
def test_silence_loses_the_link_and_assumes_no_mode_but_still_armed(now_s, connected):
    s = state(now_s, EXTENDED_SYS_STATE={"landed_state": 2})
    assert s.connected is connected
    assert (s.mode, s.landed) == (("offboard", "in_air") if connected else ("unknown", "unknown"))
    assert s.armed
    assert (s.fault is None) is connected


def test_missed_heartbeats_lose_the_link_although_other_messages_come():
    s = air_state({"HEARTBEAT": Message(10.0, BEAT)}, 13.1, 13.1)
    assert not s.connected
    assert "no heartbeat for 3.1 s" in s.fault


@pytest.mark.parametrize(("status", "failsafe"), [(3, False), (4, False), (5, True), (6, True)])
def test_a_critical_system_status_is_a_failsafe(status, failsafe):
    s = state(10.1, {**BEAT, "system_status": status})
    assert s.failsafe is failsafe
    assert ("failsafe" in (s.fault or "")) is failsafe


def test_battery_sums_cells_and_knows_what_is_not_known():
    unknown = {"battery_remaining": -1, "current_battery": -1, "energy_consumed": -1}
    cells = [3800, 3700, *[65535] * 8]
    assert battery({"voltages": cells, "voltages_ext": [100, 0, 0, 0], **unknown}) == (
        pytest.approx(7.6),
        None,
        None,
        None,
    )
    known = {"battery_remaining": 80, "current_battery": 1250, "energy_consumed": 3}
    assert battery({"voltages": [65535] * 10, "voltages_ext": [0] * 4, **known}) == (None, 0.8, 12.5, 300.0)


def current(mode, intended, arrival_s):
    return Message(arrival_s, {"custom_mode": mode, "intended_custom_mode": intended, "standard_mode": 0})


def test_the_newer_of_heartbeat_and_current_mode_tells_the_mode():
    latest = {"HEARTBEAT": Message(10.0, BEAT)}
    assert mode_and_intention(latest) == ("offboard", "")
    latest["CURRENT_MODE"] = current(0x06040000, 0x00060000, 10.1)
    assert mode_and_intention(latest) == ("land", "offboard")
    latest["HEARTBEAT"] = Message(10.2, BEAT)
    assert mode_and_intention(latest) == ("offboard", "offboard")
    latest["CURRENT_MODE"] = current(0x06040000, 0, 10.3)
    assert mode_and_intention(latest) == ("land", "")


def test_ardupilots_inertial_measurement_is_in_mg_and_mrad():
    fields = {"xacc": 10, "yacc": 20, "zacc": -1000, "xgyro": 10, "ygyro": 20, "zgyro": 30}
    sample = imu_sample(fields, 3.0, "RAW_IMU")
    np.testing.assert_allclose(sample.specific_force_mps2, [0.0980665, -0.196133, 9.80665])
    np.testing.assert_allclose(sample.angular_velocity_rps, [0.01, -0.02, -0.03])
