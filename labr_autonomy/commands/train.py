"""`labr-mission train`: from nothing to a weights' folder, by one command that can be stopped and goes on."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labr_autonomy.commands.checks import json_option
from labr_autonomy.commands.networks import need_training
from labr_autonomy.errors import BadInput

if TYPE_CHECKING:
    from labr_autonomy.gkpn.learning.machine import Machine
    from labr_autonomy.gkpn.learning.settings import Scenes, Settings
    from labr_autonomy.gkpn.learning.train import Lesson
    from labr_autonomy.gkpn.networks.planner import PlanningNetwork

_folder = click.Path(path_type=Path, file_okay=False)


@click.command()
@click.argument("settings", type=click.Path(path_type=Path))
@click.option("--out", type=_folder, required=True, metavar="DIR", help="Checkpoints, log and weights.")
@click.option(
    "--data",
    "data_dir",
    type=_folder,
    metavar="DIR",
    help="Where data sets are, or are made (default: data).",
)
@click.option("--training", multiple=True, type=_folder, metavar="DIR", help="A data set at hand instead.")
@click.option("--validation", multiple=True, type=_folder, metavar="DIR", help="The same for unseen views.")
@click.option("--weights", type=_folder, metavar="DIR", help="Where the weights go (default: OUT/weights).")
@click.option("--set", "changed", multiple=True, metavar="FIELD=VALUE", help="Instead of what the file says.")
@click.option("--worlds", type=_folder, metavar="DIR", help="Folder with mesh worlds.")
@json_option
@click.option("--quiet", is_flag=True, help="No live line.")
def train(
    settings: Path,
    out: Path,
    data_dir: Path | None,
    training: tuple[Path, ...],
    validation: tuple[Path, ...],
    weights: Path | None,
    changed: tuple[str, ...],
    worlds: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Train a planning network by SETTINGS, a YAML file or one of: shipped, table1, iplanner.

    Makes the data that the settings ask for where they are not there yet, asks the teacher, trains, chooses
    the best state by flights, calibrates mu and writes the weights' folder. Ctrl-C keeps the last checkpoint;
    the same command goes on from there. `torchrun -m labr_autonomy train ...` spreads it over processes.
    """
    need_training()
    from labr_autonomy.commands.progress import show_count
    from labr_autonomy.gkpn.learning.machine import find_machine
    from labr_autonomy.gkpn.learning.settings import read_settings

    said = read_settings(settings, _changes(changed))
    machine = find_machine(said.precision, said.threads)
    silent = quiet or as_json or not machine.leads

    def show(total: int, what: str) -> Any:
        return show_count(total, what, quiet=silent)

    if machine.leads:
        _make_data(said, data_dir or Path("data"), training, validation, worlds, silent=silent)
    machine.wait()
    lesson = _lesson(said, data_dir or Path("data"), training, validation, out, machine, show)
    net, parts = _train(said, lesson, out, machine, show)
    if not machine.leads:
        return
    from labr_autonomy.gkpn.learning.export import export

    target = weights or out / "weights"
    facts = {
        "settings": said.model_dump(mode="json"),
        "seed": said.seed,
        "steps": said.steps,
        "loss": round(parts.get("total", float("nan")), 4),
        "data": lesson.training.facts(),
        "validation": lesson.validation.facts(),
    }
    metrics = export(net, target, said, facts, lesson.validation)
    if as_json:
        click.echo(json.dumps({"weights": str(target), "training": facts, "metrics": metrics}))
        return
    click.echo(_sentence(target, metrics["network"]))


def _sentence(folder: Path, figures: dict[str, Any]) -> str:
    free, reached = (100.0 * (figures[name] or 0.0) for name in ("collision_free", "reached"))
    return (
        f"{folder}: of {figures['paths']} unseen paths {free:.1f} % keep clear and {reached:.1f} % arrive as "
        f"well; mu: AUC {figures['mu_auc']}, calibration error {figures['mu_calibration_error']}"
    )


def _changes(changed: tuple[str, ...]) -> dict[str, Any]:
    """Fields given on the command line; nested ones with dots are not asked for."""
    from ruamel.yaml import YAML

    out: dict[str, Any] = {}
    for text in changed:
        name, sign, value = text.partition("=")
        if not sign:
            raise BadInput(f"--set {text} has no value", "Say --set FIELD=VALUE, such as --set seed=1.")
        out[name] = YAML(typ="safe").load(value)
    return out


def data_folder(root: Path, scenes: Scenes, settings: Settings) -> Path:
    """Where a data set of these scenes lies, for the size of this network's images."""
    from labr_autonomy.gkpn.networks.presets import find_network

    config = find_network(settings.network)
    names = "-".join([*scenes.families, *(Path(world).stem for world in scenes.worlds)])
    size = f"{config.width}x{config.height}"
    return root / f"{names}-{scenes.scenes}x{scenes.views}x{scenes.goals}-{size}-seed{scenes.seed}"


def _make_data(
    settings: Settings,
    root: Path,
    training: tuple[Path, ...],
    validation: tuple[Path, ...],
    worlds: Path | None,
    *,
    silent: bool,
) -> None:
    """Complete the data sets that are not given."""
    from labr_autonomy.commands.dataset import check_seeds, find_worlds
    from labr_autonomy.commands.progress import show_steps
    from labr_autonomy.gkpn.networks.presets import find_network
    from sim.training_data.build import SceneConfig
    from sim.training_data.folder import fill, scene_jobs

    config = find_network(settings.network)
    for given, scenes in ((training, settings.training), (validation, settings.validation)):
        if given:
            continue
        places = find_worlds(",".join(scenes.families), tuple(Path(w) for w in scenes.worlds), worlds)
        check_seeds(scenes.seed, scenes.scenes, any_seed=not scenes.families)
        size = SceneConfig(scenes.views, scenes.goals, config.width, config.height)
        pieces, facts = scene_jobs(places, scenes.seed, scenes.scenes, size)
        with show_steps(len(pieces), "scenes", quiet=silent) as on_scene:
            fill(data_folder(root, scenes, settings), facts, pieces, len(os.sched_getaffinity(0)), on_scene)


def _lesson(
    settings: Settings,
    root: Path,
    training: tuple[Path, ...],
    validation: tuple[Path, ...],
    out: Path,
    machine: Machine,
    show: Callable[[int, str], Any],
) -> Lesson:
    """The data in memory, with the teacher's paths where one is asked for."""
    from labr_autonomy.gkpn.learning.cost import Cost
    from labr_autonomy.gkpn.learning.teacher import taught
    from labr_autonomy.gkpn.learning.train import Lesson
    from labr_autonomy.gkpn.learning.views import load_views

    views = load_views(training or (data_folder(root, settings.training, settings),))
    unseen = load_views(validation or (data_folder(root, settings.validation, settings),))
    if settings.land_only:
        views, unseen = views.only_land(), unseen.only_land()
    cost = settings.cost()
    if not settings.teacher.weight or not isinstance(cost, Cost):
        return Lesson(views, unseen)
    out.mkdir(parents=True, exist_ok=True)
    points = None
    if machine.leads:
        with show(int(views.hard.sum()), "taught goals") as say:
            done = 0

            def on_goals(count: int) -> None:
                nonlocal done
                done += count
                say(done, "")

            points = taught(views, cost, out, on_goals)
    machine.wait()
    return Lesson(views, unseen, taught(views, cost, out) if points is None else points)


def _train(
    settings: Settings, lesson: Lesson, out: Path, machine: Machine, show: Callable[[int, str], Any]
) -> tuple[PlanningNetwork, dict[str, float]]:
    from labr_autonomy.gkpn.learning.report import BoardLog
    from labr_autonomy.gkpn.learning.train import train as learn

    log = BoardLog(out / "log") if machine.leads else None
    last: dict[str, float] = {}
    seen = ""

    class Told:
        """Passes on what happens to the screen and to the log."""

        def step(self, done: int, parts: dict[str, float], rate: float) -> None:
            last.clear()
            last.update(parts)
            if log is not None:
                log.step(done, parts, rate)
            words = "  ".join(f"{name} {value:.3g}" for name, value in parts.items())
            say(done, f"{words}{seen}")

        def check(self, done: int, figures: dict[str, Any]) -> None:
            nonlocal seen
            seen = f"  unseen free {100.0 * figures['collision_free']:.1f} %"
            if log is not None:
                log.check(done, figures)

        def flown(self, done: int, share: float) -> None:
            nonlocal seen
            seen += f"  flown {100.0 * share:.0f} %"
            if log is not None:
                log.flown(done, share)

    with show(settings.steps, "steps") as say:
        net = learn(lesson, settings, out, machine, Told(), _flights(settings, lesson))
    if log is not None:
        log.close()
    return net, last


def _flights(settings: Settings, lesson: Lesson) -> Callable[[PlanningNetwork], float] | None:
    """What flies a network alone and says which share of flights arrives; None where none are asked for."""
    if not settings.closed_loop.every:
        return None
    from labr_autonomy.gkpn.learning.export import export
    from sim.bench.alone.validate import closed_loop

    def fly(net: PlanningNetwork) -> float:
        asked = settings.closed_loop
        with tempfile.TemporaryDirectory() as folder:
            export(net, Path(folder), settings, {}, lesson.validation)
            found = closed_loop(Path(folder), asked.families, asked.trials, jobs=len(os.sched_getaffinity(0)))
        return float(found["reached_pct"]) / 100.0

    return fly
