"""`labr-mission dataset`: training data for GKPN in a folder."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import click

from labr_autonomy.commands.bench import world_option, worlds_dir_option
from labr_autonomy.commands.checks import json_option
from labr_autonomy.errors import BadInput

FAMILIES = "indoor,rooms,garage,forest"
SEED = 1_000_000
BENCH_SEEDS = 100_000  # smaller ones are the benchmark's
SEED_MAX = 2**31 - 1

_folder = click.Path(path_type=Path, file_okay=False)


@click.command()
@click.argument("folder", type=_folder)
@click.option("--family", metavar="F[,F..]", help=f"Generated worlds (default: {FAMILIES}); also hall.")
@world_option
@worlds_dir_option
@click.option("--scenes", type=click.IntRange(1, 1_000_000), default=100, metavar="N", help="In all.")
@click.option("--views", type=click.IntRange(1, 10_000), default=96, metavar="V", help="Of each scene.")
@click.option("--goals", type=click.IntRange(1, 1000), default=8, metavar="K", help="Of each view.")
@click.option(
    "--size",
    type=(click.IntRange(8, 4096), click.IntRange(8, 4096)),
    default=(160, 90),
    metavar="W H",
    help="Of the network's image [px].",
)
@click.option(
    "--seed",
    type=click.IntRange(0, SEED_MAX),
    default=SEED,
    metavar="S",
    help=f"Of the first scene (default: {SEED}).",
)
@click.option("--any-seed", is_flag=True, help=f"Allow seeds below {BENCH_SEEDS}, which the benchmark flies.")
@click.option("--jobs", type=click.IntRange(1, 1024), metavar="J", help="Scenes at once (default: cores).")
@click.option(
    "--from-iplanner",
    "recordings",
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    metavar="DIR",
    help="Convert recordings in iPlanner's own layout instead.",
)
@json_option
@click.option("--quiet", is_flag=True, help="No live line.")
def dataset(
    folder: Path,
    family: str | None,
    worlds: tuple[Path, ...],
    worlds_dir: Path | None,
    scenes: int,
    views: int,
    goals: int,
    size: tuple[int, int],
    seed: int,
    any_seed: bool,
    jobs: int | None,
    recordings: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Make training data for GKPN in FOLDER, one file a scene.

    The robot walks and flies through generated worlds; each view has what the camera saw, what the robot's
    map knew, goals on land and in the air, and the truth around. Scene i has seed S + i, and everything in it
    follows from that. Ctrl-C leaves whole files only, and the same command goes on.
    """
    from labr_autonomy.commands.progress import show_steps
    from sim.training_data.build import SceneConfig
    from sim.training_data.folder import ShardJob, fill, scene_jobs
    from sim.training_data.iplanner_folder import recording_jobs

    config = SceneConfig(views, goals, *size)
    pieces: list[ShardJob] = []
    if recordings is not None:
        if family is not None or worlds:
            raise BadInput("--from-iplanner is given with other worlds", "Give one or the other.")
        found, settings = recording_jobs(recordings, config)
        pieces += found
    else:
        places = find_worlds(family, worlds, worlds_dir)
        generated = any("family" in spec for spec in places.values())
        check_seeds(seed, scenes, any_seed=any_seed or not generated)
        made, settings = scene_jobs(places, seed, scenes, config)
        pieces += made
    processes = jobs or len(os.sched_getaffinity(0))
    with show_steps(len(pieces), "scenes", quiet=as_json or quiet) as on_scene:
        filled = fill(folder, settings, pieces, processes, on_scene)
    counts, skipped = filled.manifest["counts"], filled.manifest["skipped"]
    if as_json:
        answer = {
            key: filled.manifest[key] for key in ("settings", "families", "counts", "sha256", "skipped")
        }
        click.echo(json.dumps({"folder": str(folder), "made": filled.made, "kept": filled.kept, **answer}))
        return
    click.echo(
        f"{folder}: {counts['scenes']} scenes ({filled.made} made, {filled.kept} kept), "
        f"{counts['views']} views, {counts['goals']} goals, "
        f"{100.0 * counts['hard_share']:.0f} % of them behind something, "
        f"{100.0 * counts['air_share']:.0f} % in the air"
    )
    if skipped:
        click.echo(f"{len(skipped)} scenes gave nothing, first {skipped[0]['file']}: {skipped[0]['why']}")


def find_worlds(
    family: str | None, worlds: tuple[Path, ...], worlds_dir: Path | None
) -> dict[str, dict[str, Any]]:
    """Worlds by name, as `build_world` takes them."""
    from sim.bench.settings import world_place
    from sim.worlds.families.draw import SIZES

    said = FAMILIES if family is None and not worlds else family or ""
    names = [name.strip() for name in said.split(",") if name.strip()]
    known = [*SIZES, "hall"]
    unknown = [name for name in names if name not in known]
    if unknown:
        raise BadInput(f"there is no world family '{unknown[0]}'", f"Take {', '.join(known)}.")
    places: dict[str, dict[str, Any]] = {name: {"family": name} for name in names}
    for path in worlds:
        place = world_place(path, worlds_dir)
        if place.name in places:
            raise BadInput(f"two worlds are called '{place.name}'", "Give one another `name` in its file.")
        places[place.name] = place.spec
    if not places:
        raise BadInput("no world is named", f"Say --family {FAMILIES}, or --world FILE.yaml.")
    return places


def check_seeds(seed: int, scenes: int, *, any_seed: bool) -> None:
    """Training worlds must never be those of the benchmark."""
    if seed < BENCH_SEEDS and not any_seed:
        raise BadInput(
            f"the seed {seed} is one of the benchmark's worlds",
            f"Take one from {BENCH_SEEDS} on, or add --any-seed.",
        )
    if seed + scenes - 1 > SEED_MAX:
        raise BadInput(f"the last scene's seed is above {SEED_MAX}", "Take a smaller --seed.")
