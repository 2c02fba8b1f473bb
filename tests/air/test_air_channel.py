"""The channel over a real socket against a double of the autopilot; real time, hence `sitl`."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import os
import struct
import threading

import numpy as np
import pytest
from autopilot_double import ARDUPILOT, CLOCK, GUIDED, HOLD, LAND, OFFBOARD, Double, free_port
from pymavlink import mavutil

from labr_autonomy.air.channel import AirChannel
from labr_autonomy.air.vehicle import WrongVehicle
from labr_autonomy.clock import pause_s
from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput, LinkError, Refused
from labr_autonomy.frames import yaw_of
from labr_autonomy.record.tlog import Tlog
from labr_autonomy.types import Mode, Odometry, Pose, SetPoint

pytestmark = pytest.mark.sitl
ARM, SET_MODE, NAV_LAND, TAKE_OFF, SET_INTERVAL, REQUEST = 400, 176, 21, 22, 511, 512


def setpoint() -> SetPoint:
    zero = np.zeros(3)
    return SetPoint(CLOCK.now_s(), Mode.AIR, np.array([1.0, 2.0, 3.0]), zero, zero, 0.5, 0.1, 0.0)


def pose() -> Odometry:
    q = np.array([1.0, 0.0, 0.0, 0.0])
    return Odometry(CLOCK.now_s(), Pose(np.ones(3), q), np.zeros(3), np.zeros(3), 0.01 * np.eye(6))


async def wait_s(duration_s: float) -> None:
    await CLOCK.sleep_until(CLOCK.now_s() + duration_s)


async def until(reached, timeout_s: float) -> float:
    """Wait for a condition and return how long it took [s]."""
    start_s = CLOCK.now_s()
    while not reached():
        assert CLOCK.now_s() - start_s < timeout_s, "did not happen"
        await wait_s(0.01)
    return CLOCK.now_s() - start_s


def restart(autopilot):
    """Its clock begins anew."""
    boot_s, now_s = autopilot.boot_s, autopilot.boot_s()
    autopilot.boot_s = lambda: boot_s() - now_s


@contextlib.asynccontextmanager
async def pair(tlog=None, **double):
    port = free_port()
    channel = AirChannel(f"udpin://127.0.0.1:{port}", RobotConfig(), CLOCK, tlog)
    async with Double(port, **double) as autopilot:
        await channel.connect(5.0)
        try:
            yield channel, autopilot
        finally:
            await channel.close()


# -- connecting -------------------------------------------------------------------------------------


async def test_connecting_asks_for_what_it_reads_and_reports_the_state():
    async with pair() as (channel, autopilot):
        asked = {c.param1: c.param2 for c in autopilot.of("COMMAND_LONG") if c.command == SET_INTERVAL}
        position, state = {32: 20_000.0, 31: 20_000.0}, {245: 200_000.0, 147: 500_000.0}
        assert asked == {436: 50_000.0, 105: 20_000.0, **position, **state}
        assert channel.release.text == "1.18.0"
        assert not autopilot.of("SET_GPS_GLOBAL_ORIGIN")  # PX4's position would jump by kilometres
        await until(lambda: channel.state.battery_v is not None, 2.0)
        s = channel.state
        assert (s.connected, s.armed, s.mode, s.landed, s.failsafe) == (
            True,
            False,
            "hold",
            "on_ground",
            False,
        )
        np.testing.assert_allclose(s.position_m, [1.0, 2.0, 0.5])
        assert yaw_of(s.attitude) == pytest.approx(np.pi / 4)
        assert (s.battery_v, s.battery_remaining, s.current_a) == pytest.approx((16.2, 0.99, 12.5))
        assert s.battery_used_j == 3000.0


async def test_nobody_answering_is_a_sentence():
    channel = AirChannel(f"udpin://127.0.0.1:{free_port()}", RobotConfig(), CLOCK)
    with pytest.raises(LinkError, match=r"no autopilot answered on udpin://127.0.0.1:\d+ within 1 s"):
        await channel.connect(1.0)
    with pytest.raises(LinkError, match="not open"):
        channel.send_setpoint(setpoint())


@pytest.mark.parametrize(
    ("url", "error", "words"),
    [
        ("nonsense", BadInput, "no address of an autopilot"),
        ("serial:///dev/does_not_exist:57600", LinkError, "could not be opened"),
    ],
)
async def test_a_link_that_cannot_be_opened_is_a_sentence(url, error, words):
    with pytest.raises(error, match=words):
        await AirChannel(url, RobotConfig(), CLOCK).connect(1.0)


@pytest.mark.parametrize(
    ("double", "words"),
    [
        ({"system": 2}, "system id 2"),
        ({"vehicle": 1}, "fixed-wing"),
        ({"vehicle": 10, "autopilot": ARDUPILOT}, "ground rover"),
        ({"autopilot": 0}, "a generic autopilot answers"),
    ],
)
async def test_the_wrong_vehicle_is_refused_and_told_nothing(double, words):
    port = free_port()
    channel = AirChannel(f"udpin://127.0.0.1:{port}", RobotConfig(), CLOCK)
    async with Double(port, **double) as autopilot:
        with pytest.raises(LinkError, match=words):
            await channel.connect(3.0)
        assert not autopilot.commands.keys() & {ARM, SET_MODE, NAV_LAND, SET_INTERVAL}


async def test_an_old_firmware_is_refused_before_it_is_armed():
    port = free_port()
    channel = AirChannel(f"udpin://127.0.0.1:{port}", RobotConfig(), CLOCK)
    async with Double(port) as autopilot:
        autopilot.version = (59647, 0x010D0300)
        with pytest.raises(WrongVehicle, match=r"PX4 1\.13\.3 .* too old"):
            await channel.connect(3.0)
        assert autopilot.commands[ARM] == 0


async def test_an_autopilot_that_does_not_tell_its_version_is_flown():
    port = free_port()
    channel = AirChannel(f"udpin://127.0.0.1:{port}", RobotConfig(), CLOCK)
    async with Double(port) as autopilot:
        autopilot.answers[REQUEST] = 3
        await channel.connect(3.0)
        assert "of unknown version" in channel.description
        await channel.close()


async def test_closing_leaves_no_thread_socket_or_descriptor():
    async with pair() as _:
        pass  # the libraries' own first-time resources
    before = len(os.listdir("/proc/self/task")), len(os.listdir("/proc/self/fd")), threading.active_count()
    async with pair() as (channel, _):
        assert len(os.listdir("/proc/self/task")) > before[0]
    await channel.close()
    await until(lambda: len(os.listdir("/proc/self/task")) <= before[0], 2.0)
    after = len(os.listdir("/proc/self/task")), len(os.listdir("/proc/self/fd")), threading.active_count()
    assert after <= before


# -- every tick -------------------------------------------------------------------------------------


async def test_each_call_is_one_message_and_nothing_is_sent_for_a_hanging_loop():
    async with pair() as (channel, autopilot):
        for _ in range(25):
            channel.send_setpoint(setpoint())
            await wait_s(0.02)
        await until(lambda: len(autopilot.of("SET_POSITION_TARGET_LOCAL_NED")) >= 25, 1.0)
        hang_s = CLOCK.now_s()
        pause_s(1.5)  # the loop hangs; the double reads its socket's queue afterwards
        await wait_s(1.5)
        sent = autopilot.of("SET_POSITION_TARGET_LOCAL_NED")
        assert len(sent) == 25
        assert max(s for s, m in autopilot.received if m.get_type() == sent[0].get_type()) < hang_s
        first = sent[0]
        assert (first.get_srcSystem(), first.get_srcComponent()) == (1, 195)
        assert (first.x, first.y, first.z) == (2.0, 1.0, -3.0)
        assert (first.type_mask, first.coordinate_frame) == (0, 1)


async def test_poses_go_up_as_odometry_in_local_frd():
    async with pair() as (channel, autopilot):
        channel.send_vision(pose())
        await until(lambda: autopilot.of("ODOMETRY"), 1.0)
        sent = autopilot.of("ODOMETRY")
        assert len(sent) == 1
        assert (sent[0].frame_id, sent[0].child_frame_id) == (20, 12)
        assert (sent[0].x, sent[0].y, sent[0].z) == (1.0, 1.0, -1.0)
        assert np.isnan(sent[0].velocity_covariance).all()
        assert CLOCK.now_s() - sent[0].time_usec * 1e-6 < 1.0


async def test_the_autopilots_time_questions_are_answered_with_our_monotonic_clock():
    async with pair() as (_, autopilot):
        await until(lambda: [t for t in autopilot.of("TIMESYNC") if t.tc1], 2.0)
        answer = next(t for t in autopilot.of("TIMESYNC") if t.tc1)
        assert 0 < answer.ts1 <= autopilot.timesync_asked_ns
        truth_s = autopilot.start_s + answer.ts1 * 1e-9
        assert answer.tc1 * 1e-9 == pytest.approx(truth_s, abs=0.05)


async def test_imu_samples_come_on_the_loop_on_our_clock():
    async with pair() as (channel, _):
        got = []
        channel.on_imu = lambda s: got.append((threading.current_thread(), CLOCK.now_s(), s))
        await until(lambda: len(got) >= 25, 2.0)
        stamps = [s.stamp_s for _, _, s in got]
        assert all(t is threading.main_thread() for t, _, _ in got)
        assert all(b > a for a, b in itertools.pairwise(stamps))
        assert all(0.0 <= now_s - s.stamp_s < 0.2 for _, now_s, s in got)
        np.testing.assert_allclose(got[0][2].specific_force_mps2, [0.1, -0.2, 9.8], atol=1e-6)


async def test_a_slow_loop_gets_the_newest_sample_and_no_queue():
    async with pair() as (channel, autopilot):
        got = []
        channel.on_imu = lambda s: got.append(s.stamp_s)
        await until(lambda: len(got) >= 5, 2.0)
        stop, us = threading.Event(), iter(range(10**9, 10**10, 20_000))

        def flood() -> None:  # from a thread, while the loop stands still
            from pymavlink.dialects.v20 import common as m

            while not stop.wait(0.01):
                autopilot.send(
                    m.MAVLink_highres_imu_message(
                        next(us), 0.1, 0.2, -9.8, 0, 0, 0, 0, 0, 0, 955, 0, 0, 15, 63
                    )
                )

        autopilot.streaming = False
        thread = threading.Thread(target=flood)
        thread.start()
        before = len(got)
        pause_s(0.5)
        stop.set()
        thread.join()
        await wait_s(0.05)
        assert len(got) - before <= 3


# -- requests ---------------------------------------------------------------------------------------


async def test_offboard_arm_land_disarm():
    async with pair() as (channel, autopilot):
        channel.send_setpoint(setpoint())
        await channel.start_offboard()
        assert channel.state.mode == "offboard"
        mode = next(c for c in autopilot.of("COMMAND_LONG") if c.command == SET_MODE)
        assert (mode.param1, mode.param2) == (1.0, 6.0)
        await channel.arm()
        assert channel.state.armed
        await channel.land()
        assert channel.state.mode == "land"
        await channel.disarm()
        assert not channel.state.armed
        assert [autopilot.commands[c] for c in (ARM, SET_MODE, NAV_LAND)] == [2, 1, 1]


async def test_offboard_without_set_points_is_refused_here():
    async with pair() as (channel, autopilot):
        with pytest.raises(Refused, match="none was ever sent"):
            await channel.start_offboard()
        channel.send_setpoint(setpoint())
        await wait_s(0.6)
        with pytest.raises(Refused, match=r"left 0\.\d s ago"):
            await channel.start_offboard()
        assert autopilot.commands[SET_MODE] == 0
        assert autopilot.mode == HOLD != OFFBOARD


@pytest.mark.parametrize(
    ("result", "words"), [(1, "temporarily rejected"), (2, "denied"), (3, "unsupported")]
)
async def test_a_refused_arm_is_a_sentence_with_the_autopilots_own_reason(result, words):
    async with pair() as (channel, autopilot):
        autopilot.answers[ARM] = result
        autopilot.text = b"Arming denied: no position"
        with pytest.raises(LinkError, match=rf"refused to arm: {words} .*Arming denied: no position"):
            await channel.arm()
        assert autopilot.commands[ARM] == 1


async def test_a_companion_gets_px4s_reason_as_an_event():
    async with pair() as (channel, autopilot):
        said = []
        channel.on_say = said.append
        autopilot.answers[ARM] = 1
        autopilot.event = struct.pack("<IIHBBB", 0x102089D, 7380, 18, 0, 0, 0x62)  # as recorded
        with pytest.raises(LinkError, match=r"temporarily rejected .*its health checks fail"):
            await channel.arm()
        assert said == ["arming denied, its health checks fail"]


async def test_ardupilot_is_given_an_origin_once_and_flown_by_its_own_words():
    async with pair(autopilot=ARDUPILOT) as (channel, autopilot):
        assert channel.family.name == "ArduPilot"
        await channel.give_origin()
        await channel.give_origin()
        origin = autopilot.of("SET_GPS_GLOBAL_ORIGIN")
        assert [(o.latitude, o.longitude, o.altitude) for o in origin] == [(473977420, 85455940, 489400)]
        asked = {c.param1 for c in autopilot.of("COMMAND_LONG") if c.command == SET_INTERVAL}
        assert asked == {27.0, 32.0, 31.0, 245.0, 147.0}
        got = []
        channel.on_imu = got.append
        await until(lambda: got, 2.0)
        np.testing.assert_allclose(got[0].specific_force_mps2, [0.0980665, -0.196133, 9.80665], atol=1e-6)
        assert (channel.state.mode, channel.state.lifts_by_command) == ("stabilize", True)
        channel.send_setpoint(setpoint())
        await channel.start_offboard()
        assert channel.state.mode == "guided"
        mode = next(c for c in autopilot.of("COMMAND_LONG") if c.command == SET_MODE)
        assert (mode.param1, mode.param2) == (1.0, float(GUIDED))
        await channel.arm()
        await channel.take_off(1.2)
        lift = next(c for c in autopilot.of("COMMAND_LONG") if c.command == TAKE_OFF)
        assert lift.param7 == pytest.approx(1.2)
        assert channel.state.landed == "takeoff"
        await channel.land()
        assert channel.state.mode == "land"


async def test_an_origin_that_ardupilot_has_already_is_left_alone():
    port = free_port()
    channel = AirChannel(f"udpin://127.0.0.1:{port}", RobotConfig(), CLOCK)
    async with Double(port, autopilot=ARDUPILOT) as autopilot:
        autopilot.origin = autopilot.mav.gps_global_origin_encode(1, 2, 3)
        await channel.connect(5.0)
        await channel.give_origin()
        assert not autopilot.of("SET_GPS_GLOBAL_ORIGIN")
        await channel.close()


@pytest.mark.parametrize("kind", [12, ARDUPILOT])
async def test_px4_is_never_given_an_origin_and_whoever_just_looks_gives_none(kind):
    async with pair(autopilot=kind) as (channel, autopilot):
        if kind != ARDUPILOT:
            await channel.give_origin()
        await wait_s(0.7)
        restart(autopilot)
        await until(lambda: channel.reboots, 5.0)
        await wait_s(0.2)
        assert not autopilot.of("SET_GPS_GLOBAL_ORIGIN")


async def test_ardupilot_gets_the_origin_of_a_flight_again_after_a_restart():
    async with pair(autopilot=ARDUPILOT) as (channel, autopilot):
        await channel.give_origin()
        await wait_s(0.7)
        restart(autopilot)
        await until(lambda: len(autopilot.of("SET_GPS_GLOBAL_ORIGIN")) == 2, 5.0)


async def test_an_origin_needs_an_open_link():
    with pytest.raises(LinkError, match="no origin was set"):
        await AirChannel("udpin://127.0.0.1:1", RobotConfig(), CLOCK).give_origin()


async def test_px4_is_never_asked_to_take_off_by_command():
    async with pair() as (channel, autopilot):
        with pytest.raises(Refused, match="PX4 lifts off by set-points"):
            await channel.take_off(1.0)
        assert autopilot.commands[TAKE_OFF] == 0


@pytest.mark.parametrize("autopilot", [12, ARDUPILOT])
async def test_a_takeover_shows_without_waiting_for_the_next_heartbeat(autopilot):
    async with pair(autopilot=autopilot) as (channel, double):
        channel.send_setpoint(setpoint())
        await channel.start_offboard()
        double.beating = False  # the next heartbeat of PX4 is up to 1.2 s away
        double.change_mode(16 if autopilot == ARDUPILOT else 0x00030000)
        await until(lambda: channel.state.mode == "position", 0.9)


async def test_a_request_under_way_is_given_up_when_somebody_else_flies():
    async with pair() as (channel, autopilot):
        autopilot.answers[ARM] = None
        task = asyncio.create_task(channel.arm())
        await until(lambda: autopilot.commands[ARM] == 1, 1.0)
        channel.yield_control()
        with pytest.raises(LinkError, match="overtaken"):
            await task
        await wait_s(0.7)
        assert autopilot.commands[ARM] == 1


async def test_an_acknowledgement_without_effect_is_an_error_within_two_seconds():
    async with pair() as (channel, autopilot):
        autopilot.obeys = False
        start_s = CLOCK.now_s()
        with pytest.raises(LinkError, match="accepted the request to arm, but 2 s later there is no effect"):
            await channel.arm()
        assert CLOCK.now_s() - start_s < 2.5


async def test_an_unanswered_arm_is_repeated_with_growing_confirmation_and_then_given_up():
    async with pair() as (channel, autopilot):
        autopilot.answers[ARM] = None
        with pytest.raises(LinkError, match="did not acknowledge the request to arm"):
            await channel.arm()
        sent = [c.confirmation for c in autopilot.of("COMMAND_LONG") if c.command == ARM]
        assert sent == [0, 1, 2, 3, 4]


async def test_a_cancelled_arm_is_not_sent_again():
    async with pair() as (channel, autopilot):
        autopilot.answers[ARM] = None
        task = asyncio.create_task(channel.arm())
        await until(lambda: autopilot.commands[ARM] == 1, 1.0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        await wait_s(1.5)
        assert autopilot.commands[ARM] == 1


async def test_landing_overtakes_an_arm_under_way():
    async with pair() as (channel, autopilot):
        autopilot.answers[ARM] = None
        autopilot.armed = True
        task = asyncio.create_task(channel.arm())
        await until(lambda: autopilot.commands[ARM] == 1, 1.0)
        await channel.land()
        with pytest.raises(LinkError, match="arm was overtaken by the request to land"):
            await task
        await wait_s(0.5)
        assert autopilot.commands[ARM] == 1
        assert autopilot.mode == LAND


async def test_unanswered_requests_do_not_hold_up_set_points():
    async with pair() as (channel, autopilot):
        autopilot.answers[ARM] = None
        task = asyncio.create_task(channel.arm())
        for _ in range(50):
            channel.send_setpoint(setpoint())
            await wait_s(0.02)
        task.cancel()
        await asyncio.wait([task])
        times = [s for s, m in autopilot.received if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]
        assert len(times) == 50
        assert max(b - a for a, b in itertools.pairwise(times)) < 0.2


# -- parameters -------------------------------------------------------------------------------------


@pytest.mark.parametrize("autopilot", [12, ARDUPILOT])
async def test_parameters_that_fit_are_accepted(autopilot):
    async with pair(autopilot=autopilot) as (channel, _):
        await channel.check_parameters()


@pytest.mark.parametrize(
    ("autopilot", "name", "value", "whole", "words"),
    [
        (12, "COM_OF_LOSS_T", 15.0, False, r"COM_OF_LOSS_T is 15, wanted 0\.2 to 1 \(set-points that stop"),
        (12, "EKF2_EV_CTRL", 1, True, "EKF2_EV_CTRL is 1, wanted 15"),
        (ARDUPILOT, "EK3_SRC1_YAW", 1, True, "EK3_SRC1_YAW is 1, wanted 6"),
        (ARDUPILOT, "GUID_TIMEOUT", 10.0, False, "GUID_TIMEOUT is 10, wanted"),
    ],
)
async def test_a_parameter_that_does_not_fit_is_refused_by_name_and_value(
    autopilot, name, value, whole, words
):
    async with pair(autopilot=autopilot) as (channel, double):
        await channel.write_parameter(name, value, whole)
        with pytest.raises(Refused, match=words):
            await channel.check_parameters()
        assert double.commands[ARM] == 0


async def test_integers_cross_both_ways_as_each_family_writes_them():
    for autopilot, name in ((12, "NAV_RCL_ACT"), (ARDUPILOT, "FS_EKF_ACTION")):
        async with pair(autopilot=autopilot) as (channel, _):
            await channel.write_parameter(name, 3, True)
            assert await channel.read_parameter(name, True) == 3.0
    async with pair() as (channel, _):
        assert await channel.read_parameter("SDLOG_MODE", True) == -1.0


@pytest.mark.parametrize("autopilot", [12, ARDUPILOT])
async def test_a_parameter_that_is_not_there_is_none(autopilot):
    async with pair(autopilot=autopilot) as (channel, _):
        assert await channel.read_parameter("NO_SUCH_PARAM", True) is None


async def test_nothing_is_written_while_the_rotors_are_armed():
    async with pair() as (channel, autopilot):
        autopilot.armed = True
        await until(lambda: channel.state.armed, 1.0)
        with pytest.raises(Refused, match="armed"):
            await channel.write_parameter("NAV_RCL_ACT", 1, True)
        assert not autopilot.of("PARAM_SET")


# -- losing it --------------------------------------------------------------------------------------


async def test_lost_heartbeats_are_noticed_within_three_and_a_half_seconds():
    async with pair() as (channel, autopilot):
        autopilot.beating = False
        lost_s = await until(lambda: not channel.state.connected, 3.5)
        assert lost_s > 2.5
        assert channel.state.mode == "unknown"
        autopilot.beating = True
        await until(lambda: channel.state.connected, 1.0)


async def test_silence_is_noticed_within_one_and_a_half_seconds():
    async with pair() as (channel, autopilot):
        autopilot.speaking = False
        await until(lambda: not channel.state.connected, 1.6)
        assert "silent for 1." in channel.state.fault


async def test_after_a_reboot_the_streams_are_asked_for_again_and_nothing_is_armed():
    async with pair() as (channel, autopilot):
        got = []
        channel.on_imu = lambda s: got.append(s.stamp_s)
        await wait_s(0.7)
        asked = autopilot.commands[SET_INTERVAL]
        restart(autopilot)
        await until(lambda: autopilot.commands[SET_INTERVAL] == asked + 6, 1.0)
        assert channel.reboots == 1
        assert autopilot.commands[ARM] == 0
        await until(lambda: got[-1] > CLOCK.now_s() - 0.05, 1.0)


# -- the record -------------------------------------------------------------------------------------


async def test_the_tlog_holds_both_directions(tmp_path):
    log = Tlog(tmp_path / "air.tlog")
    async with pair(log) as (channel, autopilot):
        await wait_s(0.3)
        sent = len(autopilot.of("SET_POSITION_TARGET_LOCAL_NED"))
        for _ in range(10):
            channel.send_setpoint(setpoint())
            channel.send_vision(pose())
            await wait_s(0.02)
        await channel.arm()
        assert len(autopilot.of("SET_POSITION_TARGET_LOCAL_NED")) == sent + 10
        await wait_s(0.1)
    log.close()
    seen: dict[tuple[str, int], int] = {}
    stamps = []
    reader = mavutil.mavlink_connection(str(log.path), dialect="common")
    for message in iter(reader.recv_match, None):
        key = message.get_type(), message.get_srcComponent()
        seen[key] = seen.get(key, 0) + 1
        stamps.append(message._timestamp)
    reader.close()
    assert stamps == sorted(stamps)
    assert seen["SET_POSITION_TARGET_LOCAL_NED", 195] == 10
    assert seen["ODOMETRY", 195] == 10
    assert seen["COMMAND_LONG", 195] >= 1
    assert seen["COMMAND_ACK", 1] >= 1 + 5
    for name in ("HEARTBEAT", "HIGHRES_IMU", "LOCAL_POSITION_NED", "ATTITUDE_QUATERNION", "BATTERY_STATUS"):
        assert seen[name, 1] >= 1, name
    assert seen["HIGHRES_IMU", 1] > 10
