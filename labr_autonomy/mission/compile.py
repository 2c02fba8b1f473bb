"""From a mission file to steps and fences in figures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.guard.fence import Zone
from labr_autonomy.mission import schema
from labr_autonomy.mission.schema import Mission
from labr_autonomy.mission.steps import Kind, OnFail, Policy, Step


def compile_steps(mission: Mission, home_xy: tuple[float, float], floor_z_m: float = 0.0) -> list[Step]:
    """The mission's items as steps.

    Args:
        mission: The file.
        home_xy: Where `return` goes, odom [m].
        floor_z_m: Floor of the map, odom [m]; heights in the file count from it.
    """
    return [_step(item, mission, home_xy, floor_z_m) for item in mission.items]


def _step(item: schema.Step, mission: Mission, home_xy: tuple[float, float], floor_z_m: float) -> Step:
    step = _bare(item, mission, home_xy, floor_z_m)
    return replace(step, timeout_s=item.timeout_s, on_fail=OnFail(item.on_fail.value))


def _bare(item: schema.Step, mission: Mission, home_xy: tuple[float, float], floor_z_m: float) -> Step:
    match item:
        case schema.Goto():
            target = mission.target(item)
            flown = target.z is not None
            goal = np.array([target.x, target.y, floor_z_m + (target.z or 0.0)])
            name = item.goto if isinstance(item.goto, str) else f"({target.x:g}, {target.y:g})"
            policy = Policy(item.mode.value)
            return Step(Kind.GOTO, f"goto {name}", goal, flown, policy, item.accept.radius_m)
        case schema.Return():
            goal = np.array([*home_xy, floor_z_m])
            return Step(Kind.GOTO, "return", goal, False, Policy(item.mode.value), item.accept.radius_m)
        case schema.Wait():
            return Step(Kind.WAIT, f"wait {item.wait.seconds:g} s", wait_s=item.wait.seconds)
        case _:
            return Step(Kind.LAND, "land")


def compile_fences(mission: Mission, robot: RobotConfig, floor_z_m: float = 0.0) -> list[Zone]:
    """The fences as zones for the body's origin: shrunk or grown by the outline, so that all of it obeys."""
    return [_zone(fence, robot, floor_z_m) for fence in mission.fence]


def _zone(fence: schema.Fence, robot: RobotConfig, floor_z_m: float) -> Zone:
    low, high = fence.z if fence.z is not None else (-np.inf, np.inf)
    if fence.keep == "in" and low <= 0.0:
        low = -np.inf  # a band from the floor up: wheels on the floor are inside, whatever the estimate says
    outline = (
        tuple((float(x), float(y)) for x, y in fence.polygon)
        if fence.polygon is not None
        else ((fence.circle.x, fence.circle.y),)  # type: ignore[union-attr] # one of the two is given
    )
    return Zone(
        outline=outline,
        keep_in=fence.keep == "in",
        z_low_m=float(low) + floor_z_m,
        z_high_m=float(high) + floor_z_m,
        radius_m=fence.circle.radius_m if fence.circle is not None else None,
        outset_m=robot.body.radius_m,
        below_m=robot.body.below_m,
        above_m=robot.body.above_m,
    )
