"""Is this processor quick enough? One planning cycle, timed as a flight computes it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from labr_autonomy.clock import SystemClock
from labr_autonomy.config import RobotConfig
from labr_autonomy.doctor.finding import Finding, failed, good, wrong
from labr_autonomy.errors import LabrError
from labr_autonomy.planner.messages import Motion, PlanRequest
from labr_autonomy.types import Array, DepthFrame, Image, Mode, Pose

if TYPE_CHECKING:
    from labr_autonomy.planner.pipeline import Pipeline

AREA = "cpu"
BUDGET_S = 0.1  # a plan every 0.1 s
CYCLES = 15
SETTLE = 3  # the first cycles fill caches and the map


def examine_cpu(config: RobotConfig) -> list[Finding]:
    """Plan on land and in the air with an image of a room with pillars."""
    from labr_autonomy.planner.pipeline import Pipeline

    try:
        pipeline = Pipeline(config)
    except LabrError as error:
        return [failed(AREA, "planner", error)]
    found = []
    for mode, z_m in ((Mode.LAND, config.body.below_m), (Mode.AIR, 1.2)):
        times_s = [_cycle(pipeline, config, mode, z_m, k) for k in range(CYCLES)][SETTLE:]
        middle, worst = float(np.median(times_s)), max(times_s)
        name = f"planning, {mode.value}"
        text = f"{1e3 * middle:.0f} ms a cycle, worst {1e3 * worst:.0f}, of {1e3 * BUDGET_S:.0f} ms"
        if middle > BUDGET_S:
            do = "End other programs, set the governor to performance, or fly slower."
            found.append(wrong(AREA, name, text, do))
        else:
            found.append(good(AREA, name, text))
    return found


def _cycle(pipeline: Pipeline, config: RobotConfig, mode: Mode, z_m: float, k: int) -> float:
    clock, zero = SystemClock(), np.zeros(3)
    here: Array = np.array([0.02 * k, 0.0, z_m])
    pose = Pose(here, np.array([1.0, 0.0, 0.0, 0.0]))
    now_s = 100.0 + 0.1 * k
    request = PlanRequest(
        sequence=k + 1,
        frame_sequence=k + 1,
        frame_pose=pose,
        body_pose=pose,
        start_s=now_s + 0.08,
        motion=Motion(here, zero, zero, 0.0, 0.0, 0.0),
        mode=mode,
        goal_m=np.array([4.0, 1.0, 1.2 if mode is Mode.AIR else config.body.below_m]),
        goal_in_air=mode is Mode.AIR,
        floor_z_m=0.0,
        lift_to_m=1.2,
    )
    frame = DepthFrame(k + 1, now_s, _room(config, z_m), config.camera.intrinsics)
    begun_s = clock.now_s()
    pipeline.cycle(request, frame)
    return clock.now_s() - begun_s


def _room(config: RobotConfig, z_m: float) -> Image:
    """A floor, a wall 5 m ahead and three pillars, as the camera would see them."""
    i = config.camera.intrinsics
    rows = (np.arange(i.height) - i.cy)[:, None] / i.fy
    columns = (np.arange(i.width) - i.cx)[None, :] / i.fx
    eye_m = z_m + config.camera.z_m
    floor = np.where(rows > 1e-3, eye_m / np.maximum(rows, 1e-3), np.inf)
    depth = np.minimum(np.broadcast_to(floor, (i.height, i.width)), 5.0)
    for ahead_m, left_m in ((2.0, 0.6), (2.6, -0.8), (3.4, 0.1)):
        pillar = np.abs(columns + left_m / ahead_m) < 0.15 / ahead_m
        depth = np.where(pillar & (depth > ahead_m), ahead_m, depth)
    image: Image = depth.astype(np.float32)
    return image
