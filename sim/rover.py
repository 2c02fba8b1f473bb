"""Differential-drive rover: first-order wheel motors, tyre slip, encoders and power."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

from labr_autonomy.config import RobotConfig

TAU_S = 0.08  # motor with speed controller, step response to 63 %
DRIVE_MPS2 = 3.0  # most the motors can do
BRAKE_MPS2 = 7.0  # shorted motors on rubber tyres: friction coefficient of about 0.7 times g
TICKS_PER_M = 4000.0
SLIP_LOW, SLIP_HIGH = 0.005, 0.02  # steady part of each wheel, drawn once
SLIP_NOISE = 0.005  # standard deviation of the slowly changing part
SLIP_NOISE_TAU_S = 0.5
BURST_PER_S = 0.05  # rate of spots where a tyre loses its grip
BURST_S = 0.3
BURST_SLIP = 0.08
TABLE_SPEED_MPS = 0.6  # about what Table 3 drives: 7.5 m in 13.7 s
FIXED_SHARE = 0.4  # of the rolling power, needed at any speed: drivers, gears
EFFICIENCY = 0.6  # battery to wheel, while accelerating


@dataclass(frozen=True, slots=True)
class RoverState:
    """What the rover does after a step; body frame."""

    v_mps: float  # true forward speed over ground
    w_rps: float  # true yaw rate over ground
    left_wheel_mps: float  # rim speeds, what the encoders see
    right_wheel_mps: float
    left_ticks: int
    right_ticks: int
    watts: float  # whole robot, computer included


class Rover:
    """The wheels and what carries them.

    Args:
        config: Mass, track and power figures.
        seed: For the slip.
    """

    def __init__(self, config: RobotConfig, seed: int) -> None:
        self._track_m = config.body.track_m
        self._mass_kg = config.body.mass_kg
        self._idle_w = config.energy.idle_w
        self._rolling_w = config.energy.land_w - config.energy.idle_w
        self._rng = random.Random(f"rover {seed}")
        self._steady = [self._rng.uniform(SLIP_LOW, SLIP_HIGH) for _ in range(2)]
        self._noise = [0.0, 0.0]
        self._burst_s = [0.0, 0.0]
        self._wheel_mps = [0.0, 0.0]
        self._path_m = [0.0, 0.0]
        self.state = RoverState(0.0, 0.0, 0.0, 0.0, 0, 0, self._idle_w)

    def step(
        self, dt: float, left_target_mps: float, right_target_mps: float, *, braked: bool = False
    ) -> RoverState:
        """Advance by `dt` [s] with wheel targets [m/s]; `braked` stops the wheels as fast as tyres can."""
        slip = self._slip(dt)
        power_w = self._idle_w
        for i, target in enumerate((left_target_mps, right_target_mps)):
            before = self._wheel_mps[i]
            after = _braked(before, dt) if braked else _driven(before, target, dt)
            self._wheel_mps[i] = after
            self._path_m[i] += 0.5 * (before + after) * dt
            power_w += 0.5 * self._wheel_power(before, after, dt, braked)
        ground = [speed * (1.0 - s) for speed, s in zip(self._wheel_mps, slip, strict=True)]
        self.state = RoverState(
            v_mps=0.5 * (ground[0] + ground[1]),
            w_rps=(ground[1] - ground[0]) / self._track_m,
            left_wheel_mps=self._wheel_mps[0],
            right_wheel_mps=self._wheel_mps[1],
            left_ticks=math.floor(self._path_m[0] * TICKS_PER_M),
            right_ticks=math.floor(self._path_m[1] * TICKS_PER_M),
            watts=power_w,
        )
        return self.state

    def _slip(self, dt: float) -> list[float]:
        """Share of each wheel's motion that the ground does not get."""
        keep = math.exp(-dt / SLIP_NOISE_TAU_S)
        spread = SLIP_NOISE * math.sqrt(1.0 - keep * keep)
        slip = []
        for i in range(2):
            self._noise[i] = keep * self._noise[i] + spread * self._rng.gauss(0.0, 1.0)
            loses_grip = self._rng.random() < BURST_PER_S * dt
            self._burst_s[i] = BURST_S if loses_grip else max(0.0, self._burst_s[i] - dt)
            burst = BURST_SLIP if self._burst_s[i] > 0.0 else 0.0
            slip.append(min(1.0, max(0.0, self._steady[i] + self._noise[i] + burst)))
        return slip

    def _wheel_power(self, before: float, after: float, dt: float, braked: bool) -> float:
        """Twice one wheel's share of the drive power [W]; a standing or braked wheel needs none."""
        speed = abs(after)
        if braked:
            return 0.0
        awake = 1.0 - math.exp(-speed / 0.02)  # no step where the wheels begin to turn
        rolling = self._rolling_w * (FIXED_SHARE * awake + (1.0 - FIXED_SHARE) * speed / TABLE_SPEED_MPS)
        pushed = self._mass_kg * (after - before) / dt * after / EFFICIENCY if dt > 0.0 else 0.0
        return max(0.0, rolling + max(0.0, pushed))


def _driven(speed_mps: float, target_mps: float, dt: float) -> float:
    """First-order approach, limited by what the motors can do; exact for any `dt`."""
    wanted = (target_mps - speed_mps) * (1.0 - math.exp(-dt / TAU_S))
    return speed_mps + max(-DRIVE_MPS2 * dt, min(DRIVE_MPS2 * dt, wanted))


def _braked(speed_mps: float, dt: float) -> float:
    step = BRAKE_MPS2 * dt
    return 0.0 if abs(speed_mps) <= step else speed_mps - math.copysign(step, speed_mps)
