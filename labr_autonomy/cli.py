"""`labr-mission`. Only click is imported here; each command imports what it needs when it runs.

Exit codes (`labr_autonomy.errors.ExitCode`): 0 done, 1 a fault in the program, 2 bad input, 3 refused or not
feasible, 4 expectation missed, 5 aborted by the operator, 6 failsafe ended the mission. `doctor` ends with
1 when something is wrong.
"""

from __future__ import annotations

import json
import sys
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labr_autonomy import __version__
from labr_autonomy.commands import operate
from labr_autonomy.commands.bench import bench, difficulty_option, movers_option
from labr_autonomy.commands.dataset import dataset
from labr_autonomy.commands.doctor import doctor
from labr_autonomy.commands.energy import energy
from labr_autonomy.commands.params import params
from labr_autonomy.commands.train import train
from labr_autonomy.commands.wheels import wheels
from labr_autonomy.errors import BadInput, ExitCode, LabrError

if TYPE_CHECKING:
    from labr_autonomy.config import RobotConfig
    from labr_autonomy.mission.check import ClearanceAt
    from labr_autonomy.mission.schema import Mission

STANDING_M = 0.05  # lower than this above its driving height, the robot stands
FAULT = 1  # exit code of an error in the program itself

_file = click.Path(path_type=Path, dir_okay=False)
_folder = click.Path(path_type=Path, file_okay=False)
_mission = click.argument("mission", type=_file)
_seed = click.option(
    "--seed", type=click.IntRange(0, 2**31 - 1), help="Seed of the simulated world and its noise."
)
_worlds = click.option("--worlds", type=_folder, metavar="DIR", help="Folder with mesh worlds.")
_out = click.option("--out", type=_folder, metavar="DIR", help="Where run folders are made (default: runs).")
_json = click.option("--json", "as_json", is_flag=True, help="JSON on stdout, for machines.")
_robot = click.option(
    "--robot", type=_file, metavar="FILE", help="robot.yaml; without it the simulator is flown."
)
_robot_body = click.option(
    "--robot", type=_file, metavar="FILE", help="robot.yaml with other masses and limits."
)
_ground = click.option(
    "--ground",
    type=click.Choice(["twin", "qemu"]),
    default="twin",
    help="Land controller of the simulator: its twin in Python, or the STM32's firmware in QEMU.",
)


class Commands(click.Group):
    """Turns every error into one sentence and an exit code."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command; nobody reads a traceback."""
        as_json = "--json" in ctx.args  # read now: click empties the list
        try:
            return super().invoke(ctx)
        except click.UsageError as error:
            if not as_json:
                raise
            _complain(True, {"kind": "BadInput", "what": error.format_message()}, "")
            ctx.exit(int(ExitCode.BAD_INPUT))
        except (click.exceptions.Exit, click.ClickException, click.Abort):
            raise
        except LabrError as error:
            _complain(as_json, _as_dict(error), str(error))
            ctx.exit(int(error.exit_code))
        except KeyboardInterrupt:
            _complain(
                as_json, {"kind": "Aborted", "what": "stopped by the operator"}, "stopped by the operator"
            )
            ctx.exit(int(ExitCode.ABORTED))
        except BrokenPipeError:  # `| head` has gone; click ends quietly
            raise
        except Exception as error:  # noqa: BLE001 - the last line of defence: keep it, and say where it is
            where = _keep_traceback()
            what = f"internal error, {type(error).__name__}: {_first_line(error)}"
            answer = {"kind": "Internal", "what": what, "traceback": str(where)}
            _complain(as_json, answer, f"{what}. Details are in {where}.")
            ctx.exit(FAULT)


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="labr-mission")
def main() -> None:
    """Fly, check and look at missions of the land-air robot LABR."""


@main.command()
@_mission
@_robot
@_seed
@_worlds
@_out
@_json
@_ground
@click.option("--quiet", is_flag=True, help="No live line.")
@click.option("--console", is_flag=True, help="Serve the operator's page, and wait for start on it.")
@operate.served
@click.option("--world", metavar="W", help="Another world: a family, a world file or a mesh.")
@click.option(
    "--air", metavar="URL", help="Fly an autopilot that is running there, e.g. udpin://127.0.0.1:14540."
)
@click.option(
    "--truth",
    metavar="URL",
    help="Where its simulator publishes its truth, if not there, e.g. udpin://127.0.0.1:19410.",
)
@click.option(
    "--watch", metavar="URL", help="Show the air link to a ground station, e.g. udp://127.0.0.1:14550."
)
@click.option("--watch-commands", is_flag=True, help="Let that ground station send as well.")
def fly(
    mission: Path,
    robot: Path | None,
    seed: int | None,
    worlds: Path | None,
    out: Path | None,
    as_json: bool,
    ground: str,
    quiet: bool,
    console: bool,
    host: str,
    port: int,
    token_file: Path | None,
    world: str | None,
    air: str | None,
    truth: str | None,
    watch: str | None,
    watch_commands: bool,
) -> None:
    """Carry out MISSION; without --robot in the simulator.

    With --air the simulator supplies world, camera, wheels and VIO, and a PX4 or ArduPilot that you have
    started (SITL with its own physics, in real time) flies.

    Ctrl-C once holds the robot where it is, twice brings it down and stops.
    """
    _must_exist(mission)
    if robot is not None and ground != "twin":
        raise BadInput("--ground is of the simulator", "Leave it out, or leave --robot out")
    if robot is not None and (air is not None or world is not None):
        raise BadInput("--air and --world are for the simulator", "Put links.air into robot.yaml instead")
    if truth is not None and air is None:
        raise BadInput("--truth goes with --air", "Name the autopilot by --air")
    if watch_commands and watch is None:
        raise BadInput("--watch-commands goes with --watch", "Name the ground station by --watch")
    from labr_autonomy.air.watch import WatchAt
    from labr_autonomy.commands.elsewhere import in_world
    from labr_autonomy.mission.executive import fly as carry_out
    from labr_autonomy.mission.simulator import External

    code = carry_out(
        mission,
        robot_path=robot,
        seed=seed,
        worlds_dir=worlds,
        out_dir=out,
        json_output=as_json,
        quiet=quiet,
        ground=ground,
        console=operate.console_options(host, port, token_file) if console else None,
        external=None if air is None else External(air, truth),
        relocate=None if world is None else lambda known: in_world(known, world, worlds),
        watch=None if watch is None else WatchAt.parse(watch, may_speak=watch_commands),
    )
    click.get_current_context().exit(int(code))


@main.command()
@click.argument("mission", type=_file, required=False)
@_robot
@_seed
@_worlds
@_json
@click.option("--schema", is_flag=True, help="Print the JSON Schema of the mission file and stop.")
def check(
    mission: Path | None,
    robot: Path | None,
    seed: int | None,
    worlds: Path | None,
    as_json: bool,
    schema: bool,
) -> None:
    """Look for errors in MISSION without moving anything.

    Reports everything wrong in the file at once, then what makes the mission not feasible: goals outside
    fences, above the ceiling, or, in a simulated world, in or too near obstacles.
    """
    if schema:
        from labr_autonomy.mission.schema import json_schema

        click.echo(json.dumps(json_schema(), indent=2))
        return
    if mission is None:
        raise BadInput("no mission file is named", "Say labr-mission check MISSION.yaml, or --schema")
    from labr_autonomy.config import RobotConfig
    from labr_autonomy.mission.check import check_mission, refuse
    from labr_autonomy.mission.load import load_mission, load_robot

    loaded = load_mission(mission)
    vehicle = RobotConfig() if robot is None else load_robot(robot)
    free = world_clearance(loaded, vehicle, seed=seed, worlds_dir=worlds) if robot is None else None
    findings = check_mission(loaded, vehicle, clearance_at=free)
    if as_json:
        listed = [{"code": f.code, "item": f.item, "sentence": f.sentence} for f in findings]
        answer = {"file": str(mission), "feasible": not findings, "findings": listed}
        click.echo(json.dumps(answer))
        if findings:
            click.get_current_context().exit(int(ExitCode.REFUSED))
        return
    refuse(findings)
    probed = "" if free is None else ", all goals are free in the simulated world"
    click.echo(f"{mission}: good, {len(loaded.items)} items{probed}")


@main.command()
@click.argument("mission", type=_file, required=False)
@_robot_body
@_seed
@_worlds
@_out
@_ground
@click.option("--family", metavar="F", help="A family of worlds: fly one trial of the benchmark in it.")
@click.option("--world", type=_file, metavar="FILE.yaml", help="A mesh world: fly one trial in it.")
@click.option(
    "--method",
    metavar="M",
    help="Of the trial: two-stage (default), iplanner, mapping, oracle, network, network@DIR.",
)
@difficulty_option
@movers_option
@click.option("--show", is_flag=True, help="Draw the trial, and open the picture where there is a display.")
def sim(
    mission: Path | None,
    robot: Path | None,
    seed: int | None,
    worlds: Path | None,
    out: Path | None,
    ground: str,
    family: str | None,
    world: Path | None,
    method: str | None,
    difficulty: float | None,
    movers: int,
    show: bool,
) -> None:
    """Run the simulator of MISSION alone, or fly one trial of the benchmark again.

    With MISSION it prints where its robot.yaml is, and Ctrl-C ends it; fly on it from another terminal with:
    labr-mission fly MISSION --robot .../robot.yaml

    With --family or --world it draws the trial of --seed, flies it in lock-step and tells how it went.
    """
    if sum(given is not None for given in (mission, family, world)) != 1:
        raise BadInput("sim takes one of MISSION, --family and --world", "Name exactly one of them")
    if mission is None:
        if ground != "twin":
            raise BadInput("--ground is of a MISSION; a trial is flown in lock-step", "Leave it out")
        from labr_autonomy.commands.replay import replay

        replay(
            family=family,
            world=world,
            worlds_dir=worlds,
            seed=seed or 0,
            method=method or "two-stage",
            difficulty=difficulty,
            movers=movers,
            robot=robot,
            out=out,
            show=show,
        )
        return
    if method is not None or difficulty is not None or movers or show:
        raise BadInput(
            "--method, --difficulty, --movers and --show are of a trial", "Name its --family or --world"
        )
    _serve_simulator(mission, robot, seed, worlds, out, ground)


def _serve_simulator(
    mission: Path,
    robot: Path | None,
    seed: int | None,
    worlds: Path | None,
    out: Path | None,
    ground: str,
) -> None:
    from labr_autonomy.config import RobotConfig
    from labr_autonomy.mission.load import load_mission, load_robot
    from labr_autonomy.mission.simulator import simulator_spec
    from labr_autonomy.record.run_folder import make_run_folder

    loaded = load_mission(mission)
    vehicle = RobotConfig() if robot is None else load_robot(robot)
    used_seed = seed if seed is not None else loaded.sim.seed if loaded.sim else 0
    spec = simulator_spec(loaded, vehicle, used_seed, worlds, die_with_parent=False, ground=ground)
    folder = make_run_folder(f"sim-{loaded.name}", out)
    spec_path = folder / "simulator.json"
    spec_path.write_text(json.dumps(spec, indent=1), encoding="utf-8")
    from sim import server

    try:
        code = server.main(["--spec", str(spec_path), "--out", str(folder)])
    except KeyboardInterrupt:
        code = 0  # the usual way to end it
    click.get_current_context().exit(code)


main.add_command(operate.console)
main.add_command(operate.replay)
main.add_command(bench)
main.add_command(dataset)
main.add_command(doctor)
main.add_command(energy)
main.add_command(params)
main.add_command(train)
main.add_command(wheels)


@main.command()
@click.argument("run", type=_folder)
@_json
def report(run: Path, as_json: bool) -> None:
    """Write report.html into the folder of a RUN."""
    from labr_autonomy.record.report import write_report

    path = write_report(run)
    click.echo(json.dumps({"report": str(path)}) if as_json else path)


def world_clearance(
    mission: Mission, robot: RobotConfig, *, seed: int | None, worlds_dir: Path | None
) -> ClearanceAt | None:
    """Free distance around the robot in the mission's simulated world; None when it names no world.

    Args:
        mission: With its `sim` block.
        robot: Its outline counts.
        seed: Wins over the mission's.
        worlds_dir: Folder with mesh worlds.
    """
    if mission.sim is None:
        return None
    import numpy as np

    from labr_autonomy.mission.check import clear_places
    from sim.worlds.build import build_world
    from sim.worlds.surface import Surface

    world = build_world(
        mission.sim.world.spec(),
        seed=mission.sim.seed if seed is None else seed,
        clear_m=clear_places(mission, robot),
        worlds_dir=worlds_dir,
    )
    surface = Surface(world, robot.body)

    def clearance_at(x_m: float, y_m: float, z_m: float) -> float:
        standing = z_m - surface.floor_below(x_m, y_m, z_m) - robot.body.below_m < STANDING_M
        return surface.free_place(np.array([x_m, y_m, z_m]), on_floor=standing)

    return clearance_at


def _must_exist(path: Path) -> None:
    """Say so before heavy imports when a file is not there."""
    if not path.is_file():
        raise BadInput(f"{path} is not there", "Check the path of the mission file")


def _as_dict(error: LabrError) -> dict[str, Any]:
    answer: dict[str, Any] = {"kind": type(error).__name__, "what": error.what, "do": error.do}
    listed = getattr(error, "as_list", None)
    if listed is not None:
        answer["problems"] = listed()
    return {**answer, "exit_code": int(error.exit_code)}


def _complain(as_json: bool, answer: dict[str, Any], sentence: str) -> None:
    """Errors go to stderr as a sentence, or to stdout as an object for machines."""
    if as_json:
        click.echo(json.dumps({"error": answer}))
    else:
        click.echo(sentence if "\n" in sentence else f"labr-mission: {sentence}", err=True)


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0].rstrip(".") if lines else "no message"


def _keep_traceback() -> Path:
    """Write the traceback of the error being handled to a file of its own."""
    import tempfile

    with tempfile.NamedTemporaryFile(
        "w", prefix="labr-mission-", suffix=".txt", delete=False, encoding="utf-8"
    ) as stream:
        stream.write(f"labr-mission {__version__}: {' '.join(sys.argv[1:])}\n")
        traceback.print_exc(file=stream)
    return Path(stream.name)
