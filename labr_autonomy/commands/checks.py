"""`labr-mission bench crosscheck` and `bench camera`: how far the benchmark itself can be trusted."""

from __future__ import annotations

import itertools
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from labr_autonomy.errors import ExitCode

out_option = click.option(
    "--out", type=click.Path(path_type=Path, file_okay=False), metavar="DIR", help="Run folder."
)
json_option = click.option("--json", "as_json", is_flag=True, help="JSON on stdout, for machines.")


@click.command()
@click.option("--family", default="indoor", metavar="F[,F..]|all", help="indoor, rooms, garage, forest.")
@click.option(
    "--trials",
    type=click.IntRange(1, 1000),
    default=10,
    metavar="N",
    help="In all; those not reached in lock-step are passed over.",
)
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), default=0, help="Of the first trial.")
@out_option
@json_option
def crosscheck(family: str, trials: int, seed: int, out: Path | None, as_json: bool) -> None:
    """Fly trials in lock-step and over the real links, and compare.

    Each trial is flown by `two-stage` twice: on the simulated clock, and in real time in the full simulator
    over MAVLink, serial and shared memory, which wants an otherwise idle machine. Path, time and joules of
    the trials reached both ways must agree within 10 % in the median; otherwise the command ends with 4.
    """
    from labr_autonomy.commands.bench import find_places
    from labr_autonomy.config import RobotConfig
    from labr_autonomy.record.run_folder import make_run_folder
    from sim.bench.crosscheck import agreement, cross_check
    from sim.bench.tasks import sample_task

    folder = out or make_run_folder("bench-crosscheck")
    folder.mkdir(parents=True, exist_ok=True)
    robot = RobotConfig()
    places = find_places(family, (), None, None)
    tasks = (sample_task(places[k % len(places)].spec, seed + k, robot) for k in itertools.count())
    pairs = []
    for pair in itertools.islice(cross_check(tasks, robot, folder), trials):
        pairs.append(pair)
        both = " / ".join(pair.outcome)
        figures = ", ".join(
            f"{name} {a:.1f} / {b:.1f}"
            for name, (a, b) in (("m", pair.path_m), ("s", pair.time_s), ("J", pair.energy_j))
        )
        click.echo(f"{len(pairs)}/{trials}  {pair.family} {pair.seed}: {both}; {figures}", err=True)
    answer: dict[str, Any] = {
        "command": f"labr-mission bench crosscheck --family {family} --trials {trials} --seed {seed}"
    }
    answer |= {"rows": [asdict(pair) for pair in pairs], **agreement(pairs)}
    (folder / "crosscheck.json").write_text(json.dumps(answer, indent=1) + "\n")
    if as_json:
        click.echo(json.dumps(answer))
    else:
        click.echo(f"{answer['trials_reached_both_ways']} of {trials} trials reached both ways")
        for name in ("path_m", "time_s", "energy_j"):
            found = answer[name]
            click.echo(
                f"  {name:9s} lock-step {found['lockstep']:8.1f}   full {found['full']:8.1f}   "
                f"difference of means {100.0 * found['difference_of_means']:.1f} %, "
                f"median {100.0 * found['median_difference']:.1f} %, "
                f"worst {100.0 * found['worst_difference']:.1f} %"
            )
    if not answer["agrees"]:
        click.get_current_context().exit(int(ExitCode.EXPECTATION_MISSED))


@click.command()
@click.option("--frames", type=click.IntRange(10, 10_000), default=120, help="Pictures in each world.")
@click.option("--renderer", type=click.Choice(["auto", "gl", "rays"]), default="auto")
@json_option
def camera(frames: int, renderer: str, as_json: bool) -> None:
    """How quickly the depth camera takes its pictures, flaws included, in a world of each kind."""
    from labr_autonomy.commands.bench import find_places
    from sim.bench.camera_rate import camera_rate
    from sim.worlds.build import build_world

    places = find_places("all", (Path("workshop.yaml"),), None, None)
    rows = []
    for place in places:
        world = build_world(place.spec, seed=0)
        rows += camera_rate({place.name: world}, renderer=renderer, frames=frames)
        if not as_json:
            row = rows[-1]
            click.echo(
                f"{row['world']:10s} {row['triangles']:7d} triangles   p50 {row['frame_p50_ms']:5.1f} ms   "
                f"p99 {row['frame_p99_ms']:5.1f} ms   {row['rate_hz']:4.0f} Hz   {row['renderer']}"
            )
    if as_json:
        click.echo(json.dumps({"command": "labr-mission bench camera", "rows": rows}))
