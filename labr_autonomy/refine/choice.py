"""What both planners share: the call, the choice among seeds, the result."""

from __future__ import annotations

import math
from dataclasses import dataclass

from labr_autonomy.clock import Clock
from labr_autonomy.refine.check import Verdict
from labr_autonomy.refine.polytopes import Polytopes
from labr_autonomy.refine.rti import Plan, Task, advances
from labr_autonomy.refine.values import RefineResult
from labr_autonomy.types import Array, Mode, Source, Trajectory

ARRIVED_M = 0.03  # nearer to the end of the path than this, the robot stays
LOOK_AHEAD_M = 0.4  # where along the path its heading is taken
CLOSE_M = 0.5
TURN_RAD = math.radians(50.0)  # a slow robot that heads off by more turns on the spot first
TURN_MOVING_RAD = math.radians(90.0)  # so does a fast one
BLOCKED_M = 0.6  # key points that are blocked nearer than this are refused


@dataclass(frozen=True, slots=True)
class Call:
    """What one call of the refiner carries around."""

    clock: Clock
    now_s: float
    began_s: float
    source: Source
    previous: Trajectory | None

    def previous_of(self, mode: Mode) -> Trajectory | None:
        """The previous trajectory if it is of this mode."""
        return self.previous if self.previous is not None and self.previous.mode is mode else None

    def result(
        self, out: Trajectory, verdict: Verdict, outline_m: float, why: str, *, stopped: bool = False
    ) -> RefineResult:
        """The answer, with the time that it took."""
        if stopped and not verdict.free:
            why += f"; braking within {verdict.nearest_m:.2f} m of an obstacle"
        took = self.clock.now_s() - self.began_s
        return RefineResult(out, out.source, verdict.nearest_m - outline_m, stopped, why, took)


def best_plan(task: Task, seeds: list[tuple[Array, Array]], timed: Array, polytopes: Polytopes) -> Plan | str:
    """The first plan that may leave and advances, or why there is none."""
    why = "the solver found no plan"
    for seed in seeds:
        plan = task.solve(seed, timed, polytopes)
        if plan is None:
            continue
        if plan.verdict.over:
            why = f"the best plan {plan.verdict.over}"
        elif not plan.verdict.free:
            why = f"the best plan comes within {plan.verdict.nearest_m:.2f} m of an obstacle"
        elif not advances(plan, timed):
            why = "the plan does not advance"
        else:
            return plan
    return why
