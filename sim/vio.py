"""Stand-in for visual-inertial odometry: the true motion, seen with noise, slow drift and delay.

Figures of merit follow open VIO systems on small-robot sequences (OpenVINS, VINS-Fusion on EuRoC):
about 0.5 % of the distance in position and a few hundredths of a degree a metre in heading.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from labr_autonomy.estimation.vio_message import VioSample
from labr_autonomy.frames import quaternion_multiply, rotation_vector_quaternion
from labr_autonomy.types import Array, Pose

PERIOD_S = 1.0 / 30.0


@dataclass(frozen=True, slots=True)
class VioModel:
    """How good the stand-in is; the sigmas are per axis and per sample."""

    delay_s: float = 0.03
    position_sigma_m: float = 0.005
    rotation_sigma_rad: float = math.radians(0.1)
    velocity_sigma_mps: float = 0.02
    drift_share: float = 0.005  # metres of drift per metre of way, rms
    yaw_drift_rad_per_m: float = math.radians(0.05)  # rms
    drift_memory_m: float = 4.0  # way after which the drift has found another direction


class VioStandIn:
    """Turns true poses at 30 Hz into samples like those of a VIO; all randomness comes from the seed.

    Drift is driven by the way travelled, not by time: a robot that stands still does not drift.

    Args:
        seed: Seed of noise and drift.
        model: Figures of merit.
    """

    def __init__(self, seed: int, model: VioModel | None = None) -> None:
        self.model = model or VioModel()
        self._rng = np.random.default_rng(seed)
        self._true_m: Array | None = None  # (3,) world, at the last feed
        self._seen_m = np.zeros(3)  # (3,) odom, where the VIO believes to be
        self._yaw_error_rad = 0.0
        # Unit-variance drift directions: x, y, z and yaw, Ornstein-Uhlenbeck over the way.
        self._direction = self._rng.normal(size=4)
        self._waiting: deque[VioSample] = deque()

    @property
    def yaw_error_rad(self) -> float:
        """Present heading error, for the log of the truth."""
        return self._yaw_error_rad

    def feed(self, stamp_s: float, pose: Pose, velocity_mps: Array) -> None:
        """Show the true motion of one camera frame.

        Args:
            stamp_s: Mid-exposure.
            pose: True pose of body in the world, which is odom at the start.
            velocity_mps: True velocity (3,), world.
        """
        m = self.model
        step = np.zeros(3) if self._true_m is None else pose.position_m - self._true_m
        if self._true_m is None:
            self._seen_m = np.array(pose.position_m, float)
        self._true_m = np.array(pose.position_m, float)
        way_m = float(np.linalg.norm(step))
        stretch = self._drifted(way_m)
        c, s = math.cos(self._yaw_error_rad), math.sin(self._yaw_error_rad)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        self._seen_m = self._seen_m + turn @ step + stretch * way_m
        speed = float(np.linalg.norm(velocity_mps))
        half = 0.5 * self._yaw_error_rad
        yaw = np.array([math.cos(half), 0.0, 0.0, math.sin(half)])
        noise = rotation_vector_quaternion(self._rng.normal(0.0, m.rotation_sigma_rad, 3))
        self._waiting.append(
            VioSample(
                stamp_s,
                self._seen_m + self._rng.normal(0.0, m.position_sigma_m, 3),
                quaternion_multiply(quaternion_multiply(yaw, pose.quaternion), noise),
                turn @ velocity_mps + stretch * speed + self._rng.normal(0.0, m.velocity_sigma_mps, 3),
                np.diag([m.position_sigma_m**2] * 3 + [m.rotation_sigma_rad**2] * 3),
            )
        )

    def due(self, now_s: float) -> list[VioSample]:
        """The samples whose delay is over, oldest first; each is handed out once."""
        out = []
        while self._waiting and self._waiting[0].stamp_s + self.model.delay_s <= now_s:
            out.append(self._waiting.popleft())
        return out

    def _drifted(self, way_m: float) -> Array:
        """Let the drift go on over `way_m`; returns metres of position drift per metre of way, (3,)."""
        m = self.model
        keep = math.exp(-way_m / m.drift_memory_m)
        fresh = math.sqrt(max(0.0, 1.0 - keep * keep))
        self._direction = keep * self._direction + fresh * self._rng.normal(size=4)
        self._yaw_error_rad += m.yaw_drift_rad_per_m * float(self._direction[3]) * way_m
        out: Array = self._direction[:3] * (m.drift_share / math.sqrt(3.0))
        return out
