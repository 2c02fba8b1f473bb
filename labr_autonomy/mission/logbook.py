"""What a flight leaves behind in figures: metres, joules, legs, latencies."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from labr_autonomy.mission.meter import Meter
from labr_autonomy.mission.pilot import Pilot
from labr_autonomy.mission.pilot_io import Actions
from labr_autonomy.mission.steps import OnFail, Step
from labr_autonomy.types import Array, Odometry


@dataclass(frozen=True, slots=True)
class LegRecord:
    """How one step went."""

    index: int
    step: Step
    start_s: float
    end_s: float
    outcome: str  # "done", "skipped" or "failed"
    land_m: float
    air_m: float
    energy_j: float
    position_m: Array  # (3,) odom, the estimate at its end


@dataclass
class Logbook:
    """Figures collected in flight."""

    meter: Meter = field(default_factory=Meter)
    tick_late_s: list[float] = field(default_factory=list)
    plan_cycle_s: list[float] = field(default_factory=list)
    setpoint_age_s: list[float] = field(default_factory=list)
    legs: list[LegRecord] = field(default_factory=list)
    map_xy_m: np.ndarray | None = None
    ticks_missed: int = 0
    started_s: float = 0.0
    ended_s: float = 0.0
    _leg_from: tuple[float, float, float, float] | None = None
    _used_frame_s: float | None = None
    _ended: bool = False

    def tick(
        self, pilot: Pilot, actions: Actions, estimate: Odometry, power_w: float, now_s: float, dt_s: float
    ) -> None:
        """Account for one tick."""
        meter = self.meter
        speed = float(np.linalg.norm(estimate.velocity_mps))
        meter.add(actions.phase, estimate.pose.position_m, speed, power_w, dt_s)
        if actions.plan_used_s is not None and actions.plan_used_s != self._used_frame_s:
            self._used_frame_s = actions.plan_used_s
            self.setpoint_age_s.append(now_s - actions.plan_used_s)
        if self._leg_from is None:
            self._leg_from = self._mark(now_s)
        if actions.reached is not None:
            self._end_leg(actions.reached, "done", estimate, now_s)
        elif actions.failed is not None:
            skipped = actions.failed.on_fail is OnFail.SKIP
            self._end_leg(actions.failed, "skipped" if skipped else "failed", estimate, now_s)
            self._ended = not skipped
        elif pilot.failure and not self._ended:
            self._ended = True
            step = pilot.step_at(len(self.legs))
            if step is not None:
                self._end_leg(step, "failed", estimate, now_s)

    def begin(self, now_s: float) -> None:
        """What came before is not part of the mission: it has waited for its operator."""
        self.meter, self.legs, self._leg_from = Meter(), [], None
        self.started_s = now_s

    def leave(self, step: Step, estimate: Odometry, now_s: float) -> None:
        """The operator ended a step before it was reached."""
        self._end_leg(step, "skipped", estimate, now_s)

    def _mark(self, now_s: float) -> tuple[float, float, float, float]:
        return now_s, self.meter.land_m, self.meter.air_m, self.meter.energy_j

    def _end_leg(self, step: Step, outcome: str, estimate: Odometry, now_s: float) -> None:
        started_s, land_m, air_m, energy_j = self._leg_from or self._mark(now_s)
        meter = self.meter
        self.legs.append(
            LegRecord(
                index=len(self.legs),
                step=step,
                start_s=started_s,
                end_s=now_s,
                outcome=outcome,
                land_m=meter.land_m - land_m,
                air_m=meter.air_m - air_m,
                energy_j=meter.energy_j - energy_j,
                position_m=estimate.pose.position_m.copy(),
            )
        )
        self._leg_from = self._mark(now_s)
