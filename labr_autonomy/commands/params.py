"""`labr-mission params`: the autopilot's parameters against what this robot wants."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from labr_autonomy.errors import ExitCode

if TYPE_CHECKING:
    from labr_autonomy.air.parameters import Row
    from labr_autonomy.config import RobotConfig

CONNECT_S = 15.0
MARKS = {"good": "good", "wrong": "WRONG", "missing": "MISSING", "advice": "advice"}


@click.command()
@click.option("--robot", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE", help="robot.yaml.")
@click.option("--air", metavar="URL", help="Where the autopilot is; by default links.air of robot.yaml.")
@click.option("--apply", "write", is_flag=True, help="Write what is wrong or advised. Never while armed.")
@click.option("--json", "as_json", is_flag=True, help="JSON on stdout, for machines.")
def params(robot: Path | None, air: str | None, write: bool, as_json: bool) -> None:
    """Compare the autopilot's parameters with what this robot wants.

    Ends with 0 when it may fly with them, with 3 when it may not. `fly` makes the same comparison before it
    arms. After --apply the autopilot is to be restarted: some of them count from its next start.
    """
    from labr_autonomy.config import RobotConfig
    from labr_autonomy.mission.load import load_robot

    config = RobotConfig() if robot is None else load_robot(robot)
    url = config.links.air if air is None else air
    rows, written = asyncio.run(_compare(url, config, write=write))
    refused = any(row.refuses for row in rows)
    if as_json:
        listed = [row.as_dict() for row in rows]
        click.echo(json.dumps({"air": url, "fits": not refused, "written": written, "rows": listed}))
    else:
        click.echo(as_table(rows))
        if written:
            click.echo(f"written: {', '.join(written)}. Restart the autopilot now.")
        elif any(row.state != "good" for row in rows):
            click.echo("Set them with --apply, then restart the autopilot.")
    if refused:
        click.get_current_context().exit(int(ExitCode.REFUSED))


async def _compare(url: str, config: RobotConfig, *, write: bool) -> tuple[list[Row], list[str]]:
    from labr_autonomy.air.channel import AirChannel
    from labr_autonomy.air.parameters import compare, wanted
    from labr_autonomy.clock import SystemClock

    channel = AirChannel(url, config, SystemClock())
    await channel.connect(CONNECT_S)
    try:
        table = wanted(channel.family, config.air)
        rows = await compare(table, channel.read_parameter)
        written = []
        if write:
            for row in rows:
                if row.state != "good" and row.have is not None:
                    await channel.write_parameter(row.name, row.wanted.set_to, row.wanted.whole)
                    written.append(row.name)
            rows = await compare(table, channel.read_parameter)
        return rows, written
    finally:
        await channel.close()


def as_table(rows: Sequence[Row]) -> str:
    """Name, have, want and why in columns."""
    lines = [("", "name", "have", "want", "why")]
    for row in rows:
        have = "-" if row.have is None else f"{row.have:g}"
        lines.append((MARKS[row.state], row.name, have, row.want, row.why))
    widths = [max(len(line[k]) for line in lines) for k in range(4)]
    return "\n".join(
        "  ".join((*(cell.ljust(width) for cell, width in zip(line, widths, strict=False)), line[4])).rstrip()
        for line in lines
    )
