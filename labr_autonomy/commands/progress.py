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


@contextlib.contextmanager
def show_steps(total: int, what: str, *, quiet: bool = False) -> Iterator[Callable[[], None]]:
    """Yields what is to be called after each of `total` steps of one kind; everything goes to stderr."""
    with show_count(total, what, quiet=quiet) as say:
        done = 0

        def step() -> None:
            nonlocal done
            done += 1
            say(done, "")

        yield step


@contextlib.contextmanager
def show_count(total: int, what: str, *, quiet: bool = False) -> Iterator[Callable[[int, str], None]]:
    """Yields what is to be called with how many of `total` are done, and words; all goes to stderr."""
    if quiet or not total:
        yield lambda done, words: None
    elif sys.stderr.isatty():
        from rich import progress as rich_progress
        from rich.console import Console

        columns = (
            rich_progress.TextColumn(f"{what} {{task.completed:.0f}}/{total}"),
            rich_progress.BarColumn(),
            rich_progress.TextColumn("left"),
            rich_progress.TimeRemainingColumn(compact=True),
            rich_progress.TextColumn("{task.fields[words]}"),
        )
        with rich_progress.Progress(*columns, console=Console(stderr=True)) as bar:
            task = bar.add_task("", total=total, words="")
            yield lambda done, words: bar.update(task, completed=done, words=words)
    else:
        lines = _Lines()
        yield lambda done, words: lines.say(done, total, f"{what}: {done}/{total}  {words}".rstrip())


class _Lines:
    """One line every EVERY_S, and one at the end."""

    def __init__(self) -> None:
        self._clock = SystemClock()
        self._due_s = self._clock.now_s()

    def __call__(self, state: Progress) -> None:
        """Say how far a benchmark is, when it is time."""
        self.say(state.done, state.total, f"{state.done}/{state.total} flights, {words(state)}")

    def say(self, done: int, total: int, line: str) -> None:
        """Say a line when it is time."""
        now_s = self._clock.now_s()
        if now_s >= self._due_s or done == total:
            self._due_s = now_s + EVERY_S
            click.echo(line, err=True)


def words(state: Progress) -> str:
    """What has come of the flights so far."""
    flown = state.done - state.errors
    share = f" ({100.0 * state.reached / flown:.0f} %)" if flown else ""
    failed = f", {state.errors} failed in the program" if state.errors else ""
    return f"{state.reached} reached{share}{failed}"
