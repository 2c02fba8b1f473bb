"""Floors, boxes and what the camera sees of them, for the tests of the driving layer."""

from __future__ import annotations

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import quaternion_from_rpy, rotation_matrix
from labr_autonomy.perception.rolling_map import RollingMap
from labr_autonomy.types import DepthFrame, Pose

CONFIG = RobotConfig()
OPTICS = CONFIG.camera.intrinsics
V, U = np.mgrid[0 : OPTICS.height, 0 : OPTICS.width]
RAYS = np.stack([np.ones(U.shape), -(U + 1e-4 - OPTICS.cx) / OPTICS.fx, -(V + 1e-4 - OPTICS.cy) / OPTICS.fy])
BELOW_M = CONFIG.body.below_m
FAR = 90.0


def plane(x0, x1, z0, slope=0.0, y=(-FAR, FAR)):
    """A piece of floor z = z0 + slope (x - x0) between two places along x."""
    return ("plane", x0, x1, z0, slope, y)


def box(lower, upper):
    return ("box", lower, upper)


def seen(things, at, noise=None):
    """Depth image of planes and boxes, with the noise of a D435 where a generator is given."""
    rotation = rotation_matrix(at.quaternion)
    eye = at.position_m + rotation @ np.array([CONFIG.camera.x_m, 0.0, CONFIG.camera.z_m])
    rays = np.einsum("ij,jvu->ivu", rotation, RAYS)
    depth = np.full(U.shape, np.inf)
    for thing in things:
        if thing[0] == "plane":
            _, x0, x1, z0, slope, (y0, y1) = thing
            with np.errstate(divide="ignore"):
                t = (z0 + slope * (eye[0] - x0) - eye[2]) / (rays[2] - slope * rays[0])
            x, y = eye[0] + t * rays[0], eye[1] + t * rays[1]
            there = (t > 0) & (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1)
        else:
            _, lower, upper = thing
            a = (np.array(lower)[:, None, None] - eye[:, None, None]) / rays
            b = (np.array(upper)[:, None, None] - eye[:, None, None]) / rays
            t, out = np.minimum(a, b).max(axis=0), np.maximum(a, b).min(axis=0)
            there = (t < out) & (t > 0)
        depth = np.where(there, np.minimum(depth, t), depth)
    depth = np.where(np.isfinite(depth), depth, 0.0)
    if noise is not None:
        depth = depth + noise.normal(0, 1, depth.shape) * 0.1 * depth**2 / (2 * OPTICS.fx * 0.05)
    return np.where((depth > 0.3) & (depth < 10.0), depth, 0.0).astype(np.float32)


def standing(x=0.0, y=0.0, z=0.0, yaw=0.0, pitch=0.0):
    return Pose(np.array([x, y, z + BELOW_M]), quaternion_from_rpy(0.0, pitch, yaw))


def mapped(things, at=None, frames=9, seed=0):
    at = at or standing()
    return looked_at(things, at, frames, seed).land_field(at, float(at.position_m[2]) - BELOW_M)


def looked_at(things, at, frames=9, seed=0):
    rng = np.random.default_rng(seed)
    grid = RollingMap(CONFIG)
    floor_z = float(at.position_m[2]) - BELOW_M
    for k in range(frames):
        grid.update(DepthFrame(k, 0.0, seen(things, at, rng), OPTICS), at, floor_z)
        grid.clear_robot(at)
    return grid


def clear(field, x, y=0.0):
    return float(field.lookup(np.array([[x, y]]))[0])


LEVEL = plane(-FAR, FAR, 0.0)
