"""The methods that the benchmark compares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from labr_autonomy.errors import BadInput

if TYPE_CHECKING:
    from labr_autonomy.config import RobotConfig
    from sim.lockstep.planner import Planner
    from sim.lockstep.trial import Task

ORACLE = "oracle"


@dataclass(frozen=True, slots=True)
class Method:
    """One way to plan."""

    name: str
    title: str  # for pictures
    land_only: bool  # it is not sent to goals in the air
    sentence: str  # for people who read a table
    sees: bool = True  # it is shown the camera's images
    true_pose: bool = False  # it is given the true pose, without noise, drift or delay

    def suits(self, in_air: bool) -> bool:
        """Whether it is sent to a goal of this kind."""
        return not (self.land_only and in_air)


METHODS: dict[str, Method] = {
    method.name: method
    for method in (
        Method(
            "two-stage",
            "two-stage (ours)",
            land_only=False,
            sentence="the flight's own planner: key points of the network on land and in the air, refined on "
            "the rolling map",
        ),
        Method(
            "iplanner",
            "iPlanner",
            land_only=True,
            sentence="the baseline network of Yang et al., which plans on land only: it is not sent to goals "
            "in the air, its rows count land trials alone",
        ),
        Method(
            "mapping",
            "mapping-based",
            land_only=False,
            sentence="after Zhou et al. (EGO-Planner): the map that has been seen, a search and an "
            "optimisation, no network",
        ),
        Method(
            ORACLE,
            "oracle",
            land_only=False,
            sentence="knows the whole world and takes the route of least energy: what the task costs at "
            "best; a task that it does not reach is not counted for the others",
            sees=False,
            true_pose=True,
        ),
    )
}


def find_methods(names: str) -> list[Method]:
    """The methods in a comma-separated list, in the registry's order; `all` is every one.

    Raises:
        BadInput: for a name that is not in the registry.
    """
    asked = {name.strip() for name in names.split(",") if name.strip()}
    if asked == {"all"}:
        return list(METHODS.values())
    unknown = sorted(asked - METHODS.keys())
    if unknown or not asked:
        what = f"there is no method '{unknown[0]}'" if unknown else "no method is named"
        raise BadInput(what, f"Take {', '.join(METHODS)}, several with commas, or all")
    return [method for method in METHODS.values() if method.name in asked]


def find_method(name: str) -> Method:
    """One method.

    Raises:
        BadInput: for a name that is not in the registry.
    """
    if name not in METHODS:
        raise BadInput(f"there is no planner for the method '{name}'", f"Take one of {', '.join(METHODS)}")
    return METHODS[name]


def make_planner(name: str, config: RobotConfig, task: Task) -> Planner:
    """A planner of a method, ready for the first cycle.

    Args:
        name: One of `METHODS`.
        config: The robot.
        task: Only the oracle may look at it.
    """
    if name == "two-stage":
        from labr_autonomy.planner.pipeline import Pipeline

        return Pipeline(config)
    if name == "iplanner":
        from sim.bench.iplanner.planner import IPlannerPlanner

        return IPlannerPlanner(config)
    if name == "mapping":
        from sim.bench.mapping.planner import MappingPlanner

        return MappingPlanner(config)
    if name == ORACLE:
        from sim.bench.oracle import OraclePlanner

        return OraclePlanner(config, task)
    raise BadInput(f"there is no planner for the method '{name}'", f"Take one of {', '.join(METHODS)}")
