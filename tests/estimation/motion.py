"""Exact motions with their ideal sensors, for the tests of the pose filter."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from labr_autonomy.estimation.error_state import GRAVITY_MPS2, Noise
from labr_autonomy.estimation.filter import PoseFilter
from labr_autonomy.estimation.vio_message import VioSample
from labr_autonomy.frames import (
    quaternion_conjugate,
    quaternion_from_rpy,
    quaternion_multiply,
    quaternion_rotation_vector,
    rotation_matrix,
    rotation_vector_quaternion,
)
from labr_autonomy.types import ImuSample, WheelOdometry

VIO_COVARIANCE = np.diag([0.005**2] * 3 + [math.radians(0.1) ** 2] * 3)
EXACT = Noise(
    vio_position_floor_m=1e-4, vio_rotation_floor_rad=1e-5, vio_velocity_mps=0.02, start_velocity_mps=0.02
)


class Flight:
    """Smooth motion in all six degrees of freedom, up to 1 m/s and 1 rad/s."""

    def position(self, t):
        return np.array(
            [1.2 * math.sin(0.8 * t), 0.9 * math.sin(0.6 * t + 1.0), 1.0 + 0.4 * math.sin(0.9 * t)]
        )

    def quaternion(self, t):
        return quaternion_from_rpy(0.15 * math.sin(1.1 * t), 0.1 * math.sin(1.4 * t), 1.5 * math.sin(0.5 * t))


class Drive:
    """Driving on the floor along a wavy line; speed and heading rate vary."""

    def __init__(self, speed_mps=0.6):
        self.grid_s = np.arange(0.0, 20.0, 1e-3)
        speed = speed_mps * (0.7 + 0.3 * np.sin(0.9 * self.grid_s))
        yaw = 0.8 * np.sin(0.7 * self.grid_s)
        v = np.stack([speed * np.cos(yaw), speed * np.sin(yaw)], axis=1)
        xy = np.vstack([np.zeros(2), np.cumsum(0.5 * (v[1:] + v[:-1]) * 1e-3, axis=0)])
        self.x, self.y, self.speed_mps = xy[:, 0], xy[:, 1], speed

    def speed(self, t):
        return float(np.interp(t, self.grid_s, self.speed_mps))

    def position(self, t):
        i = min(max(int(t / 1e-3), 1), len(self.grid_s) - 3)
        # cubic, so that second differences are smooth
        u = t / 1e-3 - i
        w = [-u * (u - 1) * (u - 2) / 6, (u + 1) * (u - 1) * (u - 2) / 2, -(u + 1) * u * (u - 2) / 2]
        w.append((u + 1) * u * (u - 1) / 6)
        return np.array([np.dot(w, self.x[i - 1 : i + 3]), np.dot(w, self.y[i - 1 : i + 3]), 0.12])

    def quaternion(self, t):
        return quaternion_from_rpy(0.0, 0.0, 0.8 * math.sin(0.7 * t))


def velocity(motion, t, h=2e-3):
    return (motion.position(t + h) - motion.position(t - h)) / (2 * h)


def rate(motion, t, h=1e-3):
    between = quaternion_multiply(quaternion_conjugate(motion.quaternion(t - h)), motion.quaternion(t + h))
    return quaternion_rotation_vector(between) / (2 * h)


def imu(motion, t, h=4e-3):
    acceleration = (motion.position(t + h) - 2 * motion.position(t) + motion.position(t - h)) / h**2
    force = rotation_matrix(motion.quaternion(t)).T @ (acceleration + np.array([0, 0, GRAVITY_MPS2]))
    return ImuSample(t, force, rate(motion, t))


def vio(motion, t, rng=None, shift_m=(0.0, 0.0, 0.0)):
    p, q, v = motion.position(t) + np.array(shift_m), motion.quaternion(t), velocity(motion, t)
    if rng is not None:
        p = p + rng.normal(0, 0.005, 3)
        q = quaternion_multiply(q, rotation_vector_quaternion(rng.normal(0, math.radians(0.1), 3)))
        v = v + rng.normal(0, 0.02, 3)
    return VioSample(t, p, q, v, VIO_COVARIANCE)


@dataclass
class Run:
    """A motion played into a filter, every sensor arriving at its own time."""

    motion: object
    noise: Noise = EXACT
    vio_delay_s: float = 0.03
    seed: int | None = None
    wheels: bool = False
    imu_jitter_s: float = 0.0
    imu_gap_s: tuple = (99.0, 99.0)
    vio_off_s: tuple = (99.0, 99.0)
    vio_of: object = None  # (t, sample) -> sample, the fault
    wheels_of: object = None
    filter: PoseFilter = field(init=False)
    bias_g: np.ndarray = field(init=False)
    bias_a: np.ndarray = field(init=False)

    def __post_init__(self):
        self.filter = PoseFilter(self.noise)
        self.rng = None if self.seed is None else np.random.default_rng(self.seed)
        draw = (lambda s: self.rng.normal(0, s, 3)) if self.rng else (lambda s: np.zeros(3))
        self.bias_g = draw(self.noise.start_gyroscope_bias_rps)
        self.bias_a = draw(self.noise.start_accelerometer_bias_mps2)
        self.now_s = 0.0

    def events(self, start_s, end_s):
        out = []
        for k in range(round(start_s * 50), round(end_s * 50)):
            t = k / 50
            if not self.imu_gap_s[0] <= t < self.imu_gap_s[1]:
                out.append((t, 0, "imu", t))
            if self.wheels:
                out.append((t + 0.007, 1, "wheels", t + 0.003))
        for k in range(round(start_s * 30), round(end_s * 30)):
            t = k / 30
            if not self.vio_off_s[0] <= t < self.vio_off_s[1]:
                out.append((t + self.vio_delay_s, 2, "vio", t))
        return sorted(out)

    def play(self, end_s, watch=None):
        for arrival, _, kind, t in self.events(self.now_s, end_s):
            if kind == "imu":
                self.filter.add_imu(self._imu(t))
            elif kind == "vio":
                sample = vio(self.motion, t, self.rng)
                self.filter.add_vio(self.vio_of(t, sample) if self.vio_of else sample)
            else:
                speed = self.motion.speed(t) + (self.rng.normal(0, 0.03) if self.rng else 0.0)
                speed = self.wheels_of(t, speed) if self.wheels_of else speed
                self.filter.add_wheels(WheelOdometry(t, speed, 0.0, 0, 0), True)
            if watch is not None:
                watch(arrival, kind)
        self.now_s = end_s
        return self.filter

    def _imu(self, t):
        if self.rng is None:
            return imu(self.motion, t)
        jitter = self.rng.uniform(-1, 1) * self.imu_jitter_s
        true = imu(self.motion, t)
        root = math.sqrt(50.0)
        force = true.specific_force_mps2 + self.bias_a
        force = force + self.rng.normal(0, self.noise.accelerometer_mps2_rthz * root, 3)
        turn = true.angular_velocity_rps + self.bias_g
        turn = turn + self.rng.normal(0, self.noise.gyroscope_rps_rthz * root, 3)
        return ImuSample(t + jitter, force, turn)

    def error(self):
        """Error state (15,) of the newest estimate against the truth."""
        s, t = self.filter.state, self.filter.odometry().stamp_s
        turn = quaternion_multiply(quaternion_conjugate(s.quaternion), self.motion.quaternion(t))
        return np.concatenate(
            [
                self.motion.position(t) - s.position_m,
                velocity(self.motion, t) - s.velocity_mps,
                quaternion_rotation_vector(turn),
                self.bias_g - s.gyroscope_bias_rps,
                self.bias_a - s.accelerometer_bias_mps2,
            ]
        )
