"""`labr-mission bench console`: what the operator's page costs the flight, and how fresh it is."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path

import click

from labr_autonomy.errors import Refused


@click.command()
@click.option(
    "--seconds", type=click.FloatRange(1.0, 600.0), default=15.0, help="Of each stretch (default: 15)."
)
@click.option("--stalled", type=click.FloatRange(1.0, 3600.0), default=30.0, help="Seconds of a stopped tab.")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), metavar="DIR", help="Run folder.")
@click.option("--json", "as_json", is_flag=True, help="JSON on stdout, for machines.")
def console(seconds: float, stalled: float, out: Path | None, as_json: bool) -> None:
    """Measure the set-points' lateness with 0, 1 and 3 tabs of the page, its freshness and its first paint.

    One simulated flight that waits for start, looked at with Chromium; wants an otherwise idle machine.
    """
    if find_spec("playwright") is None:
        raise Refused("this benchmark needs playwright", "pip install 'labr-autonomy[test]'")
    from labr_autonomy.record.run_folder import make_run_folder
    from labr_autonomy.record.summary import versions
    from sim.bench.console_bench import measure

    folder = out or make_run_folder("bench-console")
    folder.mkdir(parents=True, exist_ok=True)
    found = measure(folder, seconds, stalled, lambda words: click.echo(words, err=True))
    command = f"labr-mission bench console --seconds {seconds:g} --stalled {stalled:g}"
    answer = {"command": command, "seed": 1, "versions": versions(), **found}
    (folder / "console.json").write_text(json.dumps(answer, indent=1) + "\n")
    if as_json:
        click.echo(json.dumps(answer))
        return
    for row in found["rows"]:
        age = f", state {row['state_age_p95_ms']:.0f} ms old at p95" if "state_age_p95_ms" in row else ""
        click.echo(
            f"{row['tabs']} tabs: {row['ticks']} ticks, late by p50 {row['tick_late_p50_ms']:.2f} ms, "
            f"p99 {row['tick_late_p99_ms']:.2f} ms{age}"
        )
    p99 = [row["tick_late_p99_ms"] for row in found["rows"]]
    click.echo(f"largest difference of p99: {max(p99) - min(p99):.2f} ms")
    click.echo(f"first paint {found['first_paint_ms']:.0f} ms, first state {found['first_state_ms']:.0f} ms")
    stopped = found["stalled"]
    click.echo(
        f"a stopped tab of {stopped['seconds']:g} s: executive {stopped['executive_growth_mb']:+.1f} MB, "
        f"console {stopped['console_growth_mb']:+.1f} MB"
    )
