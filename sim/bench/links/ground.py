"""Round trip and set-point latency of the ground channel."""

from __future__ import annotations

import asyncio
import contextlib
import json
import random
import subprocess
import sys
import tempfile
from collections.abc import AsyncIterator, Callable
from pathlib import Path

from labr_autonomy.clock import SystemClock, Ticker
from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import LinkError, Refused
from labr_autonomy.ground.channel import GroundChannel
from sim.bench.links.rows import Row, row

PING_PERIOD_S = 0.02  # as often as set-points go out
HOLD_S = (0.06, 0.10)  # a set-point is kept up for a time drawn between these
SPEED_MPS = 0.2
END_S = 5.0


async def measure_simulated(which: str, seconds: float, progress: Callable[[float], None]) -> list[Row]:
    """Both figures against a controller in a process of its own.

    Args:
        which: "twin" or "qemu".
        seconds: For each figure.
        progress: Told the seconds that are done, of twice `seconds`.

    Raises:
        Refused: What builds or emulates the firmware is not installed.
    """
    with tempfile.TemporaryDirectory() as folder:
        link = Path(folder) / "land_controller"
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "sim.bench.links.land_server", which, str(link), stdout=subprocess.PIPE
        )
        try:
            assert process.stdout is not None
            ready = json.loads(await process.stdout.readline() or "{}")
            if ready.get("event") != "ready":
                raise Refused(ready.get("what", "the land controller did not start"), ready.get("do", ""))
            async with _open(str(link), RobotConfig()) as channel:
                rows = [await round_trip(channel, which, seconds, progress)]
                rows.append(await setpoint_latency(channel, which, process.stdout, seconds, progress))
            return rows
        finally:
            process.terminate()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(process.wait(), END_S)
            if process.returncode is None:
                process.kill()
                await process.wait()


async def measure_robot(config: RobotConfig, seconds: float, progress: Callable[[float], None]) -> list[Row]:
    """The round trip to the controller that `robot.yaml` names; nothing is asked to move.

    Raises:
        LinkError: It does not answer.
    """
    async with _open(config.links.ground, config) as channel:
        return [await round_trip(channel, config.links.ground, seconds, progress)]


@contextlib.asynccontextmanager
async def _open(device: str, config: RobotConfig) -> AsyncIterator[GroundChannel]:
    channel = GroundChannel(device, config.links.ground_baud, config, SystemClock())
    await channel.open()
    task = asyncio.create_task(channel.run(), name="ground")
    try:
        yield channel
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task
        await channel.close()


async def round_trip(
    channel: GroundChannel, endpoint: str, seconds: float, progress: Callable[[float], None]
) -> Row:
    """Time synchronisations at 50 Hz beside idle set-points; from the question to the answer.

    Args:
        channel: Open.
        endpoint: Name for the row.
        seconds: How long.
        progress: Told the seconds done.
    """
    clock = SystemClock()
    times_s: list[float] = []
    channel.on_round_trip = times_s.append
    ticker, begun_s, asked = Ticker(clock, PING_PERIOD_S), clock.now_s(), 0
    while (done_s := clock.now_s() - begun_s) < seconds:
        await ticker.wait()
        channel.stop()
        asked += channel.ping()
        progress(done_s)
    await clock.sleep_until(clock.now_s() + 0.2)
    channel.on_round_trip = None
    return row("ground", endpoint, "round trip", times_s, max(0, asked - len(times_s)))


async def setpoint_latency(
    channel: GroundChannel,
    endpoint: str,
    told: asyncio.StreamReader,
    seconds: float,
    progress: Callable[[float], None],
) -> Row:
    """From the call that sends a set-point to the moment the motors are told, driving and braking in turn.

    Args:
        channel: Open.
        endpoint: Name for the row.
        told: Lines of the land server.
        seconds: How long.
        progress: Told the seconds done, this figure's after the first one's.
    """
    clock, rng = SystemClock(), random.Random(1)
    times_s: list[float] = []
    begun_s, lost, driving = clock.now_s(), 0, False
    while (done_s := clock.now_s() - begun_s) < seconds:
        driving = not driving
        if driving:
            channel.stop()  # engaging is deliberate, and it is so after every silence
        sent_s = clock.now_s()
        if not channel.send_velocity(SPEED_MPS * driving, 0.0, engaged=driving, air_lock=False):
            raise LinkError("the ground channel took no set-point", "Look at the machine's load")
        seen_s = await _seen(told, "driven" if driving else "braked", sent_s)
        lost += seen_s is None
        if seen_s is not None:
            times_s.append(seen_s - sent_s)
        await clock.sleep_until(sent_s + rng.uniform(*HOLD_S))
        progress(seconds + done_s)
    channel.stop()
    return row("ground", endpoint, "set-point to motors", times_s, lost)


async def _seen(told: asyncio.StreamReader, event: str, after_s: float) -> float | None:
    """Time of the next such event; None if it does not come before the set-point's own end."""
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(0.5):
            while line := await told.readline():
                said = json.loads(line)
                if said["event"] == event and said["time_s"] >= after_s:
                    return float(said["time_s"])
    return None
