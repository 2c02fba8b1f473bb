"""`labr-mission console` and `labr-mission replay`: the page beside a flight, or of a recording."""

from __future__ import annotations

import contextlib
import json
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labr_autonomy.errors import BadInput, ExitCode, Refused

if TYPE_CHECKING:
    from labr_autonomy.console.process import ConsoleOptions

_PORT = 8460

_served: list[Callable[[Any], Any]] = [
    click.option(
        "--host", default="127.0.0.1", metavar="ADDRESS", help="Address of the page (default: this machine)."
    ),
    click.option(
        "--port", type=click.IntRange(0, 65535), default=_PORT, help=f"Its port (default: {_PORT}; 0: any)."
    ),
    click.option(
        "--token-file",
        type=click.Path(path_type=Path, dir_okay=False),
        metavar="FILE",
        help="Holds the token of operators; needed where others can reach the page.",
    ),
]


def served(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options of whatever serves the page."""
    for option in reversed(_served):
        command = option(command)
    return command


def console_options(host: str, port: int, token_file: Path | None) -> ConsoleOptions:
    """The options as one value."""
    from labr_autonomy.console.process import ConsoleOptions

    return ConsoleOptions(host, port, token_file)


@click.command()
@click.option("--pid", type=int, help="Process of the flight; the newest one by default.")
@served
@click.option("--json", "as_json", is_flag=True, help="JSON on stdout, for machines.")
def console(pid: int | None, host: str, port: int, token_file: Path | None, as_json: bool) -> None:
    """Serve the operator's page of a flight that is running on this machine.

    Prints an address with a token for operators, and one for viewers. Ctrl-C ends the page, never the flight.
    """
    from labr_autonomy.console import names

    running = names.running()
    if pid is None and not running:
        raise Refused("no flight is running on this machine", "Begin one with labr-mission fly MISSION.yaml")
    if pid is not None and pid not in running:
        raise BadInput(f"process {pid} is no flight", f"There are: {', '.join(map(str, running)) or 'none'}")
    _serve(console_options(host, port, token_file), as_json, pid=running[0] if pid is None else pid)


@click.command()
@click.argument("run", type=click.Path(path_type=Path, file_okay=False))
@served
@click.option("--check", is_flag=True, help="Plan and decide again on the recorded inputs, and compare.")
@click.option(
    "--weights",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="With --check: another network than the recorded flight's.",
)
@click.option("--repair", is_flag=True, help="Make the logs of a run that was cut off whole again.")
@click.option("--json", "as_json", is_flag=True, help="JSON on stdout, for machines.")
def replay(
    run: Path,
    host: str,
    port: int,
    token_file: Path | None,
    check: bool,
    weights: Path | None,
    repair: bool,
    as_json: bool,
) -> None:
    """Play RUN on the operator's page; or compare it with what would be decided today; or repair it.

    --check runs network, map, refiner, modes and guard on what RUN recorded and ends with 4 when anything
    comes out differently; the first difference is named.
    """
    if check and repair:
        raise BadInput("--check and --repair are two things", "Repair first, then check")
    if weights is not None and not check:
        raise BadInput("--weights is for --check", "Add --check")
    if not run.is_dir():
        raise BadInput(f"{run} is not there", "Name the folder of a run")
    if repair:
        _repair(run, as_json)
    elif check:
        _check(run, weights, as_json)
    else:
        if not (run / "flight.mcap").is_file():
            raise BadInput(f"{run} has no flight.mcap", "Name the folder of a run")
        _serve(console_options(host, port, token_file), as_json, run=run.resolve())


def _serve(
    options: ConsoleOptions, as_json: bool, *, pid: int | None = None, run: Path | None = None
) -> None:
    import tempfile

    from labr_autonomy.console.process import ConsoleProcess

    with (
        contextlib.suppress(KeyboardInterrupt),
        interrupted_by(signal.SIGTERM, signal.SIGHUP),
        tempfile.TemporaryDirectory(prefix="labr-console-") as scratch,
        ConsoleProcess(options, pid=pid, run=run, log_path=Path(scratch) / "console.log") as served_page,
    ):
        if as_json:
            click.echo(json.dumps({"operator": served_page.urls[0], "viewer": served_page.urls[1]}))
        else:
            click.echo("\n".join([*served_page.sentences, "Ctrl-C ends it"]))
        served_page.wait()


@contextlib.contextmanager
def interrupted_by(*numbers: int) -> Iterator[None]:
    """Each of these signals ends what runs within as Ctrl-C does."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    before = {number: signal.signal(number, interrupt) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _repair(run: Path, as_json: bool) -> None:
    from labr_autonomy.record.repair import repair_run

    repaired = repair_run(run)
    if as_json:
        click.echo(json.dumps({"repaired": [found.as_dict() for found in repaired]}))
    else:
        click.echo("\n".join(found.sentence for found in repaired))


def _check(run: Path, weights: Path | None, as_json: bool) -> None:
    from labr_autonomy.commands.progress import show_count
    from labr_autonomy.replay.check import check_run
    from labr_autonomy.replay.plans import count_plans

    with show_count(count_plans(run), "plans", quiet=as_json) as say:
        verdict = check_run(run, weights=weights, on_progress=lambda done: say(done, ""))
    if as_json:
        click.echo(json.dumps(verdict.as_dict()))
    else:
        click.echo(verdict.sentence)
    if verdict.first is not None:
        click.get_current_context().exit(int(ExitCode.EXPECTATION_MISSED))
