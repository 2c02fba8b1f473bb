"""Where to leave the floor for a goal in the air: the two layers of a search, joined by the energy of each.

A way drives until driving on costs more joules than it saves: its end is the place whose drive there and
flight from there are cheapest together. Both layers are the map's; what is unknown may be crossed in both,
at the same factor.
"""

from __future__ import annotations

import numpy as np

from labr_autonomy.modes.energy import EnergyModel
from labr_autonomy.perception.fields import Field2
from labr_autonomy.planner.refusals import Refusals
from labr_autonomy.refine.search import CostToGo
from labr_autonomy.types import Array

SPARE_M = 0.1  # beside a place, as the robot stops next to it; without, it had better drive ...
SPARE_COST_M = 1.0  # ... so much farther
NEAR_GOAL_M = 6.0  # take-off places are looked for as far as this from below the goal


def offers_by_air(
    land: Field2,
    air: CostToGo,
    column: Field2,
    radius_m: float,
    goal_m: Array,
    energy: EnergyModel,
    refused: Refusals,
) -> Array:
    """What it costs to fly to the goal from each cell of the driving plan, (nx, ny) [m of driving].

    Args:
        land: The driving plan.
        air: Ways through the air to the goal, at its height.
        column: Distance to what stands in the way of a take-off.
        radius_m: Free radius that a take-off needs.
        goal_m: (2|3,) odom.
        energy: What a metre costs in each mode.
        refused: Where it stood and had no room after all.

    Returns:
        inf where the robot would not fit in the air or could not take off, and far from below the goal.
    """
    offers = np.full(land.distance_m.shape, np.inf)
    worth = energy.metre_in_air()
    at = (np.asarray(goal_m[:2], float) - land.origin_m) / land.cell_m
    reach = NEAR_GOAL_M / land.cell_m
    low = np.clip(np.floor(at - reach).astype(int), 0, offers.shape)
    high = np.clip(np.ceil(at + reach).astype(int), low, offers.shape)
    i, j = np.mgrid[low[0] : high[0], low[1] : high[1]]
    centres = land.origin_m + (np.stack([i.ravel(), j.ravel()], axis=1) + 0.5) * land.cell_m
    spare_m = column.lookup(centres) - radius_m
    fits = (np.hypot(*(centres - goal_m[:2]).T) <= NEAR_GOAL_M) & (spare_m > 0.0) & ~refused.among(centres)
    costs = worth * air.costs_at(centres) + np.where(spare_m > SPARE_M, 0.0, SPARE_COST_M)
    costs = np.where(fits, costs, np.inf)
    offers[low[0] : high[0], low[1] : high[1]] = costs.reshape(i.shape)
    return offers
