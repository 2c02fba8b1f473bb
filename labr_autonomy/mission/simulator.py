"""Starts the simulator as a process of its own and learns where its links are."""

from __future__ import annotations

import json
import logging
import math
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput, LinkError, Refused
from labr_autonomy.mission.check import ClearanceAt, clear_places, goal_places
from labr_autonomy.mission.schema import Mission

END_S = 10.0


@dataclass(frozen=True, slots=True)
class External:
    """An autopilot that somebody else has started."""

    url: str  # as MAVSDK writes it
    truth: str | None = None  # where its simulator publishes the truth; among its own messages otherwise


log = logging.getLogger("labr.simulator")


class SimulatorProcess:
    """A running simulator; use as a context manager.

    Args:
        mission: With its `sim` block.
        robot: Body, camera and limits; the links are the simulator's.
        seed: Of world and noise.
        worlds_dir: Folder with mesh worlds.
        folder: Where it leaves robot.yaml, its logs and the truth.
        external: The autopilot to fly; the stand-in by default.
    """

    def __init__(
        self,
        mission: Mission,
        robot: RobotConfig,
        seed: int,
        worlds_dir: Path | None,
        folder: Path,
        external: External | None = None,
    ) -> None:
        self._folder = folder
        self._asked = goal_places(mission, robot)
        self._spec_path = folder / "simulator.json"
        spec = simulator_spec(mission, robot, seed, worlds_dir, external=external)
        self._spec_path.write_text(json.dumps(spec, indent=1))
        self._process: subprocess.Popen[str] | None = None
        self._answer: dict[str, Any] = {}

    def __enter__(self) -> SimulatorProcess:
        """Start it and wait until it answers.

        Raises:
            BadInput, Refused: with the simulator's own sentence.
            LinkError: when it ends without a word.
        """
        with (self._folder / "simulator.log").open("wb") as errors:
            self._process = subprocess.Popen(
                [
                    sys.executable,
                    "-m",
                    "sim.server",
                    "--spec",
                    str(self._spec_path),
                    "--out",
                    str(self._folder),
                ],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
            )
        assert self._process.stdout is not None
        first = self._process.stdout.readline()
        try:
            self._answer = json.loads(first)
        except ValueError:
            self.close()
            where = self._folder / "simulator.log"
            raise LinkError("the simulator ended before it was ready", f"Its reason is in {where}") from None
        if self._answer["event"] != "ready":
            self.close()
            kind = BadInput if self._answer.get("exit_code") == BadInput.exit_code else Refused
            raise kind(self._answer["what"], self._answer["do"])
        return self

    def __exit__(self, *_: object) -> None:
        """End it."""
        self.close()

    @property
    def robot_path(self) -> Path:
        """`robot.yaml` with the simulator's links."""
        return Path(self._answer["robot"])

    @property
    def clearance_at(self) -> ClearanceAt:
        """Free distance around the body at the places of the mission; inf elsewhere."""
        known = dict(zip(self._asked, self._answer["clearances_m"], strict=True))

        def at(x_m: float, y_m: float, z_m: float) -> float:
            return float(known.get((x_m, y_m, z_m), math.inf))

        return at

    def close(self) -> None:
        """Ask it to end, and make sure that it does."""
        process = self._process
        if process is None:
            return
        self._process = None
        process.terminate()
        try:
            process.wait(timeout=END_S)
        except subprocess.TimeoutExpired:
            log.warning("the simulator did not end within %.0f s", END_S)
            process.kill()
            process.wait()
        if process.stdout is not None:
            process.stdout.close()


def simulator_spec(
    mission: Mission,
    robot: RobotConfig,
    seed: int,
    worlds_dir: Path | None,
    *,
    die_with_parent: bool = True,
    external: External | None = None,
) -> dict[str, Any]:
    """What the simulator is told, JSON-ready (`sim.spec.SimSpec`).

    Raises:
        BadInput: when the mission has no `sim` block.
    """
    if mission.sim is None:
        raise BadInput(
            f"mission '{mission.name}' has no `sim` block, so there is no world to fly in",
            "Add one, or name the real robot with --robot robot.yaml",
        )
    start, disturbances = mission.sim.start, mission.sim.disturbances
    return {
        "world": mission.sim.world.spec(),
        "seed": seed,
        "start": [start.x, start.y, math.radians(start.yaw_deg), start.z],
        "keep_clear_m": clear_places(mission, robot),
        "ask_m": goal_places(mission, robot),
        "movers": mission.sim.world.movers,
        "worlds_dir": str(worlds_dir) if worlds_dir is not None else None,
        "robot": robot.model_dump(mode="json"),
        "die_with_parent": die_with_parent,
        "autopilot": None if external is None else external.url,
        "truth": None if external is None else external.truth,
        "disturbances": disturbances.spec() if disturbances is not None else None,
    }
