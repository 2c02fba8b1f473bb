"""`labr-mission bench`: many flights in lock-step, and what they add up to."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labr_autonomy.commands.ablation import table1
from labr_autonomy.commands.checks import camera, crosscheck
from labr_autonomy.commands.console_bench import console
from labr_autonomy.commands.links import links
from labr_autonomy.commands.networks import table2
from labr_autonomy.commands.refiner import refiner
from labr_autonomy.commands.transitions import transitions
from labr_autonomy.errors import BadInput

if TYPE_CHECKING:
    from sim.bench.run import Findings
    from sim.bench.settings import Place, Settings
    from sim.lockstep.trial import Task

FAULT = 1  # exit code when the program failed in a trial
SEED_MAX = 2**31 - 1

family_option = click.option("--family", metavar="F[,F..]|all", help="indoor, rooms, garage, forest.")
difficulty_option = click.option(
    "--difficulty", type=click.FloatRange(0.0, 1.0), metavar="D", help="Of generated worlds: 0 easy, 1 hard."
)
_common: list[Callable[[Any], Any]] = [
    click.option(
        "--jobs", type=click.IntRange(1, 1024), metavar="J", help="Flights at once (default: cores)."
    ),
    click.option("--seed", type=click.IntRange(0, SEED_MAX), default=0, help="Of the first trial."),
    click.option(
        "--out",
        type=click.Path(path_type=Path, file_okay=False),
        metavar="DIR",
        help="Run folder; one that holds the same benchmark is continued (default: a new one in runs).",
    ),
    click.option("--resume", is_flag=True, help="Continue: in --out DIR, or the latest such run in runs."),
    click.option("--json", "as_json", is_flag=True, help="JSON on stdout, for machines."),
    click.option("--cluster", metavar="ADDRESS", help="Compute on Ray: ray://host:port, or local."),
    click.option(
        "--robot",
        type=click.Path(path_type=Path, dir_okay=False),
        metavar="FILE",
        help="robot.yaml with other masses and limits.",
    ),
    click.option("--no-pictures", is_flag=True, help="Write the tables only."),
]
world_option = click.option(
    "--world",
    "worlds",
    type=click.Path(path_type=Path, dir_okay=False),
    multiple=True,
    metavar="FILE.yaml",
    help="A mesh world: a file, or a name: workshop.yaml, small_house.yaml, ... May be repeated.",
)
movers_option = click.option(
    "--movers",
    type=click.IntRange(0, 50),
    default=0,
    metavar="N",
    help="People and boxes that walk across the way in each trial.",
)
worlds_dir_option = click.option(
    "--worlds",
    "worlds_dir",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Folder with meshes and world files.",
)


def _with_common(command: Callable[..., None]) -> Callable[..., None]:
    for option in reversed(_common):
        command = option(command)
    return command


@click.group()
def bench() -> None:
    """Fly many trials in lock-step and print what they add up to."""


@bench.command()
@family_option
@world_option
@click.option(
    "--trials", type=click.IntRange(1, 100_000), default=100, metavar="N", help="In each world kind."
)
@click.option(
    "--method",
    default="all",
    metavar="M[,M..]|all",
    help="two-stage, iplanner, mapping, oracle; network, network@DIR.",
)
@difficulty_option
@movers_option
@worlds_dir_option
@_with_common
def navigation(
    family: str | None,
    worlds: tuple[Path, ...],
    trials: int,
    method: str,
    difficulty: float | None,
    movers: int,
    **common: Any,
) -> None:
    """Goals on land and in the air, in generated worlds and in meshes.

    Trial i has seed S0 + i: world, start, goal, noise and disturbances follow from it. The oracle flies each
    task first, without movers; what it does not reach is not counted. Ctrl-C keeps what is done.
    """
    from sim.bench.methods import find_methods
    from sim.bench.page import navigation_page
    from sim.bench.run import write_results
    from sim.bench.settings import Settings

    methods = tuple(m.name for m in find_methods(method))
    places = find_places(family, worlds, difficulty, common.pop("worlds_dir"), movers)
    arguments = ["--trials", str(trials), "--method", ",".join(methods), "--seed", str(common["seed"])]
    generated = [place.name for place in places if "family" in place.spec]
    arguments += ["--family", ",".join(generated)] if generated else []
    arguments += [word for path in worlds for word in ("--world", str(path))]
    arguments += [] if difficulty is None else ["--difficulty", f"{difficulty:g}"]
    arguments += ["--movers", str(movers)] if movers else []
    settings = Settings(
        "navigation",
        places,
        methods,
        trials,
        common["seed"],
        tuple(arguments),
        load_robot_values(common["robot"]),
    )
    findings = carry_out(settings, common)
    results = findings.results()
    write_results(findings.folder, results, navigation_page(results))
    if not common["no_pictures"]:
        from sim.bench.gallery import draw_navigation

        draw_navigation(findings, results)
    _end(findings, results, as_json=common["as_json"])


@bench.command()
@click.option(
    "--trials", type=click.IntRange(1, 10_000), default=10, metavar="N", help="Seeds for each task."
)
@click.option(
    "--method",
    default="all",
    metavar="M[,M..]|all",
    help="two-stage, iplanner, mapping, oracle; network, network@DIR.",
)
@_with_common
def table3(trials: int, method: str, **common: Any) -> None:
    """The paper's two tasks, beside its own figures.

    A goal on the floor behind obstacles and a goal in the air out of sight, each flown with N seeds of noise.
    """
    from sim.bench.methods import find_methods
    from sim.bench.run import write_results
    from sim.bench.table3 import table3_page, table3_settings, table3_tasks, with_paper

    methods = tuple(m.name for m in find_methods(method))
    settings = table3_settings(methods, trials, common["seed"], load_robot_values(common["robot"]))
    findings = carry_out(settings, common, table3_tasks(settings))
    results = with_paper(findings.results())
    write_results(findings.folder, results, table3_page(results))
    if not common["no_pictures"]:
        from sim.bench.gallery import draw_ways

        draw_ways(findings)
    _end(findings, results, as_json=common["as_json"])


bench.add_command(crosscheck)
bench.add_command(camera)
bench.add_command(links)
bench.add_command(console)
bench.add_command(table1)
bench.add_command(table2)
bench.add_command(transitions)
bench.add_command(refiner)


def find_places(
    family: str | None,
    worlds: tuple[Path, ...],
    difficulty: float | None,
    worlds_dir: Path | None,
    movers: int = 0,
) -> tuple[Place, ...]:
    """Where to fly.

    Args:
        family: Families with commas, or all.
        worlds: World files: paths, or names of files in `worlds_dir` or of those that come along.
        difficulty: Of generated worlds.
        worlds_dir: Folder of meshes and world files.
        movers: How many people and boxes walk across the way in each trial.

    Raises:
        BadInput: for an unknown family, two places of one name, or none at all.
    """
    from sim.bench.settings import Place
    from sim.worlds.families.draw import DIFFICULTY, SIZES

    names = [name.strip() for name in (family or "").split(",") if name.strip()]
    names = list(SIZES) if names == ["all"] else names
    unknown = [name for name in names if name not in SIZES]
    if unknown:
        raise BadInput(f"there is no world family '{unknown[0]}'", f"Take {', '.join(SIZES)}, or all")
    if difficulty is not None and not names:
        raise BadInput("--difficulty is of generated worlds, and none is named", "Name one by --family")
    hardness = DIFFICULTY if difficulty is None else difficulty
    places = [Place(name, {"family": name, "difficulty": hardness}) for name in names]
    if worlds:
        from sim.bench.settings import world_place

        places += [world_place(path, worlds_dir) for path in worlds]
    if not places:
        raise BadInput("no world is named", "Say --family indoor (or all), or --world FILE.yaml")
    twice = [p.name for i, p in enumerate(places) if p.name in {q.name for q in places[:i]}]
    if twice:
        raise BadInput(f"two worlds are called '{twice[0]}'", "Give one another `name` in its file")
    if movers:
        places = [Place(p.name, {**p.spec, "movers": movers}) for p in places]
    return tuple(places)


def load_robot_values(path: Path | None) -> dict[str, Any] | None:
    """Fields of a robot.yaml; None stands for the standard robot."""
    if path is None:
        return None
    from labr_autonomy.mission.load import load_robot

    robot: dict[str, Any] = load_robot(path).model_dump(mode="json")
    return robot


def carry_out(
    settings: Settings, common: dict[str, Any], fixed: dict[tuple[str, int], Task] | None = None
) -> Findings:
    """Fly what is missing.

    Args:
        settings: The question.
        common: The options `out`, `resume`, `jobs`, `cluster` and `as_json` by name.
        fixed: The tasks, where they are not sampled.
    """
    from labr_autonomy.commands.progress import show_progress
    from sim.bench import run
    from sim.bench.settings import open_folder

    folder = open_folder(settings, common["out"], resume=common["resume"])
    jobs = common["jobs"] or len(os.sched_getaffinity(0))

    def begin() -> Any:
        return run.make_executor(jobs, common["cluster"], folder, capped=common["jobs"] is not None)

    with show_progress(quiet=common["as_json"]) as on_progress:
        return run.run_bench(settings, folder, begin, on_progress, fixed)


def _end(findings: Findings, results: dict[str, Any], *, as_json: bool) -> None:
    """Tell the results, and end with 1 when the program failed somewhere."""
    if as_json:
        click.echo(json.dumps(results))
    else:
        from labr_autonomy.commands.table import print_rows

        print_rows(results["rows"])
        click.echo(f"All figures, pictures and replays: {findings.folder / 'results.md'}")
    end_by_errors(findings, results)


def end_by_errors(findings: Findings, results: dict[str, Any]) -> None:
    """End with 1 and a sentence when the program failed somewhere."""
    failed = results["errors"]
    if failed:
        first = failed[0]
        click.echo(
            f"labr-mission: the program failed in {len(failed)} of {len(findings.records)} flights, first in "
            f"{first['family']} seed {first['seed']}, {first['method']}: {first['error'].rstrip('.')}. "
            f"Tracebacks are in {findings.folder / 'trials.jsonl'}.",
            err=True,
        )
        click.get_current_context().exit(FAULT)
