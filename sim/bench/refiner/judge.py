"""What must hold of every trajectory that leaves the refiner, judged from the outside.

Nothing of the refiner is used: distances are exact ones to the scene's boxes, motion is differenced from the
trajectory's own samples.
"""

from __future__ import annotations

import numpy as np

from labr_autonomy.config import LandLimits, RobotConfig
from labr_autonomy.types import Array, Mode, SetPoint, Trajectory
from sim.bench.refiner.scenes import CELL_M, Scene

PITCH_S = 0.02  # of the samples
GIVE = (
    0.003  # [m/s, m/s^2, m/s^3, rad/s] of a limit: 0.6 % of the slowest, and less than an estimate can tell
)
HEIGHT_GIVE_M = 0.03  # of the height limits: a robot strays about its trajectory, 4 mm a problem (one sigma)
SPARE_CELLS = 0.4  # of the hard clearance may be lost to the map's interpolation between cells


def faults(trajectory: Trajectory, scene: Scene, config: RobotConfig, hard_m: float) -> list[str]:
    """What is wrong with a trajectory; `touches`, `too near`, `over a limit` or `does not rest`.

    Args:
        trajectory: As it left the refiner.
        scene: Where.
        config: Outline and limits.
        hard_m: Clearance of the centre that the refiner promises.
    """
    land = trajectory.mode is Mode.LAND
    d = 2 if land else 3
    stamps = np.append(np.arange(trajectory.start_s, trajectory.end_s, PITCH_S), trajectory.end_s)
    motion = [trajectory.sample(float(t)) for t in stamps]
    places = np.array([now.position_m[:d] for now in motion])
    gaps = scene.gap_m(places)
    begins = float(gaps[0])
    found = []
    if float(gaps.min()) < min(config.body.radius_m, begins) - 1e-3:
        found.append("touches")
    if float(gaps.min()) < min(hard_m, begins) - SPARE_CELLS * CELL_M[d]:
        found.append("too near")
    if _over_on_land(trajectory, config.land) if land else _over_in_air(trajectory, motion, config):
        found.append("over a limit")
    if abs(trajectory.speed_mps[-1]) > 1e-3 or float(np.linalg.norm(trajectory.velocity_mps[-1])) > 1e-3:
        found.append("does not rest")
    return found


def _over_on_land(t: Trajectory, lim: LandLimits) -> bool:
    """Speeds are straight between nodes."""
    return (
        _most(t.speed_mps) > lim.speed_mps + GIVE
        or _most(-t.speed_mps) > lim.reverse_mps + GIVE
        or _most(np.abs(np.diff(t.speed_mps))) / t.step_s > lim.acceleration_mps2 + GIVE
        or _most(np.abs(t.yaw_rate_rps)) > lim.yaw_rate_rps + GIVE
        or _most(np.abs(np.diff(t.yaw_rate_rps))) / t.step_s > lim.yaw_acceleration_rps2 + GIVE
    )


def _over_in_air(t: Trajectory, motion: list[SetPoint], config: RobotConfig) -> bool:
    air = config.air
    v = np.array([now.velocity_mps for now in motion])
    a = np.array([now.acceleration_mps2 for now in motion])
    z = np.array([now.position_m[2] for now in motion])
    jerk = np.diff(t.acceleration_mps2, axis=0) / t.step_s
    return (
        _most(np.hypot(v[:, 0], v[:, 1])) > air.speed_mps + GIVE
        or _most(v[:, 2]) > air.climb_mps + GIVE
        or _most(-v[:, 2]) > air.descend_mps + GIVE
        or _most(np.hypot(a[:, 0], a[:, 1])) > air.acceleration_mps2 + GIVE
        or _most(np.abs(a[:, 2])) > air.acceleration_mps2 + GIVE
        or _most(np.hypot(jerk[:, 0], jerk[:, 1])) > air.jerk_mps3 + GIVE
        or _most(np.abs(jerk[:, 2])) > air.jerk_mps3 + GIVE
        or _most(np.abs(t.yaw_rate_rps)) > air.yaw_rate_rps + GIVE
        or _most(z) > max(air.height_max_m, z[0]) + HEIGHT_GIVE_M
        or _most(-z) > max(-config.body.below_m, -z[0]) + HEIGHT_GIVE_M
    )


def _most(values: Array) -> float:
    return float(values.max()) if len(values) else 0.0
