"""How far a benchmark is: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import click

from labr_autonomy.clock import SystemClock

if TYPE_CHECKING:
    from sim.bench.campaign import Progress

EVERY_S = 30.0  # between two lines where there is no terminal


@contextlib.contextmanager
def show_progress(*, quiet: bool) -> Iterator[Callable[[Progress], None]]:
    """Yields what is to be called after each flight; everything goes to stderr.

    Args:
        quiet: Show nothing.
    """
    if quiet:
        yield lambda _: None
    elif sys.stderr.isatty():
        with _bar() as update:
            yield update
    else:
        yield _Lines()


@contextlib.contextmanager
def _bar() -> Iterator[Callable[[Progress], None]]:
    from rich import progress as rich_progress
    from rich.console import Console

    columns = (
        rich_progress.TextColumn("{task.completed:.0f}/{task.total:.0f} flights"),
        rich_progress.BarColumn(),
        rich_progress.TextColumn("{task.fields[words]}"),
        rich_progress.TextColumn("left"),
        rich_progress.TimeRemainingColumn(compact=True),
    )
    with rich_progress.Progress(*columns, console=Console(stderr=True), speed_estimate_period=600.0) as bar:
        task = bar.add_task("", total=1, words="")

        def update(state: Progress) -> None:
            bar.update(task, total=max(state.total, 1), completed=state.done, words=words(state))

        yield update


class _Lines:
    """One line every EVERY_S, and one at the end."""

    def __init__(self) -> None:
        self._clock = SystemClock()
        self._due_s = self._clock.now_s()

    def __call__(self, state: Progress) -> None:
        """Say it when it is time."""
        now_s = self._clock.now_s()
        if now_s >= self._due_s or state.done == state.total:
            self._due_s = now_s + EVERY_S
            click.echo(f"{state.done}/{state.total} flights, {words(state)}", err=True)


def words(state: Progress) -> str:
    """What has come of the flights so far."""
    flown = state.done - state.errors
    share = f" ({100.0 * state.reached / flown:.0f} %)" if flown else ""
    failed = f", {state.errors} failed in the program" if state.errors else ""
    return f"{state.reached} reached{share}{failed}"
