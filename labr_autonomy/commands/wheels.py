"""`labr-mission wheels`: look at the land controller and turn its wheels slowly, in the workshop."""

from __future__ import annotations

import asyncio
import contextlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from labr_autonomy.errors import BadInput, LinkError, Refused

if TYPE_CHECKING:
    from labr_autonomy.config import RobotConfig
    from labr_autonomy.ground.channel import GroundChannel

SPEED_MAX_MPS = 0.3
TURN_MAX_RPS = 1.0
SECONDS_MAX = 30.0
PERIOD_S = 0.02
SHOW_S = 0.25
STOP_S = 0.5  # after the last command the wheels are watched this long


@click.command()
@click.option(
    "--robot",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    metavar="FILE",
    help="robot.yaml; links.ground is used.",
)
@click.option("--seconds", type=click.FloatRange(0.5, SECONDS_MAX), default=5.0)
@click.option(
    "--turn",
    metavar="V,W",
    help=f"Drive at V m/s and W rad/s, at most {SPEED_MAX_MPS:g} and {TURN_MAX_RPS:g}; else only look.",
)
@click.option("--in-the-air", is_flag=True, help="Say that the wheels touch nothing; --turn wants it.")
@click.option("--release-estop", is_flag=True, help="First end an emergency stop; its button must be out.")
@click.option("--json", "as_json", is_flag=True, help="JSON on stdout, for machines.")
def wheels(
    robot: Path, seconds: float, turn: str | None, in_the_air: bool, release_estop: bool, as_json: bool
) -> None:
    """Look at the land controller's pins and encoders, and turn the wheels slowly. For the workshop.

    Prints who answers and its parameters, then four lines a second of what it measures. Ctrl-C stops the
    wheels at once, as does pulling the cable.
    """
    from labr_autonomy.mission.load import load_robot

    asked = None
    if turn is not None:
        asked = _speeds(turn)
        if not in_the_air:
            raise BadInput("--turn moves the wheels", "Lift the robot off the ground and say --in-the-air")
    summary = asyncio.run(
        _session(load_robot(robot), seconds, asked, release_estop=release_estop, quiet=as_json)
    )
    if as_json:
        click.echo(json.dumps(summary))


def _speeds(turn: str) -> tuple[float, float]:
    try:
        v, w = (float(word) for word in turn.split(","))
    except ValueError:
        raise BadInput(f"--turn {turn} is no pair of numbers", "Say for instance --turn 0.1,0") from None
    if not (abs(v) <= SPEED_MAX_MPS and abs(w) <= TURN_MAX_RPS):
        raise BadInput(
            f"--turn {turn} is too fast for the workshop",
            f"Take at most {SPEED_MAX_MPS:g} m/s and {TURN_MAX_RPS:g} rad/s",
        )
    return v, w


async def _session(
    config: RobotConfig,
    seconds: float,
    asked: tuple[float, float] | None,
    *,
    release_estop: bool,
    quiet: bool,
) -> dict[str, Any]:
    from labr_autonomy.clock import SystemClock
    from labr_autonomy.ground.channel import GroundChannel

    clock = SystemClock()
    channel = GroundChannel(config.links.ground, config.links.ground_baud, config, clock)
    identity = await channel.open()
    task = asyncio.create_task(channel.run(), name="ground")
    try:
        parameters = await channel.read_parameters()
        if not quiet:
            who = f"land controller {identity.serial}, firmware {identity.firmware}"
            click.echo(f"{who}, boot {identity.boot_count}")
            click.echo("  ".join(f"{name} {value:g}" for name, value in parameters.items()))
        if release_estop:
            await channel.release_estop()
        before = _measured(channel)
        await _look(channel, seconds, asked, quiet=quiet)
        after = _measured(channel)
    finally:
        channel.stop()
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task
        await channel.close()
    counted = {
        side: (after[f"ticks_{side}"] - before[f"ticks_{side}"]) / parameters["ticks_per_m"]
        for side in ("left", "right")
    }
    if not quiet:
        click.echo(f"turned: left {counted['left']:+.3f} m, right {counted['right']:+.3f} m")
    return {"identity": identity.serial, "firmware": identity.firmware, "turned_m": counted, "last": after}


async def _look(
    channel: GroundChannel, seconds: float, asked: tuple[float, float] | None, *, quiet: bool
) -> None:
    """Show what is measured, and keep the wheels turning if that was asked."""
    from labr_autonomy.clock import SystemClock, Ticker

    clock = SystemClock()
    ticker, begun_s, shown_s = Ticker(clock, PERIOD_S), clock.now_s(), -SHOW_S
    channel.stop()  # engaging is deliberate: a disengaged command comes first
    while (done_s := clock.now_s() - begun_s) < seconds + STOP_S:
        await ticker.wait()
        if asked is not None and done_s < seconds:
            channel.send_velocity(*asked, engaged=True, air_lock=False)
        else:
            channel.stop()
        if done_s - shown_s >= SHOW_S and not quiet:
            shown_s = done_s
            click.echo(_line(channel))
        if asked is not None and 0.5 < done_s < seconds and not channel.state.engaged:
            why = ", ".join(channel.state.faults) or "it did not engage"
            raise Refused(f"the wheels do not turn: {why}", "See Bring-up in firmware_bridge/README.md")


def _measured(channel: GroundChannel) -> dict[str, Any]:
    """The newest telemetry by name; the raw values, with their units as on the wire.

    Raises:
        LinkError: The link is lost and has not come back.
    """
    if channel.telemetry is None:
        why = ", ".join(channel.state.faults)
        raise LinkError(f"The land controller was lost: {why}", "Check its cable and power.")
    return dict(channel.telemetry.message.to_dict())


def _line(channel: GroundChannel) -> str:
    state = channel.state
    faults = ", ".join(state.faults) or "no fault"
    if channel.telemetry is None:  # it is looked for again meanwhile
        return f"{'lost':14s} {faults}"
    m = _measured(channel)
    return (
        f"{state.mode:14s} ticks {m['ticks_left']:7d} {m['ticks_right']:7d}   "
        f"{state.speed_mps:+.2f} m/s {state.yaw_rate_rps:+.2f} rad/s   "
        f"duty {m['duty_left'] / 10:+4.0f} {m['duty_right'] / 10:+4.0f} %   "
        f"{m['current_left'] / 1000:+5.1f} {m['current_right'] / 1000:+5.1f} A   "
        f"{state.battery_v:.1f} V   {'load' if state.wheel_load else 'no load'}   {faults}"
    )
