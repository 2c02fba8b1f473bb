"""One navigation trial: what is asked, and how it went. Plain values, picklable and JSON-ready."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

REACHED_M = 0.5  # paper, section V-B: "within 0.5m of the goal"

Outcome = Literal["reached", "contact", "timeout", "stopped"]


@dataclass(frozen=True, slots=True)
class Task:
    """A start, a goal and the world they are in."""

    world: dict[str, Any]  # World.spec
    seed: int  # of the trial: task, noise and disturbances all follow from it
    start: tuple[float, float, float, float]  # x, y [m], yaw [rad], floor z [m], odom
    goal_m: tuple[float, float, float]  # body origin at the goal, odom
    in_air: bool  # the goal is to be reached flying
    in_sight: bool  # nothing stands between the camera at the start and the goal, and it looks that way
    distance_m: float  # from start to goal, straight
    shortest_m: float  # shortest way that a robot of this size can take, driven or flown
    bound_j: float  # energy of the oracle's route by the energy model
    bound_s: float  # its duration
    movers: tuple[dict[str, Any], ...] = ()  # who walks about there, `sim.movers.mover.Mover.as_dict` of each

    @property
    def limit_s(self) -> float:
        """A trial that has not ended by then has timed out."""
        return min(180.0, 30.0 + 3.0 * self.bound_s)


@dataclass(frozen=True, slots=True)
class Trial:
    """One task to be flown by one method."""

    task: Task
    method: str


@dataclass(frozen=True, slots=True)
class TrialResult:
    """How a trial went, by the referee's truth; every field but `plan_cycle_ms` follows from the seed."""

    outcome: Outcome  # "stopped": the robot ended its mission itself, away from the goal
    reason: str  # its sentence
    goal_error_m: float  # true distance from the goal at the end
    time_s: float
    land_m: float
    air_m: float
    energy_land_j: float  # at the battery's terminals, computer included, while on wheels
    energy_air_j: float  # while flying
    energy_transition_j: float  # between the two: arming, lifting, descending, settling
    min_clearance_m: float
    touchdown_mps: float
    plans: int
    sources: dict[str, int]  # plans by who proposed the path
    plan_cycle_ms: list[float]  # wall time of every planning cycle
    real_time_factor: float  # simulated seconds per CPU second of the flight itself
    track: list[tuple[float, float, float, float, int]]  # t [s], x, y, z [m] odom true, 1 in the air; at 5 Hz
    events: list[tuple[float, str]]  # t [s], sentence
    movers: int = 0  # people and boxes that walked about
    unseen: int = 0  # contacts with movers that had been out of the camera's view for a second
    struck: int = 0  # times that a mover ran into the robot while it stood; no contact of the robot's

    @property
    def energy_j(self) -> float:
        """All joules."""
        return self.energy_land_j + self.energy_air_j + self.energy_transition_j

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return asdict(self)
