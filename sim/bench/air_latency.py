"""Round trip and set-point latency of the air channel, against a stand-in in a process of its own."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from labr_autonomy.air.channel import AirChannel
from labr_autonomy.clock import SystemClock, Ticker
from labr_autonomy.config import RobotConfig
from labr_autonomy.types import Mode, SetPoint

PERIOD_S = 0.02  # as often as set-points go out in flight
CONNECT_S = 10.0
LINGER_S = 0.3  # for the last answers
END_S = 5.0

Progress = Callable[[float], None]


async def air_latency_rows(kind: str, seconds: float, progress: Progress) -> list[dict[str, Any]]:
    """Both figures over UDP on this machine.

    Args:
        kind: "px4" or "ardupilot", the stand-in that answers.
        seconds: For each figure.
        progress: Told the seconds that are done, of twice `seconds`.

    Returns:
        Rows with channel, endpoint, figure, n, lost, p50_ms, p99_ms, max_ms.

    Raises:
        LinkError: The stand-in did not answer.
    """
    port = _free_port()
    server = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "sim.bench.air_server",
        str(port),
        "--kind",
        kind,
        stdout=asyncio.subprocess.PIPE,
    )
    assert server.stdout is not None
    channel = AirChannel(f"udpin://127.0.0.1:{port}", RobotConfig(), SystemClock())
    try:
        await channel.connect(CONNECT_S)
        rows = [await round_trip(channel, kind, seconds, progress)]
        rows.append(await _setpoints(channel, kind, server.stdout, seconds, progress))
        return rows
    finally:
        await channel.close()
        server.terminate()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(server.wait(), END_S)
        if server.returncode is None:
            server.kill()
            await server.wait()


async def air_robot_rows(config: RobotConfig, seconds: float, progress: Progress) -> list[dict[str, Any]]:
    """The round trip to the autopilot that `robot.yaml` names; nothing is asked to move.

    Raises:
        LinkError: It does not answer.
    """
    channel = AirChannel(config.links.air, config, SystemClock())
    try:
        await channel.connect(CONNECT_S)
        return [await round_trip(channel, channel.family.name, seconds, progress)]
    finally:
        await channel.close()


async def round_trip(
    channel: AirChannel, endpoint: str, seconds: float, progress: Progress
) -> dict[str, Any]:
    """Time synchronisations at 50 Hz; from the question to the answer on the event loop's doorstep."""
    clock, times_s, asked = SystemClock(), list[float](), 0
    channel.on_round_trip = times_s.append
    ticker, begun_s = Ticker(clock, PERIOD_S), clock.now_s()
    while (done_s := clock.now_s() - begun_s) < seconds:
        await ticker.wait()
        channel.ping()
        asked += 1
        progress(done_s)
    await clock.sleep_until(clock.now_s() + LINGER_S)
    channel.on_round_trip = None
    return _row(endpoint, "round trip", times_s, asked)


async def _setpoints(
    channel: AirChannel, endpoint: str, told: asyncio.StreamReader, seconds: float, progress: Progress
) -> dict[str, Any]:
    """From the call that sends a set-point to its arrival at the autopilot's socket."""
    clock, zero = SystemClock(), np.zeros(3)
    sent_s: list[float] = []
    times_s: list[float] = []
    reading = asyncio.create_task(_arrivals(told, sent_s, times_s), name="arrivals")
    ticker, begun_s = Ticker(clock, PERIOD_S), clock.now_s()
    while (done_s := clock.now_s() - begun_s) < seconds:
        await ticker.wait()
        now_s = clock.now_s()
        sent_s.append(now_s)
        channel.send_setpoint(
            SetPoint(now_s, Mode.AIR, np.array([0.0, 0.0, 0.12]), zero, zero, 0.0, 0.0, 0.0)
        )
        progress(seconds + done_s)
    await clock.sleep_until(clock.now_s() + LINGER_S)
    reading.cancel()
    await asyncio.wait([reading])
    return _row(endpoint, "set-point to socket", times_s, len(sent_s))


async def _arrivals(told: asyncio.StreamReader, sent_s: list[float], times_s: list[float]) -> None:
    """Match arrivals to sendings by the stamp in the message, whose zero is when the channel was made."""
    zero_s: float | None = None
    while line := await told.readline():
        said = json.loads(line)
        if zero_s is None:
            zero_s = sent_s[0] - said["boot_ms"] * 1e-3  # the first datagram of a local socket is not lost
        stamp_s = zero_s + said["boot_ms"] * 1e-3
        left_s = min(sent_s, key=lambda at: abs(at - stamp_s))
        times_s.append(float(said["time_s"]) - left_s)


def _row(endpoint: str, figure: str, times_s: Sequence[float], asked: int) -> dict[str, Any]:
    ms = 1e3 * np.array(times_s if len(times_s) else [np.nan])
    p50, p99 = (round(float(np.percentile(ms, q)), 3) for q in (50, 99))
    return {
        "channel": "air",
        "endpoint": endpoint,
        "figure": figure,
        "n": len(times_s),
        "lost": asked - len(times_s),
        "p50_ms": p50,
        "p99_ms": p99,
        "max_ms": round(float(ms.max()), 3),
    }


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
