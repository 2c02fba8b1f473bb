"""Figures over many trials, with their intervals. Pure functions of arrays.

Intervals are 95 % bootstrap percentile intervals (Efron and Tibshirani, An Introduction to the Bootstrap,
chapter 13), seeded, so that the same trials give the same interval. Where all trials or none have succeeded
every resample is the same; there Wilson's score interval (JASA 22, 1927) takes over.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.types import Array

RESAMPLES = 2000
LEVEL = 0.95
_Z = 1.959963984540054  # 97.5 % quantile of the normal distribution
_CELLS_MAX = 4_000_000  # resampled values at once

Interval = tuple[float, float]


def mean(values: Sequence[float] | Array) -> float | None:
    """Mean, or None of nothing."""
    array = np.asarray(values, dtype=np.float64)
    return float(array.mean()) if array.size else None


def bootstrap_mean(values: Sequence[float] | Array, seed: int) -> Interval | None:
    """95 % interval of the mean of (n,) values; None for fewer than two."""
    array = np.asarray(values, dtype=np.float64)
    if array.size < 2:
        return None
    rng = np.random.default_rng([seed, array.size])
    means = np.empty(RESAMPLES)
    step = max(1, _CELLS_MAX // array.size)
    for first in range(0, RESAMPLES, step):
        part = means[first : first + step]
        part[:] = array[rng.integers(0, array.size, (part.size, array.size))].mean(axis=1)
    low, high = np.quantile(means, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0])
    return float(low), float(high)


def bootstrap_crossed(groups: Sequence[Array], weights: Sequence[float], seed: int) -> Interval | None:
    """95 % interval of a weighted sum of means over groups that met the same cases; None for fewer than two.

    Each resample draws cases for all groups together, so that they stay paired, and the members of each group
    on their own: chance is in the cases and in the members, such as trainings of one network.

    Args:
        groups: Each (members, n), a column for each case.
        weights: Of the groups' means; 1 and -1 for a difference.
        seed: Of the resamples.
    """
    cases = groups[0].shape[1]
    if cases < 2:
        return None
    rng = np.random.default_rng([seed, cases, len(groups)])
    sums = np.zeros(RESAMPLES)
    for i in range(RESAMPLES):
        drawn = rng.integers(0, cases, cases)
        for group, weight in zip(groups, weights, strict=True):
            members = rng.integers(0, len(group), len(group))
            sums[i] += weight * group[members][:, drawn].mean()
    low, high = np.quantile(sums, [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0])
    return float(low), float(high)


def share_pct(flags: Sequence[bool] | NDArray[np.bool_]) -> float | None:
    """Share of True [%], or None of nothing."""
    value = mean(np.asarray(flags, dtype=np.float64))
    return None if value is None else 100.0 * value


def share_interval_pct(flags: Sequence[bool] | NDArray[np.bool_], seed: int) -> Interval | None:
    """95 % interval of a share [%]: bootstrap, or Wilson's where all flags are the same; None of nothing."""
    array = np.asarray(flags, dtype=np.float64)
    if array.size == 0:
        return None
    if array.min() == array.max():
        low, high = wilson(int(array.sum()), array.size)
        return 100.0 * low, 100.0 * high
    found = bootstrap_mean(array, seed)
    assert found is not None  # two different flags are two values
    return 100.0 * found[0], 100.0 * found[1]


def wilson(successes: int, count: int) -> Interval:
    """Wilson's 95 % score interval of a probability."""
    p, z2 = successes / count, _Z * _Z
    centre = p + z2 / (2 * count)
    half = _Z * math.sqrt(p * (1.0 - p) / count + z2 / (4 * count * count))
    scale = 1.0 + z2 / count
    return max(0.0, (centre - half) / scale), min(1.0, (centre + half) / scale)


def path_efficiency(
    reached: Sequence[bool] | NDArray[np.bool_],
    shortest_m: Sequence[float] | Array,
    travelled_m: Sequence[float] | Array,
) -> Array:
    """Success weighted by path length of each trial (Anderson et al., arXiv 1807.06757, section 4).

    Args:
        reached: (n,) whether the goal was reached.
        shortest_m: (n,) shortest way there.
        travelled_m: (n,) way taken, on land and in the air together.

    Returns:
        (n,) in 0..1; its mean is the SPL.
    """
    shortest = np.asarray(shortest_m, dtype=np.float64)
    longest = np.maximum(shortest, np.asarray(travelled_m, dtype=np.float64))
    ratio = np.divide(shortest, longest, out=np.ones_like(shortest), where=longest > 0.0)
    efficiency: Array = np.where(np.asarray(reached, dtype=bool), ratio, 0.0)
    return efficiency
