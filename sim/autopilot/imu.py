"""HIGHRES_IMU's accelerometer and gyroscope: truth, constant biases and white noise, from a seed.

Noise per 50 Hz sample as measured in the recordings at rest; biases are those of a calibrated MEMS unit.
"""

from __future__ import annotations

import numpy as np

from labr_autonomy.types import Array

ACCELERATION_NOISE_MPS2 = 0.07
RATE_NOISE_RPS = 0.007
ACCELERATION_BIAS_MPS2 = 0.03
RATE_BIAS_RPS = 0.002
_BLOCK = 1024


class Imu:
    """One inertial unit."""

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng([seed, 0x494D55])
        sigma = np.repeat([ACCELERATION_BIAS_MPS2, RATE_BIAS_RPS], 3)
        self._bias = sigma * self._random.standard_normal(6)
        self._noise = np.zeros((0, 6))
        self._next = 0

    @property
    def bias(self) -> Array:
        """(6,) constant errors: specific force [m/s^2], then rates [rad/s], FLU."""
        return self._bias.copy()

    def measure(self, specific_force_mps2: Array, angular_velocity_rps: Array) -> tuple[float, ...]:
        """Six readings in FRD, from truth in FLU."""
        if self._next >= len(self._noise):
            sigma = np.repeat([ACCELERATION_NOISE_MPS2, RATE_NOISE_RPS], 3)
            self._noise = sigma * self._random.standard_normal((_BLOCK, 6))
            self._next = 0
        error = self._bias + self._noise[self._next]
        self._next += 1
        fx, fy, fz = (float(v) for v in specific_force_mps2)
        wx, wy, wz = (float(v) for v in angular_velocity_rps)
        e = [float(v) for v in error]
        return fx + e[0], -(fy + e[1]), -(fz + e[2]), wx + e[3], -(wy + e[4]), -(wz + e[5])
