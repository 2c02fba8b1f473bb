"""What the rest of the mission will cost, in joules. A floor: straight lines, no detours."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from labr_autonomy.mission.steps import Kind, Policy, Step
from labr_autonomy.modes.energy import EnergyModel
from labr_autonomy.types import Array, Mode


def joules_to_finish(steps: Sequence[Step], position_m: Array, mode: Mode, model: EnergyModel) -> float:
    """Energy that the given steps take from here [J].

    A goal on the floor is driven to unless its step is for the air alone; a goal in the air is driven under
    and risen to; each change of mode pays half of a take-off and landing.

    Args:
        steps: What is left to do, the present step first.
        position_m: (3,) odom.
        mode: The present mode.
        model: Powers and speeds of the robot.
    """
    total_j, here, air = 0.0, np.asarray(position_m, dtype=float), mode is Mode.AIR
    for step in steps:
        if step.kind is Kind.WAIT:
            total_j += step.wait_s * (model.air_w if air else 0.0)
            continue
        if step.kind is Kind.LAND or step.goal_m is None:
            total_j += model.transition_j() / 2.0 if air else 0.0
            air = False
            continue
        flat_m = float(np.hypot(*(step.goal_m[:2] - here[:2])))
        climb_m = float(step.goal_m[2] - here[2]) if step.in_air else 0.0
        flown = step.policy is Policy.AIR or (air and step.in_air)
        wants_air = step.in_air
        if flown and not air:
            total_j += model.transition_j() / 2.0
            air = True
        total_j += model.air_j(flat_m, climb_m) if flown else model.land_j(flat_m)
        if wants_air != air:
            total_j += model.transition_j() / 2.0
            air = wants_air
        here = step.goal_m
    return total_j
