"""Metres and joules by mode, as flown, from the robot's own telemetry."""

from __future__ import annotations

import math
from dataclasses import dataclass

from labr_autonomy.modes.transition import Phase
from labr_autonomy.types import Array

STEP_MAX_M = 0.2  # a larger jump between two ticks is a correction of the estimate, not motion
NOISE_SPEED_MPS = 0.05  # slower than this the estimate only trembles


@dataclass
class Meter:
    """Running sums of one flight."""

    land_m: float = 0.0
    air_m: float = 0.0
    energy_land_j: float = 0.0
    energy_air_j: float = 0.0
    energy_transition_j: float = 0.0
    _last_m: tuple[float, float, float] | None = None

    def add(self, phase: Phase, position_m: Array, speed_mps: float, power_w: float, dt_s: float) -> None:
        """Account for one tick spent in `phase`; power below zero or unknown counts as none."""
        here = (float(position_m[0]), float(position_m[1]), float(position_m[2]))
        step_m = 0.0 if self._last_m is None else math.dist(here, self._last_m)
        if step_m > STEP_MAX_M or speed_mps < NOISE_SPEED_MPS:
            step_m = 0.0
        self._last_m = here
        used_j = max(power_w, 0.0) * dt_s if math.isfinite(power_w) else 0.0
        match phase:
            case Phase.DRIVING | Phase.STOPPING:
                self.land_m += step_m
                self.energy_land_j += used_j
            case Phase.FLYING:
                self.air_m += step_m
                self.energy_air_j += used_j
            case _:
                self.air_m += step_m
                self.energy_transition_j += used_j

    @property
    def energy_j(self) -> float:
        """All joules so far."""
        return self.energy_land_j + self.energy_air_j + self.energy_transition_j
