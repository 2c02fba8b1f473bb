"""`labr-mission bench links`: how long the robot's links take, and under which load."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from labr_autonomy.config import RobotConfig
    from sim.bench.links.rows import Load

GROUNDS, AIRS = ("twin", "qemu"), ("px4", "ardupilot")
Progress = Callable[[float], None]
Measurement = Callable[[Progress], Awaitable[Sequence[Mapping[str, Any]]]]


@click.command()
@click.option("--ground", "grounds", type=click.Choice(GROUNDS), multiple=True, help="Land controller.")
@click.option("--air", "airs", type=click.Choice(AIRS), multiple=True, help="Autopilot's stand-in.")
@click.option(
    "--robot",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="robot.yaml: the round trips to its two controllers instead; nothing moves.",
)
@click.option("--seconds", type=click.FloatRange(1.0, 600.0), default=10.0, help="For each figure.")
@click.option("--json", "as_json", is_flag=True, help="JSON on stdout, for machines.")
def links(
    grounds: tuple[str, ...], airs: tuple[str, ...], robot: Path | None, seconds: float, as_json: bool
) -> None:
    """Round trip and set-point latency of both channels: median, 99th percentile, worst.

    --ground and --air may be repeated; without them all are measured. Each endpoint runs in a process of its
    own behind the link of a simulated flight. The round trip is that of a time synchronisation; a set-point's
    latency ends when the motors are told, or in the air when the autopilot's socket has it.
    """
    from labr_autonomy.mission.load import load_robot
    from labr_autonomy.processes import on_time
    from labr_autonomy.record.summary import versions
    from sim.bench.links.rows import load_now, load_since

    if not grounds and not airs:
        grounds, airs = GROUNDS, AIRS
    options = [*(f"--ground {g}" for g in grounds), *(f"--air {a}" for a in airs)]
    if robot is None:
        measurements = _simulated(grounds, airs, seconds)
    else:
        measurements = _real(load_robot(robot), seconds)
        options = [f"--robot {robot}"]
    before = load_now()
    with on_time() as realtime:
        rows = _measure(measurements, seconds, figures=1 if robot is not None else 2, quiet=as_json)
    load = load_since(before, realtime=realtime)
    if as_json:
        command = " ".join(["labr-mission bench links", *options, f"--seconds {seconds:g}"])
        click.echo(json.dumps({"command": command, "versions": versions(), "load": load, "rows": rows}))
        return
    _print(rows, load)


def _simulated(grounds: Sequence[str], airs: Sequence[str], seconds: float) -> list[Measurement]:
    from sim.bench.air_latency import air_latency_rows
    from sim.bench.links.ground import measure_simulated

    def ground(which: str) -> Measurement:
        return lambda progress: measure_simulated(which, seconds, progress)

    def air(kind: str) -> Measurement:
        return lambda progress: air_latency_rows(kind, seconds, progress)

    return [*(ground(which) for which in grounds), *(air(kind) for kind in airs)]


def _real(config: RobotConfig, seconds: float) -> list[Measurement]:
    from sim.bench.air_latency import air_robot_rows
    from sim.bench.links.ground import measure_robot

    return [
        lambda progress: measure_robot(config, seconds, progress),
        lambda progress: air_robot_rows(config, seconds, progress),
    ]


def _measure(
    measurements: Sequence[Measurement], seconds: float, *, figures: int, quiet: bool
) -> list[Mapping[str, Any]]:
    from labr_autonomy.commands.progress import show_count

    rows: list[Mapping[str, Any]] = []
    said = -1
    with show_count(round(len(measurements) * figures * seconds), "seconds", quiet=quiet) as say:

        def progress_from(start_s: float) -> Progress:
            def progress(done_s: float) -> None:
                nonlocal said
                if (whole := round(start_s + done_s)) != said:
                    said = whole
                    say(whole, "")

            return progress

        for k, measurement in enumerate(measurements):
            rows += asyncio.run(_awaited(measurement, progress_from(k * figures * seconds)))
    return rows


async def _awaited(measurement: Measurement, progress: Progress) -> Sequence[Mapping[str, Any]]:
    return await measurement(progress)


def _print(rows: Sequence[Mapping[str, Any]], load: Load) -> None:
    for row in rows:
        lost = f"   {row['lost']} lost" if row["lost"] else ""
        click.echo(
            "{channel:7s} {endpoint:10s} {figure:20s} n {n:5d}   p50 {p50_ms:7.2f} ms   "
            "p99 {p99_ms:7.2f} ms   max {max_ms:7.2f} ms".format(**row)
            + lost
        )
    urgent = "real-time" if load["realtime"] else "ordinary"
    before, after, cores = load["load_before"], load["load_after"], load["cores"]
    click.echo(f"load {before:.1f} before, {after:.1f} after, on {cores} cores; {urgent} priority")
