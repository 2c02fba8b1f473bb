"""`labr-mission bench table1`: trained networks flown alone, and whether the paper's parts help them."""

from __future__ import annotations

import json
from pathlib import Path

import click

from labr_autonomy.commands.checks import json_option, out_option


@click.command()
@click.option(
    "--runs",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    metavar="DIR",
    help="Folder of weights' folders, one for each trained network.",
)
@click.option("--family", default="all", metavar="F[,F..]|all", help="indoor, rooms, garage, forest.")
@click.option(
    "--trials",
    type=click.IntRange(1, 100_000),
    default=100,
    metavar="N",
    help="In each family, each network.",
)
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), default=0, help="Of the first trial.")
@click.option("--jobs", type=click.IntRange(1, 1024), metavar="J", help="Flights at once (default: cores).")
@out_option
@json_option
def table1(
    runs: Path, family: str, trials: int, seed: int, jobs: int | None, out: Path | None, as_json: bool
) -> None:
    """The paper's ablation: networks with and without SPN and LAPN, each alone in the loop.

    Every network in DIR (iplanner, lapn, spn, gkpn at one resolution, each trained with one seed or more)
    flies the same trials without map and refiner. Ctrl-C keeps what is done; the same command with --out on
    the run folder goes on from there.
    """
    from labr_autonomy.commands.bench import carry_out, end_by_errors, find_places
    from sim.bench.alone.trained import find_trained
    from sim.bench.run import write_results
    from sim.bench.table1 import table1_page, table1_results, table1_settings

    trained = find_trained(runs)
    places = find_places(family, (), None, None)
    families = ",".join(place.name for place in places)
    arguments = ("--runs", str(runs), "--family", families, "--trials", str(trials), "--seed", str(seed))
    settings = table1_settings(trained, places, trials, seed, arguments)
    common = {"out": out, "resume": False, "jobs": jobs, "cluster": None, "as_json": as_json}
    findings = carry_out(settings, common)
    results = table1_results(findings, trained)
    page = table1_page(results)
    write_results(findings.folder, results, page)
    click.echo(json.dumps(results) if as_json else f"{page}\n{findings.folder / 'results.md'}")
    end_by_errors(findings, results)
