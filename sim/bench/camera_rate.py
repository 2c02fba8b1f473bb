"""How quickly the depth camera takes pictures in given worlds, ideal image and flaws together."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypedDict

import numpy as np

from labr_autonomy.clock import SystemClock
from labr_autonomy.config import Camera
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.types import Pose
from sim.camera.process import Eye
from sim.camera.renderer import make_renderer
from sim.worlds.world import World

FRAMES = 120
WARM_FRAMES = 5  # the first pictures build shaders and tables
PLACES = 12  # a walk between this many places of the region
HEIGHT_M = 0.5  # of the body over the region's floor


class Row(TypedDict):
    """One world's figures."""

    world: str
    triangles: int
    renderer: str
    frame_p50_ms: float
    frame_p99_ms: float
    rate_hz: float  # frames per second when one follows another


def camera_rate(
    worlds: Mapping[str, World], *, renderer: str = "auto", frames: int = FRAMES, seed: int = 0
) -> list[Row]:
    """Measure the camera along a walk through each world.

    Args:
        worlds: By the name that the row shall bear.
        renderer: As for `make_renderer`.
        frames: Pictures per world.
        seed: Of the walk and the noise.
    """
    return [_row(name, world, renderer, frames, seed) for name, world in worlds.items()]


def _row(name: str, world: World, kind: str, frames: int, seed: int) -> Row:
    camera, clock = Camera(), SystemClock()
    renderer = make_renderer(world, camera.intrinsics, camera.range_max_m, kind=kind)
    eye = Eye(renderer, camera, seed=seed)
    times_s = []
    for pose in _walk(world, frames + WARM_FRAMES, seed):
        begin_s = clock.now_s()
        eye.look(pose)
        times_s.append(clock.now_s() - begin_s)
    renderer.close()
    taken_ms = 1e3 * np.array(times_s[WARM_FRAMES:])
    return Row(
        world=name,
        triangles=len(world.faces),
        renderer=renderer.kind,
        frame_p50_ms=float(np.percentile(taken_ms, 50)),
        frame_p99_ms=float(np.percentile(taken_ms, 99)),
        rate_hz=float(1e3 / taken_ms.mean()),
    )


def _walk(world: World, frames: int, seed: int) -> list[Pose]:
    """Poses from place to place of the region, heading along and swaying a little."""
    rng = np.random.default_rng([seed, frames])
    low, high = world.region_m
    corners = rng.uniform(0.9 * low[:2] + 0.1 * high[:2], 0.1 * low[:2] + 0.9 * high[:2], (PLACES, 2))
    at = np.linspace(0.0, PLACES - 1.0, frames)
    x, y = (np.interp(at, np.arange(PLACES), corners[:, k]) for k in (0, 1))
    yaw = np.arctan2(np.gradient(y), np.gradient(x))
    tilt = rng.normal(0.0, 0.05, (frames, 2))
    z = float(low[2]) + HEIGHT_M
    return [
        Pose(np.array([x[k], y[k], z]), quaternion_from_rpy(tilt[k, 0], tilt[k, 1], yaw[k]))
        for k in range(frames)
    ]
