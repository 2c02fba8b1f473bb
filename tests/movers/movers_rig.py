"""Movers on plain tracks, and a robot that stands or drives past them."""

from __future__ import annotations

import math

import numpy as np

from labr_autonomy.config import RobotConfig
from sim.movers.crowd import Crowd
from sim.movers.draw import PERSON
from sim.movers.mover import Mover, Shape

CONFIG = RobotConfig()
BODY = CONFIG.body
BOX = Shape("box", (0.4, 0.2), 0.8)
DT_S = 0.004
FAR = np.array([50.0, 50.0, BODY.below_m])


def mover(
    shape=PERSON, first=(0.0, -3.0), last=(0.0, 3.0), speed=1.5, pause=1.0, along=0.0, floor=(0.0, 0.0)
):
    return Mover(shape, (first, last), tuple(floor), speed, (pause, pause), along, True)


class Walk:
    """Steps a crowd of one beside a robot."""

    def __init__(self, who, position=FAR):
        self.crowd = Crowd([who], CONFIG)
        self.position = np.array(position, dtype=float)
        self.now_s = 0.0
        self.history = []  # t, y of the mover, gap

    def go(self, seconds, velocity=(0.0, 0.0, 0.0), *, on_wheels=True):
        velocity = np.array(velocity, dtype=float)
        for _ in range(round(seconds / DT_S)):
            self.now_s += DT_S
            self.position = self.position + velocity * DT_S
            self.crowd.step(DT_S, self.position, velocity, on_wheels=on_wheels)
            place = self.crowd.placed[0]
            gap = place.clearance_m(*self.position, BODY)
            self.history.append((self.now_s, place.y_m, gap))
        return self.crowd.placed[0]

    @property
    def least_gap_m(self):
        return min(gap for _, _, gap in self.history)


def brute_gap(placed, x, y, z, body=BODY, n=181):
    """Distance of two upright solids by sampling the surface of one, for outlines that do not meet."""
    angle = np.linspace(-math.pi, math.pi, 4 * n)
    share = np.linspace(0.0, 1.0, 60)
    heights = z - body.below_m + share * (body.above_m + body.below_m)
    radii = np.linspace(0.0, body.radius_m, 30)
    a, r, h = np.meshgrid(angle, radii, heights, indexing="ij")
    points = np.stack([x + r * np.cos(a), y + r * np.sin(a), h], axis=-1).reshape(-1, 3)
    c, s = math.cos(placed.yaw_rad), math.sin(placed.yaw_rad)
    d = points - np.array([placed.x_m, placed.y_m, placed.floor_z_m])
    half = placed.shape.half_m
    if placed.shape.kind == "person":
        aside = np.maximum(np.hypot(d[:, 0], d[:, 1]) - half[0], 0.0)
    else:
        local = np.stack([c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0]], axis=1)
        aside = np.linalg.norm(np.maximum(np.abs(local) - np.array(half), 0.0), axis=1)
    level = np.maximum(np.maximum(d[:, 2] - placed.shape.height_m, -d[:, 2]), 0.0)
    return float(np.hypot(aside, level).min())
