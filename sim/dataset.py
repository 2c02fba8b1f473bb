"""Training data for GKPN: noisy depth views of generated worlds, poses and goals (`python -m sim.dataset`).

The file is an .npz with the arrays of `labr_autonomy.gkpn.dataset.Views`. Images are cast directly at the
network's size (160x90 for GKPN), with intrinsics as if the robot's image had been resized to it.
"""

from __future__ import annotations

import argparse
import logging
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import quaternion_from_rpy, rotation_matrix
from labr_autonomy.types import Array, Image
from sim.worlds.primitives import Scene
from sim.worlds.solids import Rng, generate_scene

WIDTH, HEIGHT = 160, 90  # of the images unless said otherwise [px]
BASELINE_M = 0.05  # D435i stereo baseline, D400 series datasheet
START_CLEAR_M, GOAL_CLEAR_M = 0.38, 0.42  # free distance about a robot's and a goal's place
BLOCKED_M = 0.32  # a straight line that comes closer than this to a solid counts as blocked
SHARES = {"hall": 0.46, "forest": 0.1, "boxes": 0.12, "walls": 0.12, "mixed": 0.12, "barrier": 0.08}
MAX_ROWS = 96

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class DataConfig:
    """How much data, and from which seed."""

    scenes: int = 600
    views: int = 24  # of each scene
    goals: int = 12  # of each view; about half with a blocked straight line
    seed: int = 1
    airborne: float = 0.3  # share of views from the air
    air_goals: bool = True  # half of the goals in the air; else all on land
    width: int = WIDTH
    height: int = HEIGHT


def land_only(config: DataConfig) -> DataConfig:
    """The same for a network that only drives: no view from the air, no goal in it."""
    return replace(config, airborne=0.0, air_goals=False)


def ray_grid(robot: RobotConfig, width: int, height: int) -> NDArray[np.float32]:
    """Directions (h*w, 3), camera-FLU, x = 1, so that the ray parameter is the depth along the axis."""
    camera = robot.camera
    fx, fy = camera.fx * width / camera.width, camera.fy * height / camera.height
    cx, cy = camera.cx * width / camera.width, camera.cy * height / camera.height
    v, u = np.meshgrid(np.arange(height) + 0.5, np.arange(width) + 0.5, indexing="ij")
    return (
        np.stack([np.ones_like(u), (cx - u) / fx, (cy - v) / fy], axis=-1).reshape(-1, 3).astype(np.float32)
    )


class Caster:
    """Depth images (height, width) of one scene."""

    def __init__(self, scene: Scene, robot: RobotConfig, width: int = WIDTH, height: int = HEIGHT) -> None:
        world = scene.world("view", {}, (30.0, 30.0))
        self._scene = rtcore_scene.EmbreeScene()
        TriangleMesh(self._scene, world.vertices_m, world.faces)
        self._rays = ray_grid(robot, width, height)
        self._shape = (height, width)
        self._camera = robot.camera

    def depth(self, position_m: Array, rpy_rad: Array) -> Image:
        """Noise-free depth (h, w) [m] from a body pose; beyond the camera's range 0."""
        turn = rotation_matrix(quaternion_from_rpy(*rpy_rad))
        eye = position_m + turn @ np.array([self._camera.x_m, 0.0, self._camera.z_m])
        rays = np.ascontiguousarray(self._rays @ turn.T.astype(np.float32))
        origins = np.tile(eye.astype(np.float32), (len(rays), 1))
        depth = self._scene.run(origins, rays, query="DISTANCE").astype(np.float32)
        depth[depth > self._camera.range_max_m] = 0.0
        image: Image = depth.reshape(self._shape)
        return image


def degrade(depth_m: Image, robot: RobotConfig, rng: Rng) -> Image:
    """A D435i's view of a perfect depth image: quadratic noise, stereo shadows, holes, range limits."""
    h, w = depth_m.shape
    camera = robot.camera
    disparity = np.where(
        depth_m > 0, camera.fx * w / camera.width * BASELINE_M / np.maximum(depth_m, 0.05), 0.0
    )
    arrival = np.arange(w) - disparity  # column in the right imager
    nearest_right = np.minimum.accumulate(arrival[:, ::-1], axis=1)[:, ::-1]
    seen = nearest_right > arrival - 0.5  # else a nearer surface hides the point from the right imager
    coarse = cv2.resize(rng.standard_normal((h // 4, w // 4)).astype(np.float32), (w, h))
    noise = 0.6 * coarse + 0.6 * rng.standard_normal((h, w), dtype=np.float32)
    noisy = depth_m + noise * (0.002 + rng.uniform(0.001, 0.003) * depth_m**2)
    blobs = cv2.resize(rng.random((h // 6, w // 6), dtype=np.float32), (w, h))
    lost = blobs < rng.uniform(0.0, 0.16)
    lost |= rng.random((h, w), dtype=np.float32) < np.clip(0.05 * (depth_m - 5.0), 0.0, 0.3)
    keep = seen & ~lost & (depth_m > camera.range_min_m) & (noisy > camera.range_min_m)
    keep &= noisy < camera.range_max_m
    return np.where(keep, noisy, 0.0).astype(np.float32)


def _start(
    scene: Scene, size_m: tuple[float, float], robot: RobotConfig, airborne: bool, rng: Rng
) -> Array | None:
    """A free pose (6,): x, y, z, yaw, roll, pitch of the body in odom; None if the dice find none."""
    for _ in range(60):
        x, y = (rng.uniform(-0.5, 0.5) * (s - 0.8) for s in size_m)
        z = rng.uniform(0.5, 2.2) if airborne else robot.body.below_m
        if scene.distance(np.array([x, y, z])) > START_CLEAR_M:
            tilt = math.radians(12.0 if airborne else 3.0)
            roll, pitch = rng.uniform(-tilt, tilt, 2)
            return np.array([x, y, z, rng.uniform(-math.pi, math.pi), roll, pitch])
    return None


def _goals(
    scene: Scene, size_m: tuple[float, float], pose: Array, config: DataConfig, robot: RobotConfig, rng: Rng
) -> Array | None:
    """Free goals (goals, 3) in the level frame, those on land first; None if there are too few."""
    tries = 128
    on_land = tries // 2 if config.air_goals else tries
    air = np.arange(tries) >= on_land
    r = rng.uniform(1.0, 9.0, tries)
    half_view = math.atan(robot.camera.cx / robot.camera.fx)
    bearing = np.where(rng.random(tries) < 0.85, 1.0, 1.7) * rng.uniform(-half_view, half_view, tries)
    floor = robot.body.below_m
    z = np.where(air, rng.uniform(floor + 0.4, 3.0, tries), floor) - pose[2]
    level = np.stack([r * np.cos(bearing), r * np.sin(bearing), z], axis=1)
    c, s = math.cos(pose[3]), math.sin(pose[3])
    odom = level @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + pose[:3]
    ok = (np.abs(odom[:, :2]) < np.array(size_m) / 2.0 - 0.4).all(axis=1)
    ok[ok] = scene.distance(odom[ok]) > GOAL_CLEAR_M
    kinds = [~air, air] if config.air_goals else [~air]
    if min((ok & kind).sum() for kind in kinds) < 2:
        return None
    t = np.linspace(0.05, 1.0, 20)[:, None]
    line = pose[:3] + t * (odom[ok][:, None] - pose[:3])
    blocked = np.zeros(tries, dtype=bool)
    blocked[ok] = scene.distance(line).min(axis=1) < BLOCKED_M
    chosen, each = [], config.goals // len(kinds)
    for kind in kinds:
        group = ok & kind
        hard, easy = np.flatnonzero(group & blocked), np.flatnonzero(group & ~blocked)
        for i in range(each):
            pool = hard if (i % 2 == 0 and len(hard)) or not len(easy) else easy
            chosen.append(rng.choice(pool))
    goals = level[chosen]
    goals[:each, 2] -= rng.uniform(0.0, 0.05, each)  # a land goal's height is not exact
    return goals


def build(config: DataConfig, robot: RobotConfig) -> dict[str, Any]:
    """The arrays of one data set (see `labr_autonomy.gkpn.dataset.Views`)."""
    n = config.scenes * config.views
    images = np.zeros((n, config.height, config.width), dtype=np.float16)
    poses, goals = np.zeros((n, 6), np.float32), np.zeros((n, config.goals, 3), np.float32)
    scene_of, family_of = np.zeros(n, np.int32), []
    solids = np.zeros((config.scenes, MAX_ROWS, 8), np.float32)
    solids[..., 1:4], solids[..., 4:7] = 1e3, 0.1  # rows without a solid lie far away
    names = list(SHARES)
    for k in range(config.scenes):
        rng = np.random.default_rng([config.seed, k])
        family = names[rng.choice(len(names), p=list(SHARES.values()))]
        size = (float(rng.uniform(9, 17)), float(rng.uniform(8, 13)))
        scene = generate_scene(family, int(rng.integers(1 << 31)), size, np.zeros((0, 3)))
        scene = Scene(scene.rows[:MAX_ROWS])
        solids[k, : len(scene.rows)] = scene.rows
        family_of.append(family)
        caster, done = Caster(scene, robot, config.width, config.height), 0
        while done < config.views:
            pose = _start(scene, size, robot, rng.random() < config.airborne, rng)
            found = None if pose is None else _goals(scene, size, pose, config, robot, rng)
            if pose is None or found is None:
                continue
            i = k * config.views + done
            clean = caster.depth(pose[:3], pose[[4, 5, 3]])
            images[i], poses[i], goals[i], scene_of[i] = degrade(clean, robot, rng), pose, found, k
            done += 1
        if k % 50 == 0:
            log.info("scene %d of %d", k, config.scenes)
    return {
        "images_m": images,
        "poses": poses,
        "goals_m": goals,
        "scene": scene_of,
        "solids": solids,
        "families": np.array(family_of),
        "seeds": np.array([config.seed]),
    }


def main() -> None:
    """Write one data set."""
    standard = DataConfig()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, help="file to write (.npz)")
    parser.add_argument("--scenes", type=int, default=standard.scenes)
    parser.add_argument("--views", type=int, default=standard.views)
    parser.add_argument("--seed", type=int, default=standard.seed)
    parser.add_argument("--size", type=int, nargs=2, default=(standard.width, standard.height), help="[px]")
    parser.add_argument("--land", action="store_true", help="views and goals on land only")
    a = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    config = DataConfig(scenes=a.scenes, views=a.views, seed=a.seed, width=a.size[0], height=a.size[1])
    config = land_only(config) if a.land else config
    np.savez(a.out, **build(config, RobotConfig()))


if __name__ == "__main__":
    main()
