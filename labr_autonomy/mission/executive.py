"""`labr-mission fly`: from a mission file to a run folder and an exit code."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from labr_autonomy.air.channel import AirChannel
from labr_autonomy.air.watch import WatchAt
from labr_autonomy.clock import SystemClock
from labr_autonomy.config import RobotConfig
from labr_autonomy.console.live import LiveLine
from labr_autonomy.console.process import ConsoleOptions, ConsoleProcess
from labr_autonomy.errors import ExitCode, LabrError
from labr_autonomy.ground.channel import GroundChannel
from labr_autonomy.guard.failsafe import Reaction
from labr_autonomy.mission import summarise
from labr_autonomy.mission.check import check_mission, height_max_m, refuse
from labr_autonomy.mission.compile import compile_fences, compile_steps
from labr_autonomy.mission.flight import Flight
from labr_autonomy.mission.load import load_mission, load_robot
from labr_autonomy.mission.pilot import Pilot
from labr_autonomy.mission.portrait import facts_of
from labr_autonomy.mission.recorded import RecordedPilot
from labr_autonomy.mission.schema import Mission
from labr_autonomy.mission.simulator import External, SimulatorProcess
from labr_autonomy.mission.steps import Status
from labr_autonomy.processes import keep_cores, on_time
from labr_autonomy.record.flight_log import FlightLog
from labr_autonomy.record.report import write_report
from labr_autonomy.record.run_data import LATENCIES
from labr_autonomy.record.run_folder import make_run_folder
from labr_autonomy.record.summary import Outcome, Summary, write_summary
from labr_autonomy.record.tlog import Tlog

log = logging.getLogger("labr.executive")

EXIT_CODES: dict[Outcome, ExitCode] = {
    "success": ExitCode.DONE,
    "refused": ExitCode.REFUSED,
    "aborted": ExitCode.ABORTED,
    "failsafe": ExitCode.FAILSAFE,
    "failed": ExitCode.EXPECTATION_MISSED,
}


@dataclass(frozen=True, slots=True)
class Simulated:
    """What a simulated flight is drawn from."""

    seed: int
    worlds_dir: Path | None
    external: External | None
    ground: str  # land controller: "twin" or "qemu"


@dataclass(frozen=True, slots=True)
class Ended:
    """How a flight ended."""

    outcome: Outcome
    reason: str


def fly(
    mission_path: Path,
    *,
    robot_path: Path | None,
    seed: int | None,
    worlds_dir: Path | None,
    out_dir: Path | None,
    json_output: bool,
    quiet: bool,
    console: ConsoleOptions | None = None,
    external: External | None = None,
    relocate: Callable[[Mission], Mission] | None = None,
    watch: WatchAt | None = None,
    ground: str = "twin",
) -> int:
    """Carry out a mission and leave a run folder.

    Args:
        mission_path: The mission file.
        robot_path: `robot.yaml` of the robot to fly; None flies the simulator of the mission's `sim` block.
        seed: Of the simulated world and its noise; wins over the mission's.
        worlds_dir: Folder with mesh worlds.
        out_dir: Where run folders are made.
        json_output: Print summary.json to standard output at the end.
        quiet: No live line.
        console: Where the operator's page is served; with it the mission waits for start.
        external: An autopilot that somebody else has started, flown in our simulated world.
        relocate: Puts the mission into another world.
        watch: A ground station that is shown the air link.
        ground: Land controller of the simulator: "twin", or "qemu" for the firmware in an emulator.

    Returns:
        Exit code (`labr_autonomy.errors.ExitCode`).
    """
    mission = load_mission(mission_path)
    if relocate is not None:
        mission = relocate(mission)
    robot = load_robot(robot_path) if robot_path is not None else RobotConfig()
    run_dir = make_run_folder(mission.name, out_dir)
    shutil.copyfile(mission_path, run_dir / "mission.yaml")
    _log_to(run_dir / "executive.log")
    used_seed = seed if seed is not None else (mission.sim.seed if mission.sim else None)
    with LiveLine(quiet=quiet) as line, contextlib.ExitStack() as around:
        line.say(f"run folder {run_dir}")
        try:
            refuse(check_mission(mission, robot))
            waits = console is not None
            if console is not None:
                served = around.enter_context(
                    ConsoleProcess(console, pid=os.getpid(), log_path=run_dir / "console.log")
                )
                for sentence in served.sentences:
                    line.say(sentence, always=True)
            if robot_path is not None:
                summary = asyncio.run(_flight(mission, robot, run_dir, None, line, watch, waits))
            else:
                simulated = Simulated(used_seed or 0, worlds_dir, external, ground)
                summary = _simulated(mission, robot, run_dir, simulated, line, watch, waits)
        except LabrError as error:  # nothing has moved
            _leave(summarise.unmoved(mission.name, "refused", error.what, used_seed), run_dir, line)
            raise
        except (KeyboardInterrupt, asyncio.CancelledError):
            reason = "the operator ended it before anything moved"
            _leave(summarise.unmoved(mission.name, "aborted", reason, used_seed), run_dir, line)
            raise KeyboardInterrupt from None
        summary = summarise.missed_expectations(summary, mission, judged=robot_path is None)
        line.say(f"{summary.outcome}: {summary.reason}")
        _leave(summary, run_dir, line)
    if json_output:
        sys.stdout.write(json.dumps(summary.as_dict()) + "\n")
    if summary.outcome == "success" and summary.expect_missed:
        for sentence in summary.expect_missed:
            line.say(f"expected otherwise: {sentence}")
        return int(ExitCode.EXPECTATION_MISSED)
    return int(EXIT_CODES[summary.outcome])


def _leave(summary: Summary, run_dir: Path, line: LiveLine) -> None:
    """Write summary and report; a report that cannot be written does not change how the run ended."""
    write_summary(summary, run_dir)
    try:
        line.say(f"report {write_report(run_dir)}")
    except (LabrError, OSError, ValueError) as error:
        line.say(f"no report: {error}")


def _simulated(
    mission: Mission,
    robot: RobotConfig,
    run_dir: Path,
    simulated: Simulated,
    line: LiveLine,
    watch: WatchAt | None,
    waits: bool,
) -> Summary:
    """Fly in a simulator of its own, judged by its referee."""
    seed, external = simulated.seed, simulated.external
    also = "" if external is None else f", waiting for the autopilot on {external.url}"
    line.say(f"simulator: building the world and starting the camera{also}")
    with SimulatorProcess(
        mission, robot, seed, simulated.worlds_dir, run_dir, external, ground=simulated.ground
    ) as simulator:
        refuse(check_mission(mission, robot, clearance_at=simulator.clearance_at))
        flown_robot = load_robot(simulator.robot_path)
        flown = asyncio.run(_flight(mission, flown_robot, run_dir, seed, line, watch, waits))
    return summarise.with_truth(flown, run_dir)


def _first_reason(group: BaseExceptionGroup[BaseException]) -> str:
    """What the first of our own errors in a group says."""
    for error in group.exceptions:
        if isinstance(error, BaseExceptionGroup):
            return _first_reason(error)
        if isinstance(error, LabrError):
            return error.what
    return str(group)


async def _flight(
    mission: Mission,
    robot: RobotConfig,
    run_dir: Path,
    seed: int | None,
    line: LiveLine,
    watch: WatchAt | None,
    waits: bool,
) -> Summary:
    clock = SystemClock()
    robot = _limited(robot, mission)
    air_log, ground_log = Tlog(run_dir / "air.tlog"), Tlog(run_dir / "ground.tlog")
    air = AirChannel(robot.links.air, robot, clock, air_log, watch)
    ground = GroundChannel(robot.links.ground, robot.links.ground_baud, robot, clock, ground_log)
    with contextlib.ExitStack() as files:
        files.callback(air_log.close)
        files.callback(ground_log.close)
        flight_log = FlightLog(run_dir / "flight.mcap", metadata={"mission": mission.name})
        files.callback(flight_log.close)

        def record(body: Callable[[], dict[str, Any]]) -> None:
            flight_log.pilot(clock.now_s(), body)

        pilot = RecordedPilot(robot, mission.limits.duration_s, record)
        tlogs = {"air.tlog": air_log, "ground.tlog": ground_log}
        flight = Flight(
            robot,
            pilot,
            clock,
            air,
            ground,
            flight_log,
            line,
            len(mission.items),
            tlogs,
            run_dir,
            waits=waits,
        )
        files.callback(flight.desk.close)
        loop, whole = asyncio.get_running_loop(), asyncio.current_task()
        assert whole is not None
        for number in (signal.SIGTERM, signal.SIGHUP):  # until it moves, ending is all there is to do
            loop.add_signal_handler(number, whole.cancel)
        try:
            await flight.open(line.say)
            here = flight.odometry().pose.position_m
            home = (float(here[0]), float(here[1]))
            floor_z_m = float(here[2]) - robot.body.below_m
            zones = compile_fences(mission, robot, floor_z_m)
            pilot.load(compile_steps(mission, home, floor_z_m), zones)
            known = facts_of(robot, mission.name, run_dir.name, zones, here, floor_z_m, os.getpid())
            flight.desk.open(os.getpid(), known, zones, np.array([*home, floor_z_m]), floor_z_m)
            flight_log.facts(clock.now_s(), known)
            if waits:
                line.say("waiting for start on the console's page")
            with _signals(flight), on_time():
                keep_cores()
                try:
                    await flight.run()
                except* LabrError as group:
                    pilot.fail(_first_reason(group))
            ended = _ended(flight, pilot)
            flight.show_end(f"{ended.outcome}: {ended.reason}")
        finally:
            await flight.close()
        if flight.record.map_xy_m is not None:
            np.savez_compressed(run_dir / "map.npz", occupied_xy=flight.record.map_xy_m)
        loops = {name: np.array(getattr(flight.record, name), np.float32) for name in LATENCIES}
        np.savez_compressed(run_dir / "latencies.npz", **loops)  # type: ignore[arg-type] # names are free
        return summarise.flown(
            mission.name, flight.record, ended.outcome, ended.reason, seed, here, flight.planner_versions
        )


def _ended(flight: Flight, pilot: Pilot) -> Ended:
    if flight.aborted:
        return Ended("aborted", "the operator ended the mission")
    if pilot.failsafe.reaction >= Reaction.LAND:
        return Ended("failsafe", pilot.failsafe.sentence)
    if pilot.steps.status is Status.DONE and not pilot.failure:
        return Ended("success", "all items done")
    return Ended("failed", pilot.failure or "the mission did not finish")


def _limited(robot: RobotConfig, mission: Mission) -> RobotConfig:
    """The robot with the mission's own limits, where they are tighter."""
    speed = mission.limits.speed_mps
    land = robot.land.model_copy(
        update={"speed_mps": min(robot.land.speed_mps, speed.ground or robot.land.speed_mps)}
    )
    air = robot.air.model_copy(
        update={
            "speed_mps": min(robot.air.speed_mps, speed.air or robot.air.speed_mps),
            "height_max_m": height_max_m(mission, robot),
        }
    )
    reserve = max(robot.energy.reserve, mission.energy.reserve_pct / 100.0)
    energy = robot.energy.model_copy(update={"reserve": reserve})
    return robot.model_copy(update={"land": land, "air": air, "energy": energy})


@contextlib.contextmanager
def _signals(flight: Flight) -> Iterator[None]:
    loop = asyncio.get_running_loop()
    handlers = {
        signal.SIGINT: flight.desk.interrupt,
        signal.SIGTERM: flight.desk.end,
        signal.SIGHUP: flight.desk.end,  # the terminal is gone, and with it the operator
    }
    for number, handler in handlers.items():
        loop.add_signal_handler(number, handler)
    try:
        yield
    finally:
        for number in handlers:
            loop.remove_signal_handler(number)


def _log_to(path: Path) -> None:
    root = logging.getLogger("labr")
    root.setLevel(logging.INFO)
    handler = logging.FileHandler(path, encoding="utf-8")
    handler.setFormatter(logging.Formatter("%(relativeCreated)9d ms %(levelname)-7s %(name)s: %(message)s"))
    root.addHandler(handler)
    root.propagate = False
