"""`labr-mission bench transitions`: stop, lift off, land and drive on, by the hundred."""

from __future__ import annotations

import json
import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labr_autonomy.commands.checks import json_option, out_option
from labr_autonomy.errors import ExitCode

if TYPE_CHECKING:
    from sim.bench.transitions.trial import Hop


@click.command()
@click.option("--trials", type=click.IntRange(1, 100_000), default=200, metavar="N", help="Hand-overs.")
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), default=0, help="Of the first; others follow.")
@click.option(
    "--whole", is_flag=True, help="With camera, map and network as well; takes three times as long."
)
@click.option("--jobs", type=click.IntRange(1, 1024), metavar="J", help="At once (default: cores).")
@out_option
@json_option
def transitions(
    trials: int, seed: int, whole: bool, jobs: int | None, out: Path | None, as_json: bool
) -> None:
    """Stop, lift off, land and drive on, in gusts and on slopes up to 5 degrees.

    Each trial draws slope, heading, wind, charge and distances by its seed and is flown in lock-step by the
    flight's own code on open ground. Ends with 4 unless all are done, the 99th percentile of the stop error
    is within 0.10 m and no touch-down was faster than 0.4 m/s. Ctrl-C tells the figures so far.
    """
    from labr_autonomy.record.run_folder import make_run_folder
    from labr_autonomy.record.summary import versions
    from sim.bench.records import plain, write_whole
    from sim.bench.transitions.figures import lines, summary

    folder = out or make_run_folder("bench-transitions")
    folder.mkdir(parents=True, exist_ok=True)
    at_once = jobs or len(os.sched_getaffinity(0))
    hops, stopped = _fly(range(seed, seed + trials), at_once, whole=whole, quiet=as_json)
    if not hops:
        click.echo("labr-mission: stopped by the operator before the first hand-over was done", err=True)
        click.get_current_context().exit(int(ExitCode.ABORTED))
    found = summary(hops)
    answer: dict[str, Any] = {
        "command": f"labr-mission bench transitions --trials {trials} --seed {seed}{' --whole' * whole}",
        "seed": seed,
        "versions": versions(),
        **plain(found),
        "rows": [plain(hop.as_dict()) for hop in hops],
    }
    write_whole(folder / "results.json", json.dumps(answer, indent=1, allow_nan=False) + "\n")
    if as_json:
        click.echo(json.dumps({k: v for k, v in answer.items() if k != "rows"}))
    else:
        click.echo("\n".join([*lines(found), f"Every trial: {folder / 'results.json'}"]))
    if stopped:
        click.echo(f"labr-mission: stopped by the operator after {len(hops)} of {trials}", err=True)
        click.get_current_context().exit(int(ExitCode.ABORTED))
    if not all(found["met"].values()):
        click.get_current_context().exit(int(ExitCode.EXPECTATION_MISSED))


def _fly(seeds: range, jobs: int, *, whole: bool, quiet: bool) -> tuple[list[Hop], bool]:
    """The trials by seed, and whether Ctrl-C ended them before the last."""
    from labr_autonomy.commands.progress import show_count
    from sim.bench.transitions.trial import fly
    from sim.training_data.workers import carried_out

    hops: list[Hop] = []
    stopped = False
    with show_count(len(seeds), "hand-overs", quiet=quiet) as say:
        try:
            for hop in carried_out(partial(fly, whole=whole), seeds, jobs):
                hops.append(hop)
                failed = sum(not h.done for h in hops)
                say(len(hops), f"{failed} failed" if failed else "")
        except KeyboardInterrupt:
            stopped = True
    return sorted(hops, key=lambda hop: hop.conditions.seed), stopped
