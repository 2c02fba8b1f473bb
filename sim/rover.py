"""Differential-drive rover: first-order wheel motors, tyre slip, encoders, slopes and power."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

from firmware_bridge.parameters import TICKS_PER_M
from labr_autonomy.config import RobotConfig
from sim import motor

GRAVITY_MPS2 = 9.80665
TAU_S = 0.08  # motor with speed controller, step response to 63 %
DRIVE_MPS2 = 3.0  # most the motors can do
BRAKE_MPS2 = 7.0  # shorted motors on rubber tyres: friction coefficient of about 0.7 times g

SLIP_NOISE_TAU_S = 0.5
BURST_S = 0.3
TABLE_SPEED_MPS = 0.6  # about what Table 3 drives: 7.5 m in 13.7 s
FIXED_SHARE = 0.4  # of the rolling power, needed at any speed: drivers, gears
EFFICIENCY = 0.6  # battery to wheel, while accelerating or climbing


@dataclass(frozen=True, slots=True)
class Slip:
    """Share of each wheel's motion that the ground does not get."""

    steady_low: float = 0.005  # the steady part of each wheel is drawn once, between these
    steady_high: float = 0.02
    noise: float = 0.005  # standard deviation of the slowly changing part
    burst_per_s: float = 0.05  # rate of spots where a rolling tyre loses its grip
    burst_share: float = 0.08


@dataclass(frozen=True, slots=True)
class RoverState:
    """What the rover does after a step; body frame."""

    v_mps: float  # true forward speed over ground, along the slope
    w_rps: float  # true yaw rate over ground
    left_wheel_mps: float  # rim speeds, what the encoders see
    right_wheel_mps: float
    left_ticks: int
    right_ticks: int
    watts: float  # whole robot, computer included
    left_a: float = 0.0  # of each motor, positive while it pushes forward
    right_a: float = 0.0


class Rover:
    """The wheels and what carries them.

    Args:
        config: Mass, track and power figures.
        seed: For the slip.
        slip: Its figures.
        tau_s: Time constant of the wheel motors [s].
    """

    def __init__(
        self, config: RobotConfig, seed: int, slip: Slip | None = None, tau_s: float = TAU_S
    ) -> None:
        self._track_m = config.body.track_m
        self._mass_kg = config.body.mass_kg
        self._idle_w = config.energy.idle_w
        self._rolling_w = config.energy.land_w - config.energy.idle_w
        self._slip_model = slip or Slip()
        self._tau_s = tau_s
        self._rng = random.Random(f"rover {seed}")
        low, high = self._slip_model.steady_low, self._slip_model.steady_high
        self._steady = (self._rng.uniform(low, high), self._rng.uniform(low, high))
        self._noise = [0.0, 0.0]
        self._burst_s = [0.0, 0.0]
        self._left_mps, self._right_mps = 0.0, 0.0
        self._left_m, self._right_m = 0.0, 0.0
        self._dt_s, self._reach, self._keep, self._spread = -1.0, 0.0, 0.0, 0.0
        self.state = RoverState(0.0, 0.0, 0.0, 0.0, 0, 0, self._idle_w)

    @property
    def steady_slip(self) -> tuple[float, float]:
        """The drawn steady part of left and right wheel."""
        return self._steady

    @property
    def still(self) -> bool:
        """Whether both wheels stand."""
        return self._left_mps == 0.0 and self._right_mps == 0.0

    def step(
        self,
        dt: float,
        left_target: float,
        right_target: float,
        *,
        braked: bool = False,
        sine: float = 0.0,
        volts: float | None = None,
    ) -> RoverState:
        """Advance by `dt` [s].

        Args:
            dt: Step [s].
            left_target: What the left motor's controller aims for [m/s]; its duty [-1, 1] with `volts`.
            right_target: The same of the right one.
            braked: Stop the wheels as fast as tyres can.
            sine: Rise per metre of way straight ahead, the sine of the slope; positive is uphill.
            volts: Of the pack [V], for bare motors under duty; None for motors with a speed controller.
        """
        if self.still and (braked or (left_target == 0.0 and right_target == 0.0)):
            if self.state.watts != self._idle_w or self.state.v_mps or self.state.w_rps:
                self.state = self._rest()
            return self.state
        if dt != self._dt_s:
            self._prepare(dt)
        left_a = right_a = 0.0
        if braked:
            left, right = (_braked(v, dt, sine) for v in (self._left_mps, self._right_mps))
            power_w = self._idle_w
        else:
            if volts is None:
                left = self._driven(self._left_mps, left_target, dt, sine)
                right = self._driven(self._right_mps, right_target, dt, sine)
                left_a = motor.implied_a(self._left_mps, left, dt, sine, GRAVITY_MPS2)
                right_a = motor.implied_a(self._right_mps, right, dt, sine, GRAVITY_MPS2)
            else:
                left_a = motor.current_a(left_target, volts, self._left_mps)
                right_a = motor.current_a(right_target, volts, self._right_mps)
                grip = BRAKE_MPS2 * math.sqrt(1.0 - sine * sine)
                left = motor.pushed(self._left_mps, left_a, dt, sine, grip, GRAVITY_MPS2)
                right = motor.pushed(self._right_mps, right_a, dt, sine, grip, GRAVITY_MPS2)
            power_w = self._idle_w + 0.5 * (
                self._wheel_power(self._left_mps, left, dt, sine)
                + self._wheel_power(self._right_mps, right, dt, sine)
            )
        self._left_m += 0.5 * (self._left_mps + left) * dt
        self._right_m += 0.5 * (self._right_mps + right) * dt
        self._left_mps, self._right_mps = left, right
        ground_left = left * (1.0 - self._slip(0, dt))
        ground_right = right * (1.0 - self._slip(1, dt))
        self.state = RoverState(
            0.5 * (ground_left + ground_right),
            (ground_right - ground_left) / self._track_m,
            left,
            right,
            math.floor(self._left_m * TICKS_PER_M),
            math.floor(self._right_m * TICKS_PER_M),
            power_w,
            left_a,
            right_a,
        )
        return self.state

    def _rest(self) -> RoverState:
        left, right = self.state.left_ticks, self.state.right_ticks
        return RoverState(0.0, 0.0, 0.0, 0.0, left, right, self._idle_w)

    def _prepare(self, dt: float) -> None:
        """What depends on the step alone; the plant's never changes."""
        self._dt_s = dt
        self._reach = 1.0 - math.exp(-dt / self._tau_s)
        self._keep = math.exp(-dt / SLIP_NOISE_TAU_S)
        self._spread = self._slip_model.noise * math.sqrt(1.0 - self._keep * self._keep)

    def _slip(self, i: int, dt: float) -> float:
        """Share of a wheel's motion that the ground does not get."""
        noise = self._noise[i] = self._keep * self._noise[i] + self._spread * self._rng.gauss(0.0, 1.0)
        share = self._steady[i] + noise
        if self._rng.random() < self._slip_model.burst_per_s * dt:
            self._burst_s[i] = BURST_S
        elif self._burst_s[i] > 0.0:
            self._burst_s[i] = max(0.0, self._burst_s[i] - dt)
        if self._burst_s[i] > 0.0:
            share += self._slip_model.burst_share
        return 0.0 if share < 0.0 else min(share, 1.0)

    def _driven(self, speed_mps: float, target_mps: float, dt: float, sine: float) -> float:
        """First-order approach, limited by what the motors can do beside gravity; exact for any `dt`.

        Downhill they hold back as hard as the tyres can; where they cannot climb they stall, for the gears
        do not turn back.
        """
        ahead = 1.0 if speed_mps > 0.0 or (speed_mps == 0.0 and target_mps > 0.0) else -1.0
        speed, aim, pull = ahead * speed_mps, ahead * target_mps, ahead * GRAVITY_MPS2 * sine
        tyres = BRAKE_MPS2 * math.sqrt(1.0 - sine * sine) if sine else BRAKE_MPS2
        slowest, fastest = max(-DRIVE_MPS2, -tyres - pull) * dt, (DRIVE_MPS2 - pull) * dt
        after = speed + max(slowest, min(fastest, (aim - speed) * self._reach))
        return ahead * (after if after > 0.0 or aim < 0.0 else 0.0)

    def _wheel_power(self, before: float, after: float, dt: float, sine: float) -> float:
        """Twice one wheel's share of the drive power [W]; a standing wheel needs none."""
        speed = abs(after)
        if speed == 0.0:
            return 0.0
        awake = 1.0 if speed > 0.8 else 1.0 - math.exp(-speed / 0.02)  # no step where they begin to turn
        rolling = self._rolling_w * (FIXED_SHARE * awake + (1.0 - FIXED_SHARE) * speed / TABLE_SPEED_MPS)
        gain = (after - before) / dt if dt > 0.0 else 0.0
        weight_n = self._mass_kg * GRAVITY_MPS2 * sine
        pushed = (self._mass_kg * gain + weight_n) * after
        # What pushes back downhill spares the motors their losses first; it never charges the pack.
        drawn = pushed / EFFICIENCY if pushed > 0.0 else min(0.0, weight_n * after) * EFFICIENCY
        return max(0.0, rolling + drawn)


def _braked(speed_mps: float, dt: float, sine: float) -> float:
    """Tyres at their limit; uphill gravity helps, downhill it pushes."""
    ahead = sine if speed_mps > 0.0 else -sine
    friction = BRAKE_MPS2 * math.sqrt(1.0 - sine * sine) if sine else BRAKE_MPS2
    step = (friction + GRAVITY_MPS2 * ahead) * dt
    return 0.0 if abs(speed_mps) <= step else speed_mps - math.copysign(step, speed_mps)
