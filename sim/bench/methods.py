"""The methods that the benchmark compares."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from labr_autonomy.errors import BadInput
from sim.bench.alone.names import HOW, NAME, folder_of, is_network, manifest_of

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
    meets_movers: bool = True  # a task's movers are in its world

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
            "best; a task that it does not reach is not counted for the others; it flies without movers",
            sees=False,
            true_pose=True,
            meets_movers=False,
        ),
    )
}


# The flight's planner with one part taken out: what each part buys. Flown only where named.
ABLATIONS: dict[str, Method] = {
    method.name: method
    for method in (
        Method(
            "no-network",
            "ours, map alone",
            land_only=False,
            sentence="ours without the network: the map's ways alone, refined as ever",
        ),
        Method(
            "no-memory",
            "ours, no memory",
            land_only=False,
            sentence="ours with the rolling map alone: what leaves its 20 m is forgotten",
        ),
        Method(
            "no-energy",
            "ours, no energy term",
            land_only=False,
            sentence="ours that prices flying as driving: what is quicker, not what costs fewer joules",
        ),
    )
}


def find_methods(names: str) -> list[Method]:
    """The methods in a comma-separated list, in the registry's order, then networks as named.

    `all` is every one in the registry; networks alone are flown where they are named.

    Raises:
        BadInput: for a name that is not known, or a network without weights.
    """
    asked = list(dict.fromkeys(name.strip() for name in names.split(",") if name.strip()))
    if asked == ["all"]:
        return list(METHODS.values())
    networks = [name for name in asked if is_network(name)]
    unknown = sorted(set(asked) - METHODS.keys() - ABLATIONS.keys() - set(networks))
    if unknown or not asked:
        what = f"there is no method '{unknown[0]}'" if unknown else "no method is named"
        raise BadInput(what, f"Take {', '.join(METHODS | ABLATIONS)}, {HOW}, several with commas, or all")
    known = (*METHODS.values(), *ABLATIONS.values())
    return [*(m for m in known if m.name in asked), *(_network(name) for name in networks)]


def find_method(name: str) -> Method:
    """One method.

    Raises:
        BadInput: for a name that is not known, or a network without weights.
    """
    if is_network(name):
        return _network(name)
    known = METHODS | ABLATIONS
    if name not in known:
        raise BadInput(f"there is no method '{name}'", f"Take one of {', '.join(known)}, {HOW}")
    return known[name]


def in_order(names: Iterable[str]) -> list[str]:
    """Each of the names once: the registry's in its order, then networks as they come."""
    found = list(dict.fromkeys(names))
    return [*(name for name in METHODS if name in found), *(name for name in found if name not in METHODS)]


def _network(name: str) -> Method:
    """The method that flies a network alone."""
    whose = "the packaged network" if name == NAME else f"the network in {folder_of(name)}"
    return Method(
        name,
        "network alone" if name == NAME else f"network {folder_of(name).name}",
        land_only=bool(manifest_of(name).get("land_only", False)),
        sentence=f"{whose} alone: its key points as a spline that is followed; no map of obstacles, no "
        "refiner, no recovery",
    )


def make_planner(name: str, config: RobotConfig, task: Task) -> Planner:
    """A planner of a method, ready for the first cycle.

    Args:
        name: One of `METHODS`, or a network's.
        config: The robot.
        task: Only the oracle may look at it.
    """
    if name == "two-stage" or name in ABLATIONS:
        from labr_autonomy.planner.pipeline import Pipeline

        if name == "no-energy":
            even = config.energy.model_copy(update={"air_w": config.energy.land_w})
            config = config.model_copy(update={"energy": even})
        return Pipeline(config, network=name != "no-network", memory=name != "no-memory")
    if name == "iplanner":
        from sim.bench.iplanner.planner import IPlannerPlanner

        return IPlannerPlanner(config)
    if name == "mapping":
        from sim.bench.mapping.planner import MappingPlanner

        return MappingPlanner(config)
    if name == ORACLE:
        from sim.bench.oracle import OraclePlanner

        return OraclePlanner(config, task)
    if is_network(name):
        from labr_autonomy.gkpn.infer import GkpnOnnx
        from sim.bench.alone.planner import AlonePlanner

        return AlonePlanner(config, GkpnOnnx(folder_of(name)), drives_only=find_method(name).land_only)
    raise BadInput(f"there is no planner for the method '{name}'", f"Take one of {', '.join(METHODS)}, {HOW}")
