"""The optimal control problem in CasADi symbols, once for both means of locomotion.

Multiple shooting over `STEPS` intervals, variables per stage (x_k, u_k, s_k) with one slack s_k for the
obstacles. Each stage keeps four half-spaces `n p_k + s_k >= b`; the last state is at rest, so that every
plan is also a way to stop.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from labr_autonomy.refine.values import STEPS
from labr_autonomy.types import Array

PLANES = 4  # half-spaces a stage
SLACK_LINEAR = 5.0  # 50 stalled in narrow gaps, 5 passed all of them (measured, 16 missions)
SLACK_SQUARE = 300.0
REGULAR = 1e-6  # keeps the Hessian definite in states without a cost
FREE_OFFSET = -50.0  # right-hand side of a half-space that binds nothing


TIGHT = (
    0.995  # the QP sees this part of each limit: room for its tolerance, so that the real limit holds exactly
)
TOLERANCE = 1e-3  # [SI] by which a re-simulated plan may pass the tightened limits


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds of the variables (size,) and of the rows."""

    low: Array
    high: Array
    row_low: Array
    row_high: Array


@dataclass(frozen=True, slots=True)
class Spec:
    """What differs between driving and flying; the callables take and return CasADi columns."""

    name: str
    space: int  # dimensions of the obstacle field: 2 or 3
    states: int
    controls: int  # without the slack
    step: Callable[[Any, Any], Any]  # (x, u) -> next x, exact over STEP_S
    cost: Callable[[Any, Any, Any], Any]  # (x, u or None at the end, reference point) -> scalar
    rest: Callable[[Any], Any]  # x -> what must vanish at the end
    rows: Callable[[Any], Any] | None = None  # x -> further linear rows with bounds


@functools.cache
def problem_of(spec: Spec) -> Problem:
    """The problem of a description, built once for all planners of a process: it holds no state."""
    return Problem(spec)


class Problem:
    """Symbols, index tables and the function that linearises the problem at a seed."""

    def __init__(self, spec: Spec) -> None:
        self.spec = spec
        nx, nu, d = spec.states, spec.controls + 1, spec.space
        xs = [ca.SX.sym(f"x{k}", nx) for k in range(STEPS + 1)]
        us = [ca.SX.sym(f"u{k}", nu) for k in range(STEPS)]
        start, reference = ca.SX.sym("start", nx), ca.SX.sym("reference", d, STEPS + 1)
        planes = ca.SX.sym("planes", PLANES * (d + 1), STEPS)

        w: list[Any] = []
        g: list[Any] = [xs[0] - start]
        low, high = [0.0] * nx, [0.0] * nx
        extra: list[int] = []
        cost: Any = 0
        for k in range(STEPS + 1):
            last = k == STEPS
            w.append(xs[k])
            if spec.rows is not None and k > 0:
                rows = spec.rows(xs[k])
                extra += range(len(low), len(low) + rows.numel())
                g.append(rows)
                low += [0.0] * rows.numel()
                high += [0.0] * rows.numel()
            if last:
                cost += spec.cost(xs[k], None, reference[:, k])
                break
            w.append(us[k])
            slack = us[k][nu - 1]
            cost += spec.cost(xs[k], us[k], reference[:, k]) + SLACK_LINEAR * slack + SLACK_SQUARE * slack**2
            g.append(xs[k + 1] - spec.step(xs[k], us[k]))
            low += [0.0] * nx
            high += [0.0] * nx
            if k > 0:
                for m in range(PLANES):
                    plane = planes[m * (d + 1) : (m + 1) * (d + 1), k]
                    g.append(ca.dot(plane[:d], xs[k][:d]) + slack - plane[d])
                low += [0.0] * PLANES
                high += [np.inf] * PLANES
        rest = spec.rest(xs[STEPS])
        g.append(rest)
        low += [0.0] * rest.numel()
        high += [0.0] * rest.numel()

        stride = nx + nu
        self.size = stride * STEPS + nx
        self.x_index: NDArray[np.int64] = np.arange(STEPS + 1)[:, None] * stride + np.arange(nx)
        self.u_index: NDArray[np.int64] = np.arange(STEPS)[:, None] * stride + nx + np.arange(nu)
        self.row_low, self.row_high = np.array(low), np.array(high)
        self.extra_rows = np.array(extra, dtype=np.int64).reshape(
            STEPS, -1
        )  # rows of Spec.rows, by stage 1..STEPS
        self._linearise(
            ca.vertcat(*w), cost, ca.vertcat(*g), ca.vertcat(start, ca.vec(reference), ca.vec(planes))
        )

    def _linearise(self, w: Any, cost: Any, g: Any, p: Any) -> None:
        """QP in absolute variables: min w'Hw/2 + q'w with A w - r within the row bounds."""
        hessian = ca.hessian(cost, w)[0] + REGULAR * ca.SX.eye(self.size)
        jacobian = ca.jacobian(g, w)
        q = ca.gradient(cost, w) - hessian @ w
        self.hessian_sparsity, self.jacobian_sparsity = hessian.sparsity(), jacobian.sparsity()
        self.parameters = int(p.numel())
        self.linearised = ca.Function(
            f"{self.spec.name}_qp", [w, p], [hessian, q, jacobian, jacobian @ w - g]
        )

    def pack(self, x: Array, u: Array) -> Array:
        """(STEPS + 1, nx) states and (STEPS, nu) controls, slack zero, as one vector."""
        w = np.zeros(self.size)
        w[self.x_index] = x
        w[self.u_index[:, :-1]] = u
        return w

    def controls_of(self, w: Array) -> Array:
        """The (STEPS, nu) controls without the slack."""
        out: Array = w[self.u_index[:, :-1]]
        return out

    def parameter(self, start: Array, reference: Array, planes: Array) -> Array:
        """Parameters in the order of the symbols: (nx,), (STEPS + 1, d), (STEPS, PLANES * (d + 1))."""
        return np.concatenate([start, reference.ravel(), planes.ravel()])

    def inside(self, x: Array, u: Array, bounds: Bounds) -> bool:
        """Whether re-simulated states after the first, and the controls, keep the bounds."""
        xs, us = self.x_index[1:], self.u_index[:, :-1]
        return bool(
            (x[1:] <= bounds.high[xs] + TOLERANCE).all()
            and (x[1:] >= bounds.low[xs] - TOLERANCE).all()
            and (u <= bounds.high[us] + TOLERANCE).all()
            and (u >= bounds.low[us] - TOLERANCE).all()
        )

    def no_planes(self) -> Array:
        """Half-spaces that bind nothing."""
        d = self.spec.space
        planes = np.zeros((STEPS, PLANES * (d + 1)))
        planes[:, d :: d + 1] = FREE_OFFSET
        return planes
