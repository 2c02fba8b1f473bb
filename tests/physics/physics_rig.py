"""Plain grounds and a plant on them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from labr_autonomy.config import RobotConfig
from sim.disturbances import Disturbances
from sim.plant import STEP_S, Plant, WheelDrive
from sim.rover import Slip
from sim.worlds.surface import Surface
from sim.worlds.world import make_world

CONFIG = RobotConfig()
G = 9.80665
NO_SLIP = replace(Disturbances(), slip=Slip(0.0, 0.0, 0.0, 0.0, 0.0))
BRAKED = WheelDrive(0.0, 0.0, True)


def profile(points, width_m=6.0):
    """Ground whose height follows (x, z) points and is the same for all y."""
    vertices, faces = [], []
    for i, (x, z) in enumerate(points):
        vertices += [[x, -width_m / 2, z], [x, width_m / 2, z]]
        if i:
            a = 2 * i - 2
            faces += [[a, a + 2, a + 3], [a, a + 3, a + 1]]
    return Surface(make_world("profile", np.array(vertices), np.array(faces), {}), CONFIG.body)


def ramp(rise, length_m=4.0):
    """Level up to x = 0, then up by `rise` per metre over `length_m`, then level."""
    return profile([(-6, 0), (0, 0), (length_m, rise * length_m), (length_m + 6, rise * length_m)])


def incline(rise):
    """One endless plane that rises with x."""
    return profile([(-30, -30 * rise), (30, 30 * rise)])


def flat():
    return profile([(-30, 0), (30, 0)])


def plant_on(surface, x=-1.0, yaw=0.0, seed=1, disturbances=NO_SLIP, y=0.1, floor_z_m=None):
    if floor_z_m is None:
        floor_z_m = surface.floor_below(x, y, 40.0)
    return Plant(CONFIG, surface, (x, y, yaw, floor_z_m), seed, disturbances)


def drive(plant, left, right, duration_s, *, braked=False, each=None):
    for _ in range(round(duration_s / STEP_S)):
        plant.step(None, WheelDrive(left, right, braked))
        if each is not None:
            each(plant)
    return plant.state


def drive_until(plant, speed, x_m, *, each=None, limit_s=60.0):
    for _ in range(round(limit_s / STEP_S)):
        plant.step(None, WheelDrive(speed, speed, False))
        if each is not None:
            each(plant)
        if plant.state.position_m[0] >= x_m:
            return plant.state
    raise AssertionError(f"it never got to x = {x_m} m, but to {plant.state.position_m}")


def sine_of(rise):
    return rise / math.sqrt(1.0 + rise * rise)
