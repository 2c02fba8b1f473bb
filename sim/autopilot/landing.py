"""Where PX4's land mode wants to be: straight down, fast while high, at a crawl near the ground. Pure."""

from __future__ import annotations

import math

from sim.autopilot.controller import Target
from sim.autopilot.estimator import Estimate
from sim.autopilot.vectors import Vector

SPEED_MPS = 0.7  # MPC_LAND_SPEED
CRAWL_MPS = 0.35  # MPC_LAND_CRWL, and what the recordings show below 0.55 m
SLOW_FROM_M = 0.8
CRAWL_FROM_M = 0.55
SLOPE = 1.4  # how fast the speed is built up [m/s^2], from the recordings
TICK_S = 0.004


def landing_target(now: Estimate, start: Vector, home_down_m: float, last: Target) -> Target:
    """Target of one tick in land mode.

    Args:
        now: The estimate.
        start: (3,) where the descent began; held horizontally.
        home_down_m: Down coordinate of the place it armed at [m]; without a rangefinder that is the ground.
        last: The target of the tick before, whose sinking speed is changed no faster than `SLOPE`.
    """
    height_m = home_down_m - now.position_m[2]
    if math.isfinite(height_m):
        share = min(1.0, max(0.0, (height_m - CRAWL_FROM_M) / (SLOW_FROM_M - CRAWL_FROM_M)))
        wanted_mps = CRAWL_MPS + share * (SPEED_MPS - CRAWL_MPS)
    else:
        wanted_mps = CRAWL_MPS
    before_mps = last.velocity_mps[2] if math.isfinite(last.velocity_mps[2]) else 0.0
    down_mps = min(wanted_mps, max(0.0, before_mps) + SLOPE * TICK_S)
    hold = now.position_valid and math.isfinite(start[0])
    position = (start[0], start[1], math.nan) if hold else (math.nan, math.nan, math.nan)
    return Target(position_m=position, velocity_mps=(0.0, 0.0, down_mps), yaw_rad=last.yaw_rad)
