"""`labr-mission bench refiner`: random problems by the ten thousand, and a judge that trusts nobody."""

from __future__ import annotations

import json
import math
import os
from typing import TYPE_CHECKING, Any

import click

from labr_autonomy.commands.checks import json_option
from labr_autonomy.errors import ExitCode

if TYPE_CHECKING:
    from sim.bench.refiner.problems import Tally

MODES = ("land", "air")


@click.command()
@click.option(
    "--problems", type=click.IntRange(1, 10_000_000), default=2_000, metavar="N", help="Of each mode."
)
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), default=0, help="Of the first ten; others follow.")
@click.option("--jobs", type=click.IntRange(1, 1024), metavar="J", help="At once (default: cores).")
@json_option
def refiner(problems: int, seed: int, jobs: int | None, as_json: bool) -> None:
    """Give the refiner random problems and judge every trajectory that leaves it.

    Boxes, posts and unknown floor in a walled square, key points through all of it, things that appear
    ahead; each problem begins where the last trajectory led. A trajectory may not touch anything, come
    nearer than the clearance promised, break a limit or end in motion. Ends with 4 if one does. Ctrl-C
    tells the figures so far.
    """
    from labr_autonomy.record.summary import versions

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
