"""The rows of a benchmark on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

import click


def print_rows(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print a table to stdout; the full one is in results.md."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    from sim.bench.page import number, with_interval

    table = Table(box=box.SIMPLE, pad_edge=False)
    for name in ("family", "method"):
        table.add_column(name, no_wrap=True)
    head = ("trials", "reached %", "contact %", "timeout %", "time s", "driven m", "flown m", "energy kJ")
    for name in (*head, "/ oracle", "SPL", "plan p50 ms"):
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(
            row["family"],
            row["method"] + (" (land)" if row["land_only"] else ""),
            str(row["trials"]),
            with_interval(row, "reached_pct", 0),
            number(row["contact_pct"], 0),
            number(row["timeout_pct"], 0),
            number(row["time_s"], 1),
            number(row["land_m"], 1),
            number(row["air_m"], 1),
            number(row["energy_j"], 2, 1e-3),
            number(row["energy_over_oracle"], 2),
            number(row["spl"], 2),
            number(row["plan_cycle_ms"]["p50"], 1),
        )
    console = Console(width=None if sys.stdout.isatty() else 140, markup=False)
    with console.capture() as captured:
        console.print(table)
    click.echo(captured.get().rstrip())
