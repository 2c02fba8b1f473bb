"""L-BFGS over control points: smooth, away from obstacles, within limits. Analytic gradients throughout.

Collision is judged on the map's distance field, at samples of the curve itself rather than at its control
points: EGO-Planner's {p, v} pairs approximate the same distance where no field is kept; here one is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from labr_autonomy.perception.fields import Field2, Field3
from labr_autonomy.types import Array
from sim.bench.mapping.bspline import BASIS

SAMPLES = 4  # of the curve, on each interval
_U = np.arange(SAMPLES) / SAMPLES
WEIGHTS = np.ascontiguousarray(np.stack([np.ones(SAMPLES), _U, _U**2, _U**3], axis=1) @ BASIS)
ITERATIONS_MAX = 60


@dataclass(frozen=True, slots=True)
class Aims:
    """What a spline is to keep, and how much each matters."""

    distance_m: float  # of the curve from obstacles
    speed: float  # horizontal, norm of each velocity control point
    up: float  # vertical speeds
    down: float
    acceleration: float  # norm of each acceleration control point
    smooth: float = 1.0  # weights
    clear: float = 60.0
    limits: float = 4.0

    def harder(self, factor: float) -> Aims:
        """The same with more weight on obstacles."""
        return replace(self, clear=self.clear * factor)


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _distance(values: Any, origin: Any, cell: float, p: Any, slope: Any) -> float:
    """Trilinear interpolation as `Field.lookup`; writes its exact gradient into `slope` (3,)."""
    low = np.empty(3, np.int64)
    high = np.empty(3, np.int64)
    f = np.empty(3)
    live = np.empty(3)
    for k in range(3):
        n = values.shape[k]
        u = (p[k] - origin[k]) / cell - 0.5
        live[k] = 1.0 if 0.0 < u < n - 1.0 else 0.0
        u = min(max(u, 0.0), n - 1.0)
        low[k] = min(int(u), max(n - 2, 0))
        high[k] = min(low[k] + 1, n - 1)
        f[k] = u - low[k]
        slope[k] = 0.0
    total = 0.0
    for i in range(2):
        for j in range(2):
            for k in range(2):
                v = values[high[0] if i else low[0], high[1] if j else low[1], high[2] if k else low[2]]
                wx = f[0] if i else 1.0 - f[0]
                wy = f[1] if j else 1.0 - f[1]
                wz = f[2] if k else 1.0 - f[2]
                total += wx * wy * wz * v
                slope[0] += (1.0 if i else -1.0) * wy * wz * v
                slope[1] += (1.0 if j else -1.0) * wx * wz * v
                slope[2] += (1.0 if k else -1.0) * wx * wy * v
    for k in range(3):
        slope[k] *= live[k] / cell
    return total


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _excess(x: float, y: float, most: float, out: Any) -> float:
    """Squared excess of a horizontal vector's norm; writes its gradient (2,)."""
    out[0] = out[1] = 0.0
    norm = math.sqrt(x * x + y * y)
    over = norm - most
    if over <= 0.0:
        return 0.0
    out[0], out[1] = 2.0 * over * x / norm, 2.0 * over * y / norm
    return over * over


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _beyond(value: float, low: float, high: float) -> float:
    """By how much a value lies outside a range, signed."""
    return value - high if value > high else min(value - low, 0.0)


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _roughness(q: Any, weight: float, grad: Any) -> float:
    """Cost of the third differences, which are the jerk; adds to `grad`."""
    total = 0.0
    for i in range(len(q) - 3):
        for k in range(3):
            j = q[i + 3, k] - 3.0 * q[i + 2, k] + 3.0 * q[i + 1, k] - q[i, k]
            total += weight * j * j
            g = 2.0 * weight * j
            grad[i + 3, k] += g
            grad[i + 2, k] -= 3.0 * g
            grad[i + 1, k] += 3.0 * g
            grad[i, k] -= g
    return total


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _nearness(
    q: Any, samples: Any, values: Any, origin: Any, cell: float, keep: float, weight: float, grad: Any
) -> float:
    """Cost of samples of the curve that come closer to obstacles than `keep`; adds to `grad`."""
    total = 0.0
    p = np.empty(3)
    slope = np.empty(3)
    for i in range(len(q) - 3):
        for s in range(len(samples)):
            for k in range(3):
                p[k] = 0.0
                for m in range(4):
                    p[k] += samples[s, m] * q[i + m, k]
            short = keep - _distance(values, origin, cell, p, slope)
            if short <= 0.0:
                continue
            total += weight * short * short / len(samples)
            for k in range(3):
                g = -2.0 * weight * short * slope[k] / len(samples)
                for m in range(4):
                    grad[i + m, k] += samples[s, m] * g
    return total


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _haste(
    q: Any, step: float, speed: float, up: float, down: float, most: float, weight: float, grad: Any
) -> float:
    """Cost of velocity and acceleration control points beyond the limits; adds to `grad`.

    The curve's derivatives lie in the hull of these points, so that the limits hold on the curve as well.
    """
    total = 0.0
    out = np.empty(2)
    for i in range(len(q) - 1):
        vx, vy, vz = (q[i + 1] - q[i]) / step
        over = _beyond(vz, -down, up)
        total += weight * (_excess(vx, vy, speed, out) + over * over)
        for k in range(3):
            g = weight * (out[k] if k < 2 else 2.0 * over) / step
            grad[i + 1, k] += g
            grad[i, k] -= g
    for i in range(len(q) - 2):
        ax, ay, az = (q[i + 2] - 2.0 * q[i + 1] + q[i]) / (step * step)
        over = _beyond(az, -most, most)
        total += weight * (_excess(ax, ay, most, out) + over * over)
        for k in range(3):
            g = weight * (out[k] if k < 2 else 2.0 * over) / (step * step)
            grad[i + 2, k] += g
            grad[i + 1, k] -= 2.0 * g
            grad[i, k] += g
    return total


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def cost(
    q: Any, step: float, samples: Any, values: Any, origin: Any, cell: float, aims: Any
) -> tuple[float, Any]:
    """Cost of control points (n, 3) and its gradient (n, 3).

    Args:
        q: Control points.
        step: Length of an interval.
        samples: (s, 4) basis at the samples of an interval.
        values: (nx, ny, nz) distance field; nz is 1 on land.
        origin: (3,) its lower corner.
        cell: Its cell [m].
        aims: (8,) the fields of `Aims` in order.
    """
    keep, speed, up, down, most, smooth, clear, limits = aims
    grad = np.zeros((len(q), 3))
    total = _roughness(q, smooth, grad)
    total += _nearness(q, samples, values, origin, cell, keep, clear, grad)
    total += _haste(q, step, speed, up, down, most, limits, grad)
    return total, grad


def raised(field: Field2 | Field3) -> tuple[NDArray[np.float32], Array]:
    """Distances (nx, ny, nz) and lower corner (3,) of a field; a flat one becomes one layer at z = 0."""
    if field.distance_m.ndim == 2:
        return field.distance_m[:, :, None], np.append(field.origin_m, -0.5 * field.cell_m)
    return field.distance_m, np.asarray(field.origin_m, float)


def optimised(control_m: Array, step: float, field: Field2 | Field3, aims: Aims) -> Array:
    """Control points (n, 3) moved to lower cost; the first and last three stay."""
    inner = len(control_m) - 6
    if inner <= 0:
        return control_m
    values, origin = raised(field)
    q = np.array(control_m, dtype=float)
    wanted = np.array(
        [
            aims.distance_m,
            aims.speed,
            aims.up,
            aims.down,
            aims.acceleration,
            aims.smooth,
            aims.clear,
            aims.limits,
        ]
    )

    def both(x: Array) -> tuple[float, Array]:
        q[3:-3] = x.reshape(-1, 3)
        total, grad = cost(q, step, WEIGHTS, values, origin, field.cell_m, wanted)
        return total, grad[3:-3].ravel()

    best = minimize(
        both,
        q[3:-3].ravel().copy(),
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": ITERATIONS_MAX, "ftol": 1e-5, "maxcor": 12},
    )
    q[3:-3] = best.x.reshape(-1, 3)
    return q
