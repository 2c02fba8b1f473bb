"""How much mu can be trusted: as a ranking, as a probability, and mended afterwards where it cannot."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

BINS = 15


def auc(score: NDArray[Any], label: NDArray[np.bool_]) -> float | None:
    """Area under the ROC curve by ranks; None if it is undefined (one class, or one score for all)."""
    positive = int(label.sum())
    negative = len(label) - positive
    if not positive or not negative or np.ptp(score) == 0.0:
        return None
    _, place, counts = np.unique(score, return_inverse=True, return_counts=True)
    middle = np.cumsum(counts) - 0.5 * (counts - 1)  # mean rank of equal scores
    rank = middle[place.reshape(-1)]
    area = float((rank[label].sum() - positive * (positive + 1) / 2) / (positive * negative))
    return round(area, 4)


def reliability(mu: NDArray[Any], hit: NDArray[np.bool_]) -> list[dict[str, float]]:
    """The reliability diagram: for each bin of mu how many paths, their mean mu and how many collide."""
    number = np.minimum((np.asarray(mu, float) * BINS).astype(int), BINS - 1)
    rows = []
    for k in range(BINS):
        there = number == k
        if there.any():
            mean, share = float(np.mean(mu[there])), float(np.mean(hit[there]))
            rows.append({"paths": int(there.sum()), "mu": round(mean, 4), "collide": round(share, 4)})
    return rows


def calibration_error(mu: NDArray[Any], hit: NDArray[np.bool_]) -> float:
    """Expected calibration error: mean distance between mu and what happens, over the bins' paths."""
    rows = reliability(mu, hit)
    total = sum(row["paths"] for row in rows)
    return round(sum(row["paths"] * abs(row["mu"] - row["collide"]) for row in rows) / max(total, 1), 4)


def platt(logit: NDArray[Any], hit: NDArray[np.bool_]) -> tuple[float, float]:
    """Scale and shift of the logit that make mu a probability (Platt, 1999), by maximum likelihood.

    The scale stays positive, so that the ranking is kept; the identity where only one outcome occurs.
    """
    if hit.all() or not hit.any():
        return 1.0, 0.0
    x, y = np.asarray(logit, float), hit.astype(float)

    def unlikely(parameters: NDArray[Any]) -> tuple[float, NDArray[Any]]:
        scale = math.exp(parameters[0])
        z = scale * x + parameters[1]
        p = 1.0 / (1.0 + np.exp(-np.clip(z, -60.0, 60.0)))
        loss = float(np.mean(np.logaddexp(0.0, z) - y * z))
        return loss, np.array([np.mean((p - y) * scale * x), np.mean(p - y)])

    found = minimize(unlikely, np.zeros(2), jac=True, method="L-BFGS-B", bounds=[(-3.0, 3.0), (-10.0, 10.0)])
    return math.exp(float(found.x[0])), float(found.x[1])
