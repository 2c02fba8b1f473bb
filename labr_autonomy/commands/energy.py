"""`labr-mission energy`: the energy settings that recorded flights speak for."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labr_autonomy.errors import BadInput

if TYPE_CHECKING:
    from labr_autonomy.config import RobotConfig
    from labr_autonomy.modes.energy_fit import EnergyFit, Figure
    from labr_autonomy.record.power import PowerLog

DISAGREE = 0.05  # channels that differ by more are not calibrated
_FIELDS = ("idle_w", "land_w", "air_w", "transition_s")
_UNITS = {"idle_w": "W", "land_w": "W", "air_w": "W", "transition_s": "s", "transition_j": "J"}
_WORDS = {
    "idle_w": "samples at rest",
    "land_w": "samples on wheels",
    "air_w": "samples in the air",
    "transition_s": "take-offs and landings",
}


@click.command()
@click.argument("runs", nargs=-1, metavar="RUN...", type=click.Path(path_type=Path, file_okay=False))
@click.option(
    "--robot",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="robot.yaml to compare with (default: the first run's own).",
)
@click.option("--json", "as_json", is_flag=True, help="JSON on stdout, for machines.")
def energy(runs: tuple[Path, ...], robot: Path | None, as_json: bool) -> None:
    """Fit P_land, P_air and the transition from the battery telemetry of recorded flights.

    Each RUN is a run folder; several are fitted together. Prints the figures with their standard errors, how
    far the present settings lie off, and an `energy:` block for robot.yaml.
    """
    from labr_autonomy.modes.energy_fit import fit_energy
    from labr_autonomy.record.power import read_power

    if not runs:
        raise BadInput("no run is named", "Say labr-mission energy RUN, a folder that a flight left behind")
    present = _robot(runs[0], robot)
    logs = [read_power(run, present.body.track_m) for run in runs]
    fit = fit_energy(
        [log.samples for log in logs], land_speed_mps=present.land.speed_mps, mass_kg=present.body.mass_kg
    )
    if as_json:
        click.echo(json.dumps(_answer(runs, logs, fit, present)))
        return
    click.echo("\n".join([*_lines(fit, present), *_remarks(logs, fit), "", _block(fit, present)]))


def _robot(run: Path, robot: Path | None) -> RobotConfig:
    """The settings to compare with."""
    from labr_autonomy.config import RobotConfig
    from labr_autonomy.mission.load import load_robot

    if robot is not None:
        return load_robot(robot)
    own = run / "robot.yaml"
    return load_robot(own) if own.is_file() else RobotConfig()


def _figures(fit: EnergyFit) -> Mapping[str, Figure | None]:
    return {name: getattr(fit, name) for name in _FIELDS}


def _lines(fit: EnergyFit, present: RobotConfig) -> list[str]:
    lines = []
    for name, figure in _figures(fit).items():
        now = float(getattr(present.energy, name))
        if figure is None:
            lines.append(f"{name:13s} not in these flights: too few {_WORDS[name]}; stays {now:g}")
            continue
        error = "error unknown (only one)" if figure.error is None else f"+- {figure.error:.2g}"
        off = 100.0 * (figure.value - now) / now
        lines.append(
            f"{name:13s} {figure.value:8.2f} {error} {_UNITS[name]}   now {now:g}: {off:+.1f} %   "
            f"({figure.samples} {_WORDS[name]})"
        )
    return lines


def _remarks(logs: Sequence[PowerLog], fit: EnergyFit) -> list[str]:
    said = []
    if fit.land_w is not None:
        said.append(
            f"land_w is the power at {fit.land_speed_mps:g} m/s, the speed that the planner reckons with"
        )
    if fit.rolled_mps is not None and not fit.rolled_mps[0] <= fit.land_speed_mps <= 1.1 * fit.rolled_mps[1]:
        low, high = fit.rolled_mps
        said.append(f"  but these flights drove at {low:.2f} to {high:.2f} m/s: drive at that speed as well")
    if fit.transition_j is not None:
        error = "" if fit.transition_j.error is None else f" +- {fit.transition_j.error:.2g}"
        said.append(
            f"one take-off and landing take {fit.transition_j.value:.0f}{error} J without the height gained"
        )
    for log in logs:
        by = 0.0 if log.other_over_used is None else log.other_over_used - 1.0
        if abs(by) > DISAGREE:
            said.append(f"the two channels disagree: the other measured {100.0 * by:+.0f} % against the")
            said[-1] += f" {log.channel} channel, which is used; calibrate their current sensors"
    return said


def _block(fit: EnergyFit, present: RobotConfig) -> str:
    """The whole `energy:` block with what was fitted."""
    values = present.energy.model_dump(mode="json")
    fitted = {name: f for name, f in _figures(fit).items() if f is not None}
    lines = ["energy:"]
    for name, now in values.items():
        if name in fitted:
            error = fitted[name].error
            known = "one hand-over" if error is None else f"+- {error:.2g}"
            lines.append(f"  {name}: {fitted[name].value:.4g}  # {known}, fitted from telemetry")
        else:
            lines.append(f"  {name}: {now:g}")
    return "\n".join(lines)


def _answer(
    runs: Sequence[Path], logs: Sequence[PowerLog], fit: EnergyFit, present: RobotConfig
) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, figure in {**_figures(fit), "transition_j": fit.transition_j}.items():
        now = getattr(present.energy, name, None)
        found[name] = None
        if figure is not None:
            found[name] = {
                "value": figure.value,
                "error": figure.error,
                "samples": figure.samples,
                "unit": _UNITS[name],
                "present": now,
                "off_pct": None if now is None else 100.0 * (figure.value - now) / now,
            }
    return {
        "runs": [str(run) for run in runs],
        "channels": [log.channel for log in logs],
        "other_channel_over_used": [log.other_over_used for log in logs],
        "land_speed_mps": fit.land_speed_mps,
        "rolled_mps": fit.rolled_mps,
        "fit": found,
        "robot_yaml": _block(fit, present),
    }
