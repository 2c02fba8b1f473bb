"""Views of analytic places: an open floor with one box on it, seen from random poses before it."""

import math

import numpy as np

from labr_autonomy.gkpn.local_map import CHANNELS, SIDE
from labr_autonomy.gkpn.shards import LAND_CELL_M, LAND_SIDE, Shard

BELOW_M = 0.12  # body above the floor when it stands
BOX = ((2.5, -0.6), (3.1, 0.6))  # lower and upper corner, odom [m]
BOX_TOP_M = 0.8
AIR_CELL_M = 0.1
AIR_LOW_M, AIR_SIZE_M = np.array([-2.0, -4.0, -0.2]), np.array([10.0, 8.0, 3.4])


def box_distance(xy, low=BOX[0], high=BOX[1]):
    """Signed distance of points (..., 2) to the box's outline."""
    centre, half = 0.5 * (np.array(low) + high), 0.5 * (np.array(high) - low)
    q = np.abs(xy - centre) - half
    return np.linalg.norm(np.maximum(q, 0.0), axis=-1) + np.minimum(q.max(axis=-1), 0.0)


def solid_distance(points):
    """Signed distance of points (..., 3) to box and floor."""
    flat = box_distance(points[..., :2])
    up = points[..., 2] - BOX_TOP_M
    outside = np.hypot(np.maximum(flat, 0.0), np.maximum(up, 0.0))
    return np.minimum(outside + np.minimum(np.maximum(flat, up), 0.0), points[..., 2])


def centres(origin, cell, shape):
    """Middle of each cell of a grid, (*shape, len(shape))."""
    axes = [o + (np.arange(n) + 0.5) * cell for o, n in zip(origin, shape, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def in_cm(metres):
    return np.clip(np.round(100.0 * metres), -127, 127).astype(np.int8)


def shard(views=12, goals=8, seed=0, *, size=(160, 90), slope=0.0, family="hall"):
    """A scene; the floor rises by `slope` per metre of x where it is not level."""
    rng = np.random.default_rng(seed)
    width, height = size
    poses = np.zeros((views, 6), np.float32)
    poses[:, 0], poses[:, 1] = rng.uniform(-0.8, 0.4, views), rng.uniform(-0.8, 0.8, views)
    flying = np.arange(views) % 4 == 3
    poses[:, 2] = BELOW_M + np.where(flying, rng.uniform(0.5, 1.5, views), 0.0)
    poses[:, 3] = rng.uniform(-0.3, 0.3, views)
    floor_m = (BELOW_M - poses[:, 2]).astype(np.float32)
    corner = (poses[:, :2] - 0.5 * LAND_SIDE * LAND_CELL_M).astype(np.float32)
    land = np.stack([in_cm(box_distance(centres(c, LAND_CELL_M, (LAND_SIDE, LAND_SIDE)))) for c in corner])
    ahead = np.stack([centres(c, LAND_CELL_M, (LAND_SIDE, LAND_SIDE))[..., 0] for c in corner])
    floors = np.round(100.0 * slope * (ahead - poses[:, 0, None, None])).astype(np.int16)
    shape = tuple(np.round(AIR_SIZE_M / AIR_CELL_M).astype(int))
    air = in_cm(solid_distance(centres(AIR_LOW_M, AIR_CELL_M, shape)))
    wanted, in_air, hard = _goals(rng, poses, floor_m, goals)
    images = np.clip(rng.normal(4000.0, 1500.0, (views, height, width)), 0, 10_000).astype(np.uint16)
    maps = np.packbits(rng.random((views, CHANNELS, SIDE * SIDE)) < 0.2, axis=-1)
    return Shard(
        images_mm=images,
        maps=maps,
        poses=poses,
        floor_m=floor_m,
        goals_m=wanted,
        in_air=in_air,
        hard=hard,
        land_cm=land,
        floors_cm=floors,
        land_corner_m=corner,
        air_cm=air,
        air_origin_m=AIR_LOW_M.astype(np.float32),
        air_cell_m=AIR_CELL_M,
        family=family,
        seed=seed,
    )


def _goals(rng, poses, floor_m, count):
    views = len(poses)
    out = np.zeros((views, count, 3), np.float32)
    in_air = np.zeros((views, count), bool)
    in_air[:, count // 2 :] = True
    hard = np.zeros((views, count), bool)
    for v in range(views):
        for k in range(count):
            goal = np.array(
                [rng.uniform(4.2, 5.5), rng.uniform(-0.5, 0.5) if k % 2 else rng.uniform(1.4, 2.0)]
            )
            away = goal - poses[v, :2]
            yaw = float(poses[v, 3])
            c, s = math.cos(yaw), math.sin(yaw)
            out[v, k, :2] = c * away[0] + s * away[1], c * away[1] - s * away[0]
            out[v, k, 2] = floor_m[v] + (rng.uniform(1.0, 1.8) if in_air[v, k] else 0.0)
            line = poses[v, :2] + np.linspace(0.0, 1.0, 40)[:, None] * away
            hard[v, k] = (box_distance(line) < 0.32).any()
    return out, in_air, hard
