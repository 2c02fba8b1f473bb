"""`labr-mission bench refiner`: random problems by the ten thousand, and a judge that trusts nobody."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labr_autonomy.commands.checks import json_option
from labr_autonomy.errors import BadInput, ExitCode

if TYPE_CHECKING:
    from sim.bench.refiner.problems import Tally

MODES = ("land", "air")
_COMMAND_LINE = click.core.ParameterSource.COMMANDLINE


@click.command()
@click.option(
    "--problems", type=click.IntRange(1, 10_000_000), default=2_000, metavar="N", help="Of each mode."
)
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), default=0, help="Of the first ten; others follow.")
@click.option("--jobs", type=click.IntRange(1, 1024), metavar="J", help="At once (default: cores).")
@click.option(
    "--beside-flight",
    "flown",
    type=click.Path(path_type=Path, exists=True),
    metavar="MISSION.yaml|RUN",
    help="Instead: fly it in real time, or take a run, and tell how long the planner process refined.",
)
@json_option
@click.pass_context
def refiner(
    context: click.Context, problems: int, seed: int, jobs: int | None, flown: Path | None, as_json: bool
) -> None:
    """Give the refiner random problems and judge every trajectory that leaves it.

    Boxes, posts and unknown floor in a walled square, key points through all of it, things that appear
    ahead; each problem begins where the last trajectory led. A trajectory may not touch anything, come
    nearer than the clearance promised, break a limit or end in motion. Ends with 4 if one does. Ctrl-C
    tells the figures so far.

    --beside-flight times the refiner where it counts: in the planner process, next to everything else.
    """
    from labr_autonomy.record.summary import versions

    if flown is not None:
        given = [n for n in ("problems", "seed", "jobs") if context.get_parameter_source(n) is _COMMAND_LINE]
        if given:
            raise BadInput(f"--{given[0]} is of random problems, not of a flight", f"Leave --{given[0]} out")
        _beside(flown, as_json=as_json)
        return
    tallies, stopped = _solve(problems, seed, jobs or len(os.sched_getaffinity(0)), quiet=as_json)
    rows = [_row(mode, tally) for mode, tally in tallies.items()]
    answer = {
        "command": f"labr-mission bench refiner --problems {problems} --seed {seed}",
        "seed": seed,
        "versions": versions(),
        "rows": rows,
    }
    click.echo(json.dumps(answer) if as_json else "\n".join(_line(row) for row in rows))
    if stopped:
        click.echo("labr-mission: stopped by the operator before the last problem", err=True)
        click.get_current_context().exit(int(ExitCode.ABORTED))
    if any(row["faults"] for row in rows):
        click.get_current_context().exit(int(ExitCode.EXPECTATION_MISSED))


def _beside(flown: Path, *, as_json: bool) -> None:
    """Times of the refiner in the planner process of a flight, and under which load."""
    from labr_autonomy.record.run_folder import make_run_folder
    from labr_autonomy.record.summary import versions
    from sim.bench.refiner.beside import fly, rows

    run, load = flown, None
    if flown.is_file():
        run, load = fly(flown, make_run_folder("bench-refiner"), quiet=as_json)
    found = rows(run)
    if as_json:
        command = f"labr-mission bench refiner --beside-flight {flown}"
        click.echo(json.dumps({"command": command, "versions": versions(), "load": load, "rows": found}))
        return
    for row in found:
        p50, p99, most = row["time_ms"].values()
        click.echo(
            f"{row['mode']:5s} {row['plans']} plans: p50 {p50:.1f} ms, p99 {p99:.1f} ms, max {most:.1f} ms"
        )
    if load is not None:
        click.echo(
            f"load {load['before']:.1f} before, {load['after']:.1f} after with the flight's own processes, "
            f"on {load['cores']} cores; the flight ended with {load['fly_exit']}"
        )
    click.echo(f"The flight is in {run}")


def _solve(problems: int, seed: int, jobs: int, *, quiet: bool) -> tuple[dict[str, Tally], bool]:
    """Tallies by mode, and whether Ctrl-C ended them before the last."""
    from labr_autonomy.commands.progress import show_count
    from sim.bench.refiner.problems import CHAIN, Tally, chain
    from sim.training_data.workers import carried_out

    tallies, stopped = {mode: Tally() for mode in MODES}, False
    work = [(mode, seed + k) for k in range(math.ceil(problems / CHAIN)) for mode in MODES]
    with show_count(len(work) * CHAIN, "problems", quiet=quiet) as say:
        try:
            for mode, tally in carried_out(chain, work, jobs):
                tallies[mode].add(tally)
                bad = sum(len(t.bad) for t in tallies.values())
                say(sum(t.problems for t in tallies.values()), f"{bad} faults" if bad else "")
        except KeyboardInterrupt:
            stopped = True
    return tallies, stopped


def _row(mode: str, tally: Tally) -> dict[str, Any]:
    import numpy as np

    p50, p99 = np.percentile(tally.took_ms, [50, 99]) if tally.took_ms else (0.0, 0.0)
    return {
        "mode": mode,
        "problems": tally.problems,
        "faults": dict(tally.faults),
        "sources": dict(sorted(tally.sources.items())),
        "time_ms": {"p50": round(float(p50), 2), "p99": round(float(p99), 2)},
        "worst": [{"seed": s, "number": k, "fault": what} for s, k, what in tally.bad[:20]],
    }


def _line(row: dict[str, Any]) -> str:
    found = ", ".join(f"{count} {what}" for what, count in row["faults"].items()) or "no fault"
    sources = ", ".join(f"{count} {source}" for source, count in row["sources"].items())
    times = row["time_ms"]
    worst = "".join(f"\n  seed {w['seed']}, number {w['number']}: {w['fault']}" for w in row["worst"])
    return (
        f"{row['mode']:5s} {row['problems']} problems: {found}; p50 {times['p50']:.1f} ms, "
        f"p99 {times['p99']:.1f} ms ({sources}){worst}"
    )
