"""What must hold of every trajectory that leaves the refiner, judged from the outside.

Nothing of the refiner is used: distances are exact ones to the scene's boxes, motion is differenced from the
trajectory's own samples.
"""

from __future__ import annotations

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.types import Array, Mode, Trajectory
from sim.bench.refiner.scenes import CELL_M, Scene

PITCH_S = 0.02  # of the samples
SHARE = 1.01  # of a limit; a per cent is interpolation
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
    places = np.array([trajectory.sample(float(t)).position_m[:d] for t in stamps])
    gaps = scene.gap_m(places)
    begins = float(gaps[0])
    found = []
    if float(gaps.min()) < min(config.body.radius_m, begins) - 1e-3:
        found.append("touches")
    if float(gaps.min()) < min(hard_m, begins) - SPARE_CELLS * CELL_M[d]:
        found.append("too near")
    if _over(trajectory, config):
        found.append("over a limit")
    if abs(trajectory.speed_mps[-1]) > 1e-3 or float(np.linalg.norm(trajectory.velocity_mps[-1])) > 1e-3:
        found.append("does not rest")
    return found


def _over(t: Trajectory, config: RobotConfig) -> bool:
    if t.mode is Mode.LAND:
        lim = config.land
        return (
            _most(t.speed_mps) > SHARE * lim.speed_mps
            or _most(-t.speed_mps) > SHARE * lim.reverse_mps
            or _most(np.abs(np.diff(t.speed_mps))) > SHARE * lim.acceleration_mps2 * t.step_s
            or _most(np.abs(t.yaw_rate_rps)) > SHARE * lim.yaw_rate_rps
            or _most(np.abs(np.diff(t.yaw_rate_rps))) > SHARE * lim.yaw_acceleration_rps2 * t.step_s
        )
    air = config.air
    v, a = t.velocity_mps, t.acceleration_mps2
    return (
        _most(np.hypot(v[:, 0], v[:, 1])) > SHARE * air.speed_mps
        or _most(v[:, 2]) > SHARE * air.climb_mps
        or _most(-v[:, 2]) > SHARE * air.descend_mps
        or _most(np.hypot(a[:, 0], a[:, 1])) > SHARE * air.acceleration_mps2
        or _most(np.abs(a[:, 2])) > SHARE * air.acceleration_mps2
        or _most(np.hypot(*np.diff(a[:, :2], axis=0).T)) > SHARE * air.jerk_mps3 * t.step_s
        or _most(np.abs(t.yaw_rate_rps)) > SHARE * air.yaw_rate_rps
    )


def _most(values: Array) -> float:
    return float(values.max()) if len(values) else 0.0
