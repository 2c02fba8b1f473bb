"""The two controllers, over their own links: who they are, how they are set, how quickly they answer."""

from __future__ import annotations

import asyncio
import contextlib
import math

import numpy as np

from labr_autonomy.air.channel import AirChannel
from labr_autonomy.air.parameters import Row, compare, wanted
from labr_autonomy.clock import SystemClock
from labr_autonomy.config import RobotConfig
from labr_autonomy.doctor.finding import Finding, failed, good, note, wrong
from labr_autonomy.errors import LabrError
from labr_autonomy.ground.channel import GroundChannel

OPEN_S = 3.0
CONNECT_S = 5.0
PINGS = 20
PING_S = 0.02
ROUND_TRIP_MAX_S = 0.1
LISTEN_S = 1.2
TRACK_TOLERANCE = 0.02  # share


async def examine_ground(config: RobotConfig) -> list[Finding]:
    """Shake hands with the land controller and read what it is set to; nothing is engaged."""
    channel = GroundChannel(config.links.ground, config.links.ground_baud, config, SystemClock())
    try:
        identity = await channel.open(OPEN_S)
    except LabrError as error:
        return [failed("ground", "identity", error)]
    found = [
        good("ground", "identity", f"{identity.serial}, firmware {identity.firmware}"),
        good("ground", "dialect", f"{identity.dialect_hash:08X}, protocol {identity.protocol}, as here"),
    ]
    running = asyncio.create_task(channel.run(), name="ground link")
    try:
        found += await _land_parameters(channel, config)
        await SystemClock().sleep_until(SystemClock().now_s() + LISTEN_S)
        found.append(_land_state(channel))
        found.append(_round_trip("ground", channel.round_trip_s))
    except LabrError as error:
        found.append(failed("ground", "parameters", error))
    finally:
        running.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await running
        await channel.close()
    return found


async def _land_parameters(channel: GroundChannel, config: RobotConfig) -> list[Finding]:
    values = await channel.read_parameters()
    want, have = config.body.track_m, values.get("track", math.nan)
    text = ", ".join(f"{name} {value:g}" for name, value in sorted(values.items()))
    if not abs(have - want) <= TRACK_TOLERANCE * want:
        do = "Correct one of them: turns would be wrong by that share."
        return [wrong("ground", "parameters", f"track is {have:g} m, robot.yaml says {want:g} m", do)]
    speed, limit = values.get("speed", math.inf), config.land.speed_mps
    if speed < limit:
        do = "Raise it on the controller, or lower land.speed_mps."
        return [wrong("ground", "parameters", f"speed is {speed:g} m/s, robot.yaml wants {limit:g} m/s", do)]
    return [good("ground", "parameters", text)]


def _land_state(channel: GroundChannel) -> Finding:
    state = channel.state
    text = f"{state.mode}, battery {state.battery_v:.1f} V, wheels {'' if state.wheel_load else 'not '}loaded"
    if state.estop:
        do = "Release it: labr-mission wheels --robot FILE --release-estop."
        return wrong("ground", "state", text, do)
    if state.faults:
        do = "See Bring-up in firmware_bridge/README.md."
        return wrong("ground", "state", f"{text}; {', '.join(state.faults)}", do)
    return good("ground", "state", text)


async def examine_air(config: RobotConfig) -> list[Finding]:
    """Find the autopilot and compare its parameters; nothing is armed and nothing is written."""
    channel = AirChannel(config.links.air, config, SystemClock())
    try:
        await channel.connect(CONNECT_S)
    except LabrError as error:
        return [failed("air", "identity", error)]
    try:
        return await _autopilot(channel, config)
    except LabrError as error:
        return [failed("air", "link", error)]
    finally:
        await channel.close()


async def _autopilot(channel: AirChannel, config: RobotConfig) -> list[Finding]:
    found = [good("air", "identity", channel.description)]
    rows = await compare(wanted(channel.family, config.air), channel.read_parameter)
    found += [_parameter(row) for row in rows]
    clock = _round_trip("air", await _ping(channel))
    state = channel.state
    if state.armed:
        found.append(wrong("air", "state", f"armed, in mode {state.mode}", "Disarm it."))
    elif state.fault:
        found.append(wrong("air", "state", state.fault, "Look at it with a ground station."))
    else:
        volts = "unknown" if state.battery_v is None else f"{state.battery_v:.1f} V"
        found.append(good("air", "state", f"disarmed, in mode {state.mode}, battery {volts}"))
    found.append(clock)
    found.append(_signing(channel))
    return found


def _signing(channel: AirChannel) -> Finding:
    if channel.forged is None:
        text = "frames are not signed"
        return note("air", "signing", text, "Keep the link inside the robot, or name a key: links.air_key.")
    if channel.forged:
        text = f"{channel.forged} frames came without a good signature and were dropped"
        return wrong(
            "air", "signing", text, "Somebody else is on the link, or the autopilot has another key."
        )
    return good("air", "signing", "every frame is signed, both ways")


def _parameter(row: Row) -> Finding:
    have = "is not there" if row.have is None else f"{row.have:g}"
    if row.state == "good":
        return good("air", row.name, have)
    text = f"{have}, wanted {row.want}: {row.why}"
    do = "Set it with labr-mission params --apply, then restart the autopilot."
    return wrong("air", row.name, text, do) if row.refuses else note("air", row.name, text, do)


async def _ping(channel: AirChannel) -> float | None:
    """Median round trip of time synchronisation [s], None without an answer."""
    clock, times_s = SystemClock(), list[float]()
    channel.on_round_trip = times_s.append
    for _ in range(PINGS):
        channel.ping()
        await clock.sleep_until(clock.now_s() + PING_S)
    await clock.sleep_until(clock.now_s() + 0.2)
    return float(np.median(times_s)) if times_s else None


def _round_trip(area: str, round_trip_s: float | None) -> Finding:
    if round_trip_s is None:
        do = "Poses could not be dated on its clock; look at the cable's other direction."
        return wrong(area, "clock", "no answer to a time synchronisation", do)
    text = f"time synchronisation answered in {1e3 * round_trip_s:.1f} ms"
    if round_trip_s > ROUND_TRIP_MAX_S:
        return wrong(
            area, "clock", text, f"More than {1e3 * ROUND_TRIP_MAX_S:.0f} ms; look at the link's load."
        )
    return good(area, "clock", text)
