"""The dense check of the limits: what a plan may do on its way, told in a sentence where it does more.

A start may be beyond a limit already, or moving so that no control can keep it. From there a plan may do what
braking does (`AirModel.brake`, `LandModel.brake`) and nothing worse, at each instant: once braking has come
back within a limit, the limit holds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from labr_autonomy.refine.problem import TOLERANCE
from labr_autonomy.types import Array

# Of m/s, m/s^2, m/s^3 and the rates: the re-simulated plan's tolerance, and as much for the braking that it
# is compared with. Of the limits that ship, the smallest are 0.2 m/s backwards and 0.5 m/s down.
GIVE = 2.0 * TOLERANCE
GIVE_M = 0.005  # of heights: a h^2 / 8 = 3 mm of a bend between nodes, which the solver does not see


@dataclass(frozen=True, slots=True)
class Limit:
    """One quantity of a plan along its way."""

    does: str  # "descends at {:.2f} m/s"
    values: Array  # (n,) of the plan
    most: float
    braking: Array  # (m,) the same while braking from the same start, on the same stamps; its last one stays
    give: float = GIVE


def worst(limits: tuple[Limit, ...]) -> str:
    """The first limit that a plan breaks, as a sentence with figures; "" where it keeps them all."""
    for limit in limits:
        rest = max(0, len(limit.values) - len(limit.braking))
        braking = np.append(limit.braking, np.full(rest, limit.braking[-1]))[: len(limit.values)]
        allowed = np.maximum(limit.most, braking)
        over = limit.values - allowed
        k = int(over.argmax())
        if not over[k] <= limit.give:  # a number that is none is over, too
            return f"{limit.does.format(limit.values[k])}, {allowed[k]:.3f} at most"
    return ""
