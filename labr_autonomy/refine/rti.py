"""Seed in, feasible plan out: up to three QPs, each linearised where the last one ended, each checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from labr_autonomy.refine.check import Verdict, dense_check
from labr_autonomy.refine.polytopes import Polytopes
from labr_autonomy.refine.problem import Bounds, Problem
from labr_autonomy.refine.solver import QpStep
from labr_autonomy.refine.values import STEPS, DistanceField
from labr_autonomy.types import Array

ITERATIONS = 3


@dataclass(frozen=True, slots=True)
class Plan:
    """A re-simulated plan."""

    x: Array  # (n + 1, nx)
    u: Array  # (n, nu)
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class Task:
    """One mode's problem at one instant."""

    problem: Problem
    step: QpStep
    x0: Array
    bounds: Bounds
    settle: Callable[[Array, Array, Bounds], tuple[Array, Array] | None]  # (x0, u, bounds) -> (x, u)
    dense: Callable[[Array, Array], Array]  # (x, u) -> positions
    field: DistanceField
    hard_m: float
    over: Callable[[Array, Array], str]  # (x, u) -> the limit that it breaks

    def judge(self, x: Array, u: Array) -> Verdict:
        """The dense check of a plan, against map and limits."""
        return replace(dense_check(self.dense(x, u), self.field, self.hard_m), over=self.over(x, u))

    def solve(self, seed: tuple[Array, Array], reference: Array, polytopes: Polytopes | None) -> Plan | None:
        """The first plan that may leave, else the last one found; None where the QP has no usable answer."""
        x, u = seed
        best: Plan | None = None
        for _ in range(ITERATIONS if polytopes else 1):
            planes = polytopes.planes(x[:, : reference.shape[1]]) if polytopes else self.problem.no_planes()
            w = self.step(
                self.problem.pack(x, u),
                self.problem.parameter(self.x0, reference, planes),
                self.bounds.low,
                self.bounds.high,
                self.bounds.row_low,
                self.bounds.row_high,
            )
            settled = None if w is None else self.settle(self.x0, self.problem.controls_of(w), self.bounds)
            if settled is None:
                return best
            x, u = settled
            best = Plan(x, u, self.judge(x, u))
            if best.verdict.may_leave:
                return best
        return best


def advances(plan: Plan, reference: Array) -> bool:
    """Whether a plan goes anywhere, measured against the reference that it should follow (STEPS + 1, d)."""
    d = reference.shape[1]
    wanted = float(np.linalg.norm(np.diff(reference, axis=0), axis=1).sum())
    done = float(np.linalg.norm(np.diff(plan.x[: STEPS + 1, :d], axis=0), axis=1).sum())
    return wanted < 0.3 or done > 0.05
