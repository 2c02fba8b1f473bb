"""Feasibility before anything moves: pure checks of a mission against a robot and, where known, the world."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import Refused
from labr_autonomy.guard.fence import Zone, margin_m
from labr_autonomy.mission.compile import compile_fences
from labr_autonomy.mission.fence import polygon_fault
from labr_autonomy.mission.schema import Goto, Mission, Point

ClearanceAt = Callable[[float, float, float], float]
"""Free distance [m] around the robot's outline with its body origin at (x, y, z) odom, to the nearest
obstacle; the floor it stands on is none. Zero or less: touching or inside."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One reason not to start."""

    code: str  # stable, for machines
    item: int | None  # index into the mission's items; None when it is about the whole
    sentence: str


@dataclass(frozen=True, slots=True)
class _Stand:
    """A place where the robot will be."""

    name: str  # as a sentence begins
    item: int | None
    x_m: float
    y_m: float
    z_m: float  # body origin above the map's floor
    flown: bool


def height_max_m(mission: Mission, robot: RobotConfig) -> float:
    """Height of the body above the floor that is never exceeded [m]: the lower of mission's and robot's."""
    own = robot.air.height_max_m
    return own if mission.limits.height_max_m is None else min(own, mission.limits.height_max_m)


def clear_places(mission: Mission, robot: RobotConfig) -> list[tuple[float, float, float]]:
    """Body origins (x, y, z) odom that a generated world keeps free: the start, then each goal in turn.

    Who builds the world of a mission passes exactly these, so that all build the same one; none when the
    world shall be as its seed draws it.
    """
    if mission.sim is not None and not getattr(mission.sim.world, "clear", True):
        return []
    return goal_places(mission, robot)


def goal_places(mission: Mission, robot: RobotConfig) -> list[tuple[float, float, float]]:
    """Body origins (x, y, z) odom of the start, then of each goal in turn."""
    start = None if mission.sim is None else (mission.sim.start.x, mission.sim.start.y)
    floor_m = _floor_m(mission)
    return [(stand.x_m, stand.y_m, stand.z_m + floor_m) for stand in _stands(mission, robot, start)]


def _floor_m(mission: Mission) -> float:
    """Height of the map's floor in the simulated world [m]."""
    return 0.0 if mission.sim is None else mission.sim.start.z


def check_mission(
    mission: Mission,
    robot: RobotConfig,
    *,
    clearance_at: ClearanceAt | None = None,
    start_xy_m: tuple[float, float] | None = None,
) -> list[Finding]:
    """Everything that speaks against starting; empty when nothing does.

    Args:
        mission: What shall be done.
        robot: What does it.
        clearance_at: Where the world is known: free distance around the outline.
        start_xy_m: Where the robot stands in odom; by default the simulated start, if there is one.
    """
    if start_xy_m is None and mission.sim is not None:
        start_xy_m = (mission.sim.start.x, mission.sim.start.y)
    stands = list(_stands(mission, robot, start_xy_m))
    findings, zones = _fences(mission, robot)
    for stand in stands:
        findings += _outside(stand, zones)
        findings += _too_high(stand, height_max_m(mission, robot))
        if clearance_at is not None:
            findings += _obstructed(stand, clearance_at, robot, _floor_m(mission))
    findings += _reserve_missing(mission, robot)
    return findings


def refuse(findings: Sequence[Finding]) -> None:
    """Raise one error that names every finding.

    Raises:
        Refused: when there is a finding.
    """
    if not findings:
        return
    if len(findings) == 1:
        raise Refused(f"not feasible: {findings[0].sentence}", "Nothing has moved")
    listed = "\n".join(f"  - {finding.sentence}" for finding in findings)
    raise Refused(f"not feasible, {len(findings)} reasons:\n{listed}\n  Nothing has moved")


def _stands(mission: Mission, robot: RobotConfig, start_xy_m: tuple[float, float] | None) -> Iterator[_Stand]:
    on_wheels_m = robot.body.below_m
    if start_xy_m is not None:
        yield _Stand("the start", None, *start_xy_m, on_wheels_m, flown=False)
    for i, item in enumerate(mission.items):
        if isinstance(item, Goto):
            goal = mission.target(item)
            z_m = on_wheels_m if goal.z is None else goal.z
            yield _Stand(_named(i, item, goal), i, goal.x, goal.y, z_m, flown=goal.z is not None)


def _named(index: int, item: Goto, goal: Point) -> str:
    where = ", ".join(f"{v:g}" for v in (goal.x, goal.y, goal.z) if v is not None)
    name = f" '{item.goto}'" if isinstance(item.goto, str) else ""
    return f"the goal{name} of item {index + 1} at ({where})"


def _fences(mission: Mission, robot: RobotConfig) -> tuple[list[Finding], dict[int, Zone]]:
    """What is wrong with the fences, and by index those that bound a region."""
    findings: list[Finding] = []
    zones: dict[int, Zone] = {}
    for i, (fence, zone) in enumerate(zip(mission.fence, compile_fences(mission, robot), strict=True)):
        fault = polygon_fault(fence.polygon) if fence.polygon else None
        if fault:
            findings.append(Finding("fence_invalid", None, f"fence {i + 1} bounds no region: {fault}"))
        else:
            zones[i] = zone
    return findings, zones


def _outside(stand: _Stand, zones: dict[int, Zone]) -> Iterator[Finding]:
    for i, zone in zones.items():
        margin = margin_m([zone], stand.x_m, stand.y_m, stand.z_m)
        if margin < -1e-9:  # on the line is inside; the tolerance is for rounding only
            side = "outside" if zone.keep_in else "inside the keep-out"
            sentence = f"{stand.name} puts the robot {-margin:.2f} m {side} fence {i + 1}"
            code = "start_outside_fence" if stand.item is None else "goal_outside_fence"
            yield Finding(code, stand.item, sentence)


def _too_high(stand: _Stand, limit_m: float) -> Iterator[Finding]:
    if stand.flown and stand.z_m > limit_m:
        yield Finding("goal_too_high", stand.item, f"{stand.name} is above the ceiling of {limit_m:g} m")


def _obstructed(
    stand: _Stand, clearance_at: ClearanceAt, robot: RobotConfig, floor_m: float
) -> Iterator[Finding]:
    free_m = clearance_at(stand.x_m, stand.y_m, stand.z_m + floor_m)
    needed_m = robot.clearance.hard_m if stand.item is None else robot.clearance.soft_m
    kind = "start" if stand.item is None else "goal"
    if free_m <= 0.0:
        yield Finding(f"{kind}_in_obstacle", stand.item, f"{stand.name} is inside an obstacle")
    elif free_m < needed_m:
        sentence = f"{stand.name} leaves {free_m:.2f} m to an obstacle, {needed_m:.2f} m are needed"
        yield Finding(f"{kind}_near_obstacle", stand.item, sentence)


def _reserve_missing(mission: Mission, robot: RobotConfig) -> Iterator[Finding]:
    """The floor of the bill: straight lines, driven, plus a take-off for each goal in the air."""
    spendable_j = robot.energy.pack_j * (1.0 - mission.energy.reserve_pct / 100.0)
    points = [mission.target(item) for item in mission.items if isinstance(item, Goto)]
    metres = sum(((b.x - a.x) ** 2 + (b.y - a.y) ** 2) ** 0.5 for a, b in itertools.pairwise(points))
    lifts = sum(1 for point in points if point.z is not None)
    needed_j = metres / robot.land.speed_mps * robot.energy.land_w
    needed_j += lifts * robot.energy.transition_s * robot.energy.air_w
    if needed_j > spendable_j:
        sentence = (
            f"the mission takes at least {needed_j / 1e3:.0f} kJ, the pack gives {spendable_j / 1e3:.0f} kJ"
        )
        yield Finding("energy_short", None, f"{sentence} above its reserve")
