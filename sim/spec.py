"""What the simulator process is told, as one JSON file."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput
from sim.disturbances import Disturbances

Place = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class SimSpec:
    """World, start, seed and robot of one simulated run."""

    world: dict[str, Any]  # as in the mission's `sim.world`
    seed: int
    start: tuple[float, float, float, float]  # x, y [m], yaw [rad], height of the floor there [m], odom
    keep_clear_m: tuple[Place, ...] = ()  # places that a generated world leaves free, odom
    ask_m: tuple[Place, ...] = ()  # body positions whose clearance is reported before the start, odom
    worlds_dir: str | None = None
    robot: RobotConfig = field(default_factory=RobotConfig)
    die_with_parent: bool = True
    autopilot: str | None = None  # URL of one that somebody else has started; our stand-in when left out
    truth: str | None = None  # URL where its simulator publishes the truth; with its own messages otherwise
    movers: int = 0  # people and boxes that walk across the likely way
    disturbances: dict[str, Any] | None = None  # as `Disturbances.from_dict` reads it; the world's usual ones

    def drawn(self) -> Disturbances:
        """What disturbs the run: the usual of its world, changed by what the spec says.

        Raises:
            BadInput: on an unknown field or a value that makes no sense.
        """
        return Disturbances.from_dict(self.disturbances or {}, Disturbances.for_world(self.world))

    @staticmethod
    def load(path: Path) -> SimSpec:
        """Read the file (`labr_autonomy.mission.simulator.simulator_spec` writes it).

        Raises:
            BadInput: when the file is absent or not of this form.
        """
        try:
            values = json.loads(path.read_text())
            places = {k: tuple(tuple(p) for p in values.pop(k)) for k in ("keep_clear_m", "ask_m")}
            start = tuple(values.pop("start"))
            return SimSpec(**{**values, **places, "start": start, "robot": RobotConfig(**values["robot"])})
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise BadInput(f"the simulator's spec {path} cannot be read: {error}") from error
