"""Whole flights of the stand-in on a simulated clock: take-off, landing, losses, odd requests."""

import numpy as np
import pytest
from autopilot_rig import ARM, HOLD, LAND, OFFBOARD, SET_MODE, TAKEOFF, Rig, parked, setpoint_message

from sim.autopilot.modes import FlightMode

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED = range(4)


def watch_ground(rig, seconds):
    """Fly on; returns the speeds down just before each touch and the heights after the first."""
    touches, heights = [], []
    last = rig.truth

    def look(r):
        nonlocal last
        if r.truth.on_ground and not last.on_ground:
            touches.append(-float(last.velocity_mps[2]))
        if touches:
            heights.append(float(r.truth.position_m[2]))
        last = r.truth

    rig.run(seconds, look)
    return touches, heights


@pytest.mark.slow
def test_land_mode_touches_down_softly_and_disarms():
    rig = Rig()
    rig.take_off(1.0)
    before = rig.truth.position_m[:2].copy()
    assert rig.command(LAND) == ACCEPTED
    rig.run(0.1)
    assert rig.vehicle.commander.mode is FlightMode.LAND
    touches, heights = watch_ground(rig, 8.0)
    assert 0.2 < touches[0] <= 0.5
    assert max(heights) < 0.12 + 0.03
    assert not rig.vehicle.armed
    assert rig.vehicle.commander.mode is FlightMode.OFFBOARD, "back to the mode before the landing"
    assert np.linalg.norm(rig.truth.position_m[:2] - before) < 0.1
    assert rig.vehicle.step(rig.now_s + 0.004, rig.truth, rig.battery) is None


@pytest.mark.slow
def test_a_descent_by_setpoints_lands_too():
    rig = Rig()
    rig.take_off(0.6)
    rig.setpoint = lambda: setpoint_message(0b100111000111, vd=0.4)
    touches, heights = watch_ground(rig, 8.0)
    assert touches[0] <= 0.5
    assert max(heights) < 0.12 + 0.03
    assert not rig.vehicle.armed


@pytest.mark.slow
def test_losing_the_stream_lands_and_its_return_resumes():
    rig = Rig()
    rig.take_off(1.0)
    stream, rig.setpoint = rig.setpoint, None
    start = rig.time_s
    while rig.vehicle.commander.mode is FlightMode.OFFBOARD:
        rig.tick()
    assert rig.time_s - start == pytest.approx(1.0, abs=0.1)
    rig.run(1.0)
    low = rig.truth.position_m[2]
    assert low < 1.0
    rig.setpoint = stream
    rig.run(0.1)
    assert rig.vehicle.commander.mode is FlightMode.OFFBOARD
    rig.run(3.0)
    assert rig.truth.position_m[2] > low + 0.1


@pytest.mark.slow
def test_losing_the_vision_lands_after_its_time_out():
    rig = Rig()
    rig.take_off(0.8)
    rig.vision = False
    rig.run(4.8)
    assert rig.vehicle.commander.mode is FlightMode.OFFBOARD
    touches, _ = watch_ground(rig, 9.0)
    assert rig.vehicle.commander.previous is FlightMode.HOLD
    assert touches[0] <= 0.5
    assert not rig.vehicle.armed


@pytest.mark.slow
def test_it_stays_on_the_ground_without_a_climb():
    rig = Rig()
    rig.fly_to(0.0, 0.0, -0.10)
    rig.run(0.5)
    assert rig.command(SET_MODE, *OFFBOARD) == ACCEPTED
    assert rig.command(ARM, 1.0) == ACCEPTED
    rig.run(3.0)
    assert rig.vehicle.phase.phase.value == "ready"
    assert rig.truth.position_m[2] == pytest.approx(0.12, abs=2e-3)
    rig.run(8.0)
    assert not rig.vehicle.armed, "ten seconds without a take-off"


@pytest.mark.slow
def test_requests_in_the_air():
    rig = Rig()
    rig.take_off(0.5)
    assert rig.command(ARM, 1.0) == ACCEPTED
    assert rig.command(ARM, 0.0) == TEMPORARILY_REJECTED
    assert rig.command(SET_MODE, *HOLD) == TEMPORARILY_REJECTED
    assert rig.command(31999) == UNSUPPORTED
    assert rig.vehicle.commander.mode is FlightMode.OFFBOARD
    assert rig.command(TAKEOFF) == ACCEPTED
    rig.run(0.05)
    assert rig.vehicle.commander.mode is FlightMode.LAND
    assert rig.command(SET_MODE, *OFFBOARD) == ACCEPTED
    rig.run(0.05)
    assert rig.vehicle.commander.mode is FlightMode.OFFBOARD
    assert rig.command(ARM, 0.0, 21196.0) == ACCEPTED
    assert not rig.vehicle.armed


def test_requests_on_the_ground():
    rig = Rig(flying_body=False)
    rig.run(0.5)
    assert rig.command(ARM, 1.0) == TEMPORARILY_REJECTED
    assert rig.command(SET_MODE, *OFFBOARD) == ACCEPTED
    assert rig.command(ARM, 1.0) == TEMPORARILY_REJECTED, "no set-points yet"
    assert rig.command(SET_MODE, 1.0, 4.0, 77.0) == TEMPORARILY_REJECTED
    assert rig.command(TAKEOFF) == ACCEPTED
    assert rig.vehicle.commander.mode is FlightMode.TAKEOFF
    assert not rig.vehicle.armed
    assert rig.command(512, 242.0) == DENIED
    assert rig.command(512, 32.0) == ACCEPTED
    assert rig.command(511, 32.0, 20000.0) == ACCEPTED
    assert rig.command(511, 9999.0, 20000.0) == DENIED
    assert rig.command(510, 32.0) == ACCEPTED
    assert rig.messages("MESSAGE_INTERVAL")[-1][1].interval_us == 20000


def test_commands_for_others_are_not_answered():
    from pymavlink.dialects.v20 import development as mavlink

    rig = Rig(flying_body=False)
    rig.run(0.1)
    rig.send(mavlink.MAVLink_command_long_message(7, 1, ARM, 0, *[1.0] * 7))
    rig.run(0.1)
    assert rig.messages("COMMAND_ACK") == []


def test_it_shrugs_off_garbage():
    rig = Rig(flying_body=False)
    for junk in (b"", b"\xfd", b"\xfd" * 300, bytes(range(256))):
        rig.vehicle.receive(junk)
        rig.run(0.02)
    rig.run(0.5)
    assert rig.command(31999) == UNSUPPORTED


@pytest.mark.slow
def test_the_imu_shows_the_truth_with_constant_biases():
    rig = Rig(flying_body=False, seed=5)
    rig.truth = parked()
    rig.run(20.0)
    rows = [(m.xacc, m.yacc, m.zacc, m.xgyro, m.ygyro, m.zgyro) for _, m in rig.messages("HIGHRES_IMU")]
    mean, sigma = np.mean(rows, axis=0), np.std(rows, axis=0)
    assert mean[:3] == pytest.approx([0.0, 0.0, -9.80665], abs=0.15)
    assert mean[3:] == pytest.approx([0.0, 0.0, 0.0], abs=0.01)
    assert sigma[:3] == pytest.approx([0.07] * 3, rel=0.2)
    assert sigma[3:] == pytest.approx([0.007] * 3, rel=0.2)
    flu = rig.vehicle._imu.bias
    assert mean[:3] - [0.0, 0.0, -9.80665] == pytest.approx(flu[:3] * [1, -1, -1], abs=0.01)
    assert Rig(flying_body=False, seed=5).vehicle._imu.bias == pytest.approx(flu)
    assert not np.allclose(Rig(flying_body=False, seed=6).vehicle._imu.bias, flu)


def test_status_texts_go_to_ground_stations_only():
    from pymavlink.dialects.v20 import development as mavlink

    rig = Rig(flying_body=False)
    rig.run(0.1)
    rig.command(ARM, 1.0)
    assert rig.messages("STATUSTEXT") == []
    rig.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))
    rig.run(0.1)
    rig.command(ARM, 1.0)
    assert "denied" in rig.messages("STATUSTEXT")[0][1].text


def test_the_clock_is_answered_and_asked_for():
    from pymavlink.dialects.v20 import development as mavlink

    rig = Rig(flying_body=False)
    rig.run(1.0)
    rig.send(mavlink.MAVLink_timesync_message(0, 123456789))
    rig.run(0.01)
    ours = [m for _, m in rig.messages("TIMESYNC") if m.ts1 == 123456789]
    assert len(ours) == 1
    assert ours[0].tc1 == pytest.approx(rig.vehicle.boot_s * 1e9, abs=2e7)
    assert [m for _, m in rig.messages("TIMESYNC") if m.tc1 == 0]


def test_the_battery_shows():
    rig = Rig(flying_body=False)
    rig.battery.draw("computer", 20.0)
    for _ in range(100):
        rig.battery.step(1.0)
    rig.run(2.5)
    status = rig.messages("SYS_STATUS")[-1][1]
    assert status.voltage_battery == pytest.approx(1e3 * rig.battery.volts, abs=2)
    assert status.battery_remaining == round(100 * rig.battery.remaining)
    assert rig.messages("BATTERY_STATUS")[-1][1].energy_consumed == 20
