"""`labr-mission bench table2`: the planning networks themselves, without a flight."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path

import click

from labr_autonomy.commands.checks import json_option, out_option
from labr_autonomy.errors import BadInput

TORCH_HELP = "pip install torch==2.13.0 --index-url https://download.pytorch.org/whl/cpu"


def need_training() -> None:
    """Refuse in one sentence where the packages for training are missing."""
    missing = [name for name in ("torch", "safetensors", "onnx", "tensorboard") if find_spec(name) is None]
    if missing:
        raise BadInput(
            f"the networks are built by {missing[0]}, which is not installed",
            f"Run: {TORCH_HELP} && pip install 'labr-autonomy[train]'",
        )


@click.command()
@click.option(
    "--rounds",
    type=click.IntRange(0, 10_000),
    default=20,
    metavar="R",
    help="Turns of each network on the processor, 10 plans each; 0 for sizes alone.",
)
@out_option
@json_option
def table2(rounds: int, out: Path | None, as_json: bool) -> None:
    """The paper's networks and ours: parameters, FLOPs and latency, beside the paper's figures.

    Latency wants an otherwise idle machine; the networks take turns, so that their ratios hold on any.
    """
    need_training()
    from labr_autonomy.commands.progress import show_steps
    from labr_autonomy.record.run_folder import make_run_folder
    from labr_autonomy.record.summary import versions
    from sim.bench.run import write_results
    from sim.bench.table2 import THREADS, table2_page, table2_rows

    with show_steps(rounds * len(THREADS), "rounds", quiet=as_json) as on_round:
        rows = table2_rows(rounds, on_round)
    command = f"labr-mission bench table2 --rounds {rounds}"
    results = {"command": command, "seed": 0, "versions": versions(), "rows": rows}
    folder = out or make_run_folder("bench-table2")
    folder.mkdir(parents=True, exist_ok=True)
    page = table2_page(results)
    write_results(folder, results, page)
    click.echo(json.dumps(results) if as_json else f"{page}\n{folder / 'results.md'}")
