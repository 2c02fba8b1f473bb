"""The channel against the twin over a real pseudo-terminal, in real time."""

from __future__ import annotations

import itertools
import math

import pytest
from ground_rig import rig, running

from firmware_bridge.framing import Framer
from firmware_bridge.parameters import TICKS_PER_M
from labr_autonomy.errors import LinkError, Refused

pytestmark = pytest.mark.sitl


async def drive(r, channel, v, w, duration_s):
    await r.command(channel, 0.0, 0.0, 0.02, engaged=False)
    return await r.command(channel, v, w, duration_s)


async def test_drives_and_reports_odometry_on_our_clock():
    async with rig() as r, running(r) as channel:
        seen = []
        channel.on_odometry = seen.append
        begun_s = r.clock.now_s()
        await drive(r, channel, 0.5, 0.8, 1.2)
        await r.command(channel, 0.0, 0.0, 0.5)
        took_s = r.clock.now_s() - begun_s
        half = 0.5 * r.twin.parameters.track
        left, right = (ticks / TICKS_PER_M for ticks in (r.rover.state.left_ticks, r.rover.state.right_ticks))
        steps = list(itertools.pairwise(seen))
        way = sum(0.5 * (a.speed_mps + b.speed_mps) * (b.stamp_s - a.stamp_s) for a, b in steps)
        turn = sum(0.5 * (a.yaw_rate_rps + b.yaw_rate_rps) * (b.stamp_s - a.stamp_s) for a, b in steps)
        assert way == pytest.approx(0.5 * (left + right), rel=0.05)  # 1 % on the simulated clock
        assert turn == pytest.approx(0.5 * (right - left) / half, rel=0.05)
        assert way == pytest.approx(0.5 * 1.2, rel=0.25)
        assert seen[-1].left_ticks / TICKS_PER_M == pytest.approx(left, abs=0.01)
        assert len(seen) == pytest.approx(50.0 * took_s, rel=0.4)
        assert all(b.stamp_s > a.stamp_s for a, b in steps)
        assert begun_s - 0.1 < seen[0].stamp_s < seen[-1].stamp_s < r.clock.now_s()


async def test_state_says_what_the_wheels_do():
    async with rig() as r, running(r) as channel:
        await drive(r, channel, 0.3, 0.0, 0.6)
        state = channel.state
        assert (state.connected, state.engaged, state.mode, state.faults) == (True, True, "engaged", ())
        assert state.speed_mps == pytest.approx(0.3, abs=0.02)
        assert state.battery_v == pytest.approx(19.0)
        assert state.current_a * 19.0 == pytest.approx(r.rover.state.watts, rel=0.1)
        assert state.wheel_load
        assert channel.round_trip_s is not None
        assert channel.round_trip_s < 0.1


async def test_wheels_stand_0_35_s_after_the_last_command():
    async with rig() as r, running(r) as channel:
        await drive(r, channel, 0.8, 0.0, 0.8)
        assert r.rover.state.v_mps > 0.7
        last_s = r.clock.now_s()
        await r.wait(lambda: r.clock.now_s() - last_s > 0.6, 1.0, "rest")
        assert r.rover.state.v_mps == 0.0
        assert r.last_moving_s - last_s <= 0.35 + r.stall_s
        assert "no command for 200 ms" in channel.state.faults


async def test_engaging_is_deliberate():
    async with rig() as r, running(r) as channel:
        assert await r.command(channel, 0.5, 0.0, 0.1) == 0
        assert not channel.may_engage
        assert channel.send_velocity(0.0, 0.0, engaged=False, air_lock=False)
        assert channel.may_engage
        assert await r.command(channel, 0.5, 0.0, 0.1) > 0


@pytest.mark.parametrize(("v", "w"), [(math.nan, 0.0), (0.0, math.inf), (40.0, 0.0), (0.0, -40.0)])
async def test_nonsense_is_not_sent(v, w):
    async with rig() as r, running(r) as channel:
        channel.stop()
        sent = channel.counters.sent
        assert not channel.send_velocity(v, w, engaged=True, air_lock=False)
        assert channel.counters.sent == sent


async def test_too_fast_is_refused_by_the_controller_and_said_so():
    async with rig() as r, running(r) as channel:
        await drive(r, channel, 1.2, 0.0, 0.2)
        assert r.rover.state.v_mps == 0.0
        assert channel.state.faults == ("command refused: the value is outside the limits",)


async def test_air_lock_brakes_and_shows():
    async with rig() as r, running(r) as channel:
        await drive(r, channel, 0.4, 0.0, 0.3)
        await r.command(channel, 0.4, 0.0, 0.1, air_lock=True)
        await r.command(channel, 0.0, 0.0, 0.1, air_lock=True, engaged=False)
        assert channel.state.mode == "air lock"
        assert r.rover.state.v_mps == 0.0
        channel.stop()  # keeps the lock
        await r.wait(lambda: channel.state.mode == "air lock", 0.2, "air lock")
        assert not channel.state.engaged


async def test_unplugged_stops_and_does_not_move_by_itself_afterwards(tmp_path):
    async with rig(link_path=tmp_path / "usb-LABR") as r, running(r) as channel:
        await drive(r, channel, 0.5, 0.0, 0.5)
        r.twin.unplug()
        pulled_s = r.clock.now_s()
        await r.wait(lambda: not channel.state.connected, 0.3 + r.stall_s, "loss noticed")
        assert "unplugged" in " ".join(channel.state.faults)
        await r.command(channel, 0.5, 0.0, 0.4)
        assert r.last_moving_s - pulled_s <= 0.35 + r.stall_s
        r.twin.replug()
        replugged_s = r.clock.now_s()
        await r.wait(lambda: channel.state.connected, 2.0, "back")
        assert await r.command(channel, 0.5, 0.0, 0.3) == 0  # the executive has not noticed and talks on
        assert r.last_moving_s < replugged_s
        assert channel.reconnections == 1
        await drive(r, channel, 0.5, 0.0, 0.3)
        assert r.rover.state.v_mps > 0.2


async def test_a_rebooted_controller_is_a_new_one():
    async with rig() as r, running(r) as channel:
        await drive(r, channel, 0.5, 0.0, 0.3)
        boots = channel.identity.boot_count
        r.twin.reboot(r.clock.now_s())
        await r.wait(lambda: channel.reconnections == 1, 2.0, "back")
        assert channel.identity.boot_count == boots + 1
        assert await r.command(channel, 0.5, 0.0, 0.2) == 0
        assert r.rover.state.v_mps == 0.0


async def test_emergency_stop_holds_until_both_steps():
    async with rig() as r, running(r) as channel:
        await drive(r, channel, 0.5, 0.0, 0.4)
        await channel.estop()
        assert channel.state.mode == "emergency stop"
        await drive(r, channel, 0.5, 0.0, 0.3)
        assert r.rover.state.v_mps == 0.0
        token = await channel.request_release()
        assert channel.state.mode == "emergency stop"
        with pytest.raises(LinkError, match="end of the emergency stop"):
            await channel.confirm_release(token ^ 1)
        await channel.release_estop()
        assert channel.state.mode == "idle"
        assert await r.command(channel, 0.5, 0.0, 0.1) == 0
        with pytest.raises(Refused, match="no such"):
            await channel.request_release()


async def test_button_on_the_robot_is_seen():
    async with rig() as r, running(r) as channel:
        await drive(r, channel, 0.5, 0.0, 0.2)
        r.twin.press_estop()
        await r.wait(lambda: channel.state.mode == "emergency stop", 0.3, "button")
        assert channel.state.faults[-1] == "emergency stop"


async def test_parameters_are_read_written_and_refused():
    async with rig() as r, running(r) as channel:
        values = await channel.read_parameters()
        assert values["track"] == pytest.approx(0.30)
        await channel.write_parameter("track", 0.31)
        assert (await channel.read_parameters())["track"] == pytest.approx(0.31)
        with pytest.raises(Refused, match="outside the limits"):
            await channel.write_parameter("track", 0.0)
        with pytest.raises(Refused, match="no such parameter"):
            await channel.write_parameter("colour", 1.0)
        await drive(r, channel, 0.0, 0.0, 0.1)
        with pytest.raises(Refused, match="disengaged"):
            await channel.write_parameter("track", 0.3)


async def test_both_directions_are_logged_as_whole_frames():
    frames = []

    class Log:
        def write(self, stamp_utc_s: float, frame: bytes) -> None:
            frames.append((stamp_utc_s, frame))

    async with rig() as r, running(r, Log()) as channel:
        await drive(r, channel, 0.2, 0.0, 0.2)
    parsed = [Framer().feed(frame, 0.0) for _, frame in frames]
    assert all(len(p) == 1 and p[0].raw == raw for p, (_, raw) in zip(parsed, frames, strict=True))
    assert {p[0].component for p in parsed} == {68, 191}
    assert all(stamp > 1.6e9 for stamp, _ in frames)
