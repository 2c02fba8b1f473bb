"""`labr-mission doctor`: is everything right for a flight?"""

from __future__ import annotations

import json
from pathlib import Path

import click

from labr_autonomy.doctor.finding import AREAS
from labr_autonomy.errors import BadInput

UNWELL = 1  # exit code when something is wrong


@click.command()
@click.option("--robot", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE", help="robot.yaml.")
@click.option("--air", metavar="URL", help="Where the autopilot is; by default links.air of robot.yaml.")
@click.option("--only", metavar="AREA[,AREA..]", help=f"Look at these only: {', '.join(AREAS)}.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("runs"),
    metavar="DIR",
    help="Where run folders are made (default: runs).",
)
@click.option(
    "--bundle",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE.zip",
    help="Write a report archive to hand on; it holds no secrets and no images.",
)
@click.option("--json", "as_json", is_flag=True, help="JSON on stdout, for machines.")
def doctor(
    robot: Path | None, air: str | None, only: str | None, out: Path, bundle: Path | None, as_json: bool
) -> None:
    """Look at everything that must be right before a flight; nothing moves and nothing is written.

    Each line says good, or what is wrong and what to do about it; a note keeps nobody on the floor. Ends with
    0 when nothing is wrong, else with 1. Not while a flight is running: links have one user.
    """
    areas = _areas(only)
    from labr_autonomy.config import RobotConfig
    from labr_autonomy.doctor.examine import examine
    from labr_autonomy.mission.load import load_robot

    config = RobotConfig() if robot is None else load_robot(robot)
    if air is not None:
        config = config.model_copy(update={"links": config.links.model_copy(update={"air": air})})
    findings = []
    for finding in examine(config, areas, out):
        findings.append(finding)
        if not as_json:
            click.echo(finding.line)
    faults = sum(f.state == "wrong" for f in findings)
    written: list[str] = []
    if bundle is not None:
        from labr_autonomy.doctor.bundle import write_bundle

        written = write_bundle(bundle, findings, config, out)
    if as_json:
        listed = [f.as_dict() for f in findings]
        click.echo(json.dumps({"good": not faults, "faults": faults, "findings": listed, "bundle": written}))
    else:
        click.echo(f"{faults} of {len(findings)} are wrong" if faults else f"all of {len(findings)} are good")
        if bundle is not None:
            click.echo(f"{bundle}: {', '.join(written)}")
    if faults:
        click.get_current_context().exit(UNWELL)


def _areas(only: str | None) -> tuple[str, ...]:
    if only is None:
        return AREAS
    asked = tuple(word.strip() for word in only.split(",") if word.strip())
    unknown = [word for word in asked if word not in AREAS]
    if unknown or not asked:
        named = f"'{unknown[0]}'" if unknown else "nothing"
        raise BadInput(f"--only names {named}", f"Take some of {', '.join(AREAS)}")
    return asked
