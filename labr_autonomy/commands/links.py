"""`labr-mission bench links`: how long the robot's links take, and under which load."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections.abc import Callable

    from labr_autonomy.config import RobotConfig
    from sim.bench.links.rows import Load, Row


@click.command()
@click.option(
    "--ground",
    "grounds",
    type=click.Choice(["twin", "qemu"]),
    multiple=True,
    help="Simulated land controller; may be repeated (default: both).",
)
@click.option(
    "--robot",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="robot.yaml: the round trip to its land controller instead; nothing moves.",
)
@click.option("--seconds", type=click.FloatRange(1.0, 600.0), default=10.0, help="For each figure.")
@click.option("--json", "as_json", is_flag=True, help="JSON on stdout, for machines.")
def links(grounds: tuple[str, ...], robot: Path | None, seconds: float, as_json: bool) -> None:
    """Round trip and set-point latency of the links: median, 99th percentile, worst.

    The land controller runs in a process of its own behind a pseudo-terminal, as in a simulated flight. The
    round trip is that of a time synchronisation; a set-point's latency ends when the motors are told.
    """
    from labr_autonomy.config import RobotConfig
    from labr_autonomy.mission.load import load_robot
    from labr_autonomy.processes import on_time
    from labr_autonomy.record.summary import versions
    from sim.bench.links.rows import load_now, load_since

    before = load_now()
    config = RobotConfig() if robot is None else load_robot(robot)
    chosen = () if robot is not None else grounds or ("twin", "qemu")
    with on_time() as realtime:
        rows = _measure(chosen, config, seconds, quiet=as_json)
    load = load_since(before, realtime=realtime)
    options = [*(f"--ground {g}" for g in chosen), f"--seconds {seconds:g}"]
    command = " ".join(["labr-mission bench links", *options])
    if as_json:
        click.echo(json.dumps({"command": command, "versions": versions(), "load": load, "rows": rows}))
        return
    _print(rows, load)


def _measure(chosen: tuple[str, ...], config: RobotConfig, seconds: float, *, quiet: bool) -> list[Row]:
    from labr_autonomy.commands.progress import show_count
    from sim.bench.links.ground import measure_robot, measure_simulated

    rows: list[Row] = []
    figures = 2 * len(chosen) or 1
    said = -1
    with show_count(round(figures * seconds), "seconds", quiet=quiet) as say:

        def progress_from(start_s: float) -> Callable[[float], None]:
            def progress(done_s: float) -> None:
                nonlocal said
                if (whole := round(start_s + done_s)) != said:
                    said = whole
                    say(whole, "")

            return progress

        for k, which in enumerate(chosen):
            rows += asyncio.run(measure_simulated(which, seconds, progress_from(2 * k * seconds)))
        if not chosen:
            rows += asyncio.run(measure_robot(config, seconds, progress_from(0.0)))
    return rows


def _print(rows: list[Row], load: Load) -> None:
    for row in rows:
        values: dict[str, Any] = dict(row)
        lost = f"   {row['lost']} lost" if row["lost"] else ""
        click.echo(
            "{channel:7s} {endpoint:6s} {figure:20s} n {n:5d}   p50 {p50_ms:7.2f} ms   "
            "p99 {p99_ms:7.2f} ms   max {max_ms:7.2f} ms".format(**values)
            + lost
        )
    urgent = "real-time" if load["realtime"] else "ordinary"
    before, after, cores = load["load_before"], load["load_after"], load["cores"]
    click.echo(f"load {before:.1f} before, {after:.1f} after, on {cores} cores; {urgent} priority")
