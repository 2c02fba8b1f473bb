"""P_land, P_air and the energy of a transition from measured power, by least squares. Pure functions.

On wheels the power is `idle + (fixed + per_speed * s) * [s > 0] + push * max(s ds/dt, 0)`, s the wheels'
mean speed; P_land is its value at the speed that the planner reckons with. Moments at which the wheels begin
or cease to turn are left out. In the air it is `hover + up * max(v_z, 0) + down * max(-v_z, 0)`; P_air is the
hover's. A transition is one take-off and one landing, every joule between rolling and flying but for those of
the height gained, which `EnergyModel.air_j` counts.

Errors are standard errors. Power is sampled ten times a second and what the model leaves over lasts longer
than that, so they are Newey and West's (Econometrica 55, 1987), which hold for samples that resemble their
neighbours, widened where the flights hold only a few times that memory. They tell the scatter, not what a
slope, a wet floor or an uncalibrated sensor does to all samples alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.modes.energy import CLIMB_EFFICIENCY, GRAVITY_MPS2
from labr_autonomy.modes.transition import Phase
from labr_autonomy.types import Array

ROLLING_MPS = 0.03  # slower wheels stand
GAP_S = 1.0  # a longer silence of the log ends a stretch
MEMORY_S = 3.0  # how long the model's residuals resemble each other
SAMPLES_MIN = 20  # fewer say nothing
_LAND = (Phase.DRIVING, Phase.STOPPING)
_UP = (Phase.ARMING, Phase.LIFTING)
_DOWN = (Phase.DESCENDING, Phase.SETTLING, Phase.DISARMING)


@dataclass(frozen=True, slots=True)
class Samples:
    """One flight's telemetry at the same instants."""

    stamp_s: Array  # (n,) rising
    power_w: Array  # (n,) at the battery's terminals
    phase: tuple[Phase | None, ...]  # (n,) of the hand-over; None where it is not known
    wheel_mps: Array  # (n,) mean speed of the wheels over the floor, without sign
    climb_mps: Array  # (n,) upward
    height_m: Array  # (n,) of the body, odom

    def among(self, phases: Sequence[Phase]) -> NDArray[np.bool_]:
        """Which samples belong to some phases, (n,)."""
        return np.array([phase in phases for phase in self.phase], dtype=bool)


@dataclass(frozen=True, slots=True)
class Figure:
    """A fitted value; its standard error is None where one measurement cannot tell it."""

    value: float
    error: float | None
    samples: int  # or hand-overs


@dataclass(frozen=True, slots=True)
class EnergyFit:
    """What flights say of the energy settings; None for what they do not tell."""

    idle_w: Figure | None
    land_w: Figure | None  # at the planner's speed
    air_w: Figure | None
    transition_j: Figure | None
    land_speed_mps: float  # at which `land_w` holds
    rolled_mps: tuple[float, float] | None  # 5th and 95th percentile of the speeds that were driven

    @property
    def transition_s(self) -> Figure | None:
        """The same as the time in which the rotors would use it up, as robot.yaml has it."""
        j, air = self.transition_j, self.air_w
        if j is None or air is None:
            return None
        error = None
        if j.error is not None and air.error is not None:
            error = j.value / air.value * math.hypot(j.error / j.value, air.error / air.value)
        return Figure(j.value / air.value, error, j.samples)


def fit_energy(flights: Sequence[Samples], *, land_speed_mps: float, mass_kg: float) -> EnergyFit:
    """Fit everything that the flights tell.

    Args:
        flights: Telemetry, each flight by itself.
        land_speed_mps: The speed at which the planner reckons with `land_w`.
        mass_kg: For the energy of the height gained.
    """
    idle = land = rolled = None
    parts = [_land_part(f) for f in flights]
    speeds = np.concatenate([part.columns[:, 2] for part in parts])
    driven = speeds[speeds > 0.0]
    stood = len(speeds) - len(driven)
    if max(stood, len(driven)) >= SAMPLES_MIN:
        value, spread = _least_squares(parts)
        if stood >= SAMPLES_MIN:
            idle = _combined(value, spread, [1.0, 0.0, 0.0, 0.0], stood)
        if len(driven) >= SAMPLES_MIN:
            land = _combined(value, spread, [1.0, 1.0, land_speed_mps, 0.0], len(driven))
            rolled = (float(np.percentile(driven, 5)), float(np.percentile(driven, 95)))
    air = None
    parts = [_air_part(f) for f in flights]
    flown = sum(len(part.power_w) for part in parts)
    if flown >= SAMPLES_MIN:
        air = _combined(*_least_squares(parts), [1.0, 0.0, 0.0], flown)
    return EnergyFit(idle, land, air, _transition(flights, mass_kg), land_speed_mps, rolled)


@dataclass(frozen=True, slots=True)
class _Part:
    """One flight's share of a regression."""

    columns: Array  # (n, k)
    power_w: Array  # (n,)
    memory: int  # samples over which residuals resemble each other


def _part(f: Samples, columns: Array, chosen: NDArray[np.bool_]) -> _Part:
    chosen = chosen & np.isfinite(f.power_w)
    step_s = float(np.median(np.diff(f.stamp_s))) if len(f.stamp_s) > 1 else MEMORY_S
    return _Part(columns[chosen], f.power_w[chosen], max(1, round(MEMORY_S / max(step_s, 1e-3))))


def _land_part(f: Samples) -> _Part:
    """Columns 1, rolling, speed, power of the push; while on wheels."""
    speed = np.where(f.wheel_mps > ROLLING_MPS, f.wheel_mps, 0.0)
    gain = np.gradient(speed, f.stamp_s) if len(speed) > 1 else np.zeros(len(speed))
    push = np.maximum(speed * gain, 0.0)
    columns = np.column_stack([np.ones(len(speed)), speed > 0.0, speed, push])
    changes = np.diff((speed > 0.0).astype(int)) != 0
    beside = np.convolve(np.concatenate([changes, [False]]), [1, 1, 1])[: len(speed)] > 0
    return _part(f, columns, f.among(_LAND) & ~beside)


def _air_part(f: Samples) -> _Part:
    """Columns 1, rate of climb, rate of descent; while flying."""
    up = f.climb_mps
    columns = np.column_stack([np.ones(len(up)), np.maximum(up, 0.0), np.maximum(-up, 0.0)])
    return _part(f, columns, f.among((Phase.FLYING,)))


def _least_squares(parts: Sequence[_Part]) -> tuple[Array, Array]:
    """Coefficients (k,) and their covariance (k, k), over flights whose residuals do not touch each other."""
    x = np.concatenate([part.columns for part in parts])
    y = np.concatenate([part.power_w for part in parts])
    inverse = np.linalg.pinv(x.T @ x)
    value = inverse @ x.T @ y
    middle = np.zeros((x.shape[1], x.shape[1]))
    for part in parts:
        left = part.power_w - part.columns @ value
        middle += _newey_west(part.columns * left[:, None], part.memory)
    stretches = sum(len(part.power_w) / part.memory for part in parts)  # that know nothing of each other
    few = max(1.0, stretches / max(stretches - x.shape[1], 1.0))
    return value, inverse @ middle @ inverse * few


def _newey_west(scores: Array, memory: int) -> Array:
    """Long-run sum of squares of scores (n, k), with Bartlett's weights."""
    lags = min(memory, len(scores) - 1)
    out: Array = scores.T @ scores
    for lag in range(1, lags + 1):
        beside = scores[lag:].T @ scores[:-lag]
        out += (1.0 - lag / (lags + 1)) * (beside + beside.T)
    return out


def _combined(value: Array, spread: Array, weights: Sequence[float], samples: int) -> Figure:
    w = np.array(weights)
    return Figure(float(w @ value), math.sqrt(max(float(w @ spread @ w), 0.0)), samples)


def _transition(flights: Sequence[Samples], mass_kg: float) -> Figure | None:
    """Joules of a take-off and a landing together."""
    lift_j = mass_kg * GRAVITY_MPS2 / CLIMB_EFFICIENCY
    ups, downs = [], []
    for f in flights:
        for first, last in _runs(f, _UP):
            if f.phase[last] is Phase.FLYING:
                gained = max(float(f.height_m[last] - f.height_m[first]), 0.0)
                ups.append(_joules(f, first, last) - lift_j * gained)
        for first, last in _runs(f, _DOWN):
            flown = first > 0 and f.phase[first - 1] is Phase.FLYING  # not a take-off that was called off
            if flown and f.phase[last] is Phase.DRIVING:
                downs.append(_joules(f, first, last))
    if not ups or not downs:
        return None
    error = None
    if len(ups) > 1 and len(downs) > 1:
        error = math.sqrt(float(np.var(ups, ddof=1) / len(ups) + np.var(downs, ddof=1) / len(downs)))
    return Figure(float(np.mean(ups) + np.mean(downs)), error, min(len(ups), len(downs)))


def _runs(f: Samples, phases: Sequence[Phase]) -> list[tuple[int, int]]:
    """First sample of each unbroken stretch of some phases, and the first one after it."""
    inside = np.concatenate([[False], f.among(phases), [False]])
    begins = np.flatnonzero(inside[1:] & ~inside[:-1])
    ends = np.flatnonzero(~inside[1:] & inside[:-1])
    whole = []
    for first, last in zip(begins.tolist(), ends.tolist(), strict=True):
        if last < len(f.stamp_s) and np.diff(f.stamp_s[first : last + 1]).max() < GAP_S:
            whole.append((first, last))
    return whole


def _joules(f: Samples, first: int, last: int) -> float:
    part = slice(first, last + 1)
    return float(np.trapezoid(f.power_w[part], f.stamp_s[part]))
