"""Whether the battery lasts for a flight: what it holds above the reserve, what a flight takes. Pure."""

from __future__ import annotations

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.mission.steps import Policy, Step
from labr_autonomy.modes.energy import EnergyModel
from labr_autonomy.types import Array

HOP_M = 10.0  # of flight that a hop over something must have joules for


class Spare:
    """The joules above the reserve.

    Args:
        config: Pack, reserve and powers.

    Attributes:
        battery_left: 0..1, of the whole pack.
    """

    def __init__(self, config: RobotConfig) -> None:
        self.battery_left = 1.0
        self._pack, self._model = config.energy, EnergyModel.of(config)

    @property
    def joules(self) -> float:
        """What the battery holds above the reserve [J]; negative below it."""
        return (self.battery_left - self._pack.reserve) * self._pack.pack_j

    def may_hop(self, step: Step | None) -> bool:
        """Whether policy and battery allow flying over what is in the way of a goal on land."""
        allowed = step is None or step.policy is not Policy.GROUND
        return allowed and self.joules > self._model.transition_j() + self._model.air_j(HOP_M)

    def short_of(self, step: Step | None, position_m: Array) -> str:
        """Why a flight from a place (3,) odom to a step's goal cannot be afforded, "" if it can.

        Faults.md, row 52.
        """
        if step is None or step.goal_m is None:
            return ""
        away = step.goal_m - position_m
        need_j = self._model.transition_j() + self._model.air_j(float(np.hypot(*away[:2])), float(away[2]))
        if self.joules >= need_j:
            return ""
        spare_j = max(self.joules, 0.0)
        return f"flying there takes {need_j:.0f} J, and the battery holds {spare_j:.0f} J above its reserve"
