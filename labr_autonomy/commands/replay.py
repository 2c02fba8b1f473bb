"""`labr-mission sim --family ... --seed ...`: one trial of the benchmark again, to be looked at."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import click

from labr_autonomy.errors import BadInput

EVENTS_SHOWN = 12


def replay(
    *,
    family: str | None,
    world: Path | None,
    worlds_dir: Path | None,
    seed: int,
    method: str,
    difficulty: float | None,
    movers: int,
    robot: Path | None,
    out: Path | None,
    show: bool,
) -> None:
    """Sample the task, fly it in lock-step, and tell how it went.

    Args:
        family: Name of a generated family, or
        world: a mesh world's file.
        worlds_dir: Folder of meshes and world files.
        seed: Of the trial.
        method: A name that `sim.bench.methods` knows.
        difficulty: Of a generated world.
        movers: How many people and boxes walk across the way.
        robot: robot.yaml, or None for the standard robot.
        out: Where the run folder is made.
        show: Draw the picture, and open it where there is a display.
    """
    from labr_autonomy.commands.bench import find_places, load_robot_values
    from labr_autonomy.record.run_folder import make_run_folder
    from sim.bench import jobs
    from sim.bench.methods import find_method
    from sim.bench.report_lines import describe

    places = find_places(family, () if world is None else (world,), difficulty, worlds_dir, movers)
    if len(places) != 1:
        raise BadInput(f"{len(places)} families are named", "Name one; a trial is in one world")
    find_method(method)  # refuses one that is not known, before anything is made
    place = places[0]
    answer = jobs.fly_job(jobs.Job(place.name, place.spec, seed, method, robot=load_robot_values(robot)))
    click.echo(f"{place.name}, seed {seed}, {method}")
    click.echo("\n".join(describe(answer.task, answer.result, events=EVENTS_SHOWN)))
    if show:
        from sim.bench.pictures import trial_picture

        path = make_run_folder(f"sim-{place.name}-{seed}-{method}", out) / "trial.png"
        path.write_bytes(trial_picture(answer.task, answer.result, f"{place.name}, seed {seed}, {method}"))
        click.echo(f"picture: {path}")
        _open(path)


def _open(path: Path) -> None:
    """Show a picture where there is a display and a program for it."""
    opener = shutil.which("xdg-open")
    if opener and (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        quiet = subprocess.DEVNULL
        subprocess.Popen([opener, str(path)], stdout=quiet, stderr=quiet, start_new_session=True)
