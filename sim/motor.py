"""A geared DC motor at a wheel: what duty and pack voltage do to it when no controller stands between."""

from __future__ import annotations

import math

NOMINAL_V = 18.5  # five lithium-polymer cells
FREE_MPS = 1.8  # rim speed at nominal voltage without load; assumed, about twice what is driven
STALL_A = 12.0  # current at nominal voltage with the wheel held; assumed
STALL_MPS2 = 9.0  # what that current would do to the robot's half; gives the usual 0.2 s of geared motors
FRICTION_MPS2 = 0.3  # gears and rolling, as a deceleration

OHM = NOMINAL_V / STALL_A
VOLT_PER_MPS = NOMINAL_V / FREE_MPS
MPS2_PER_A = STALL_MPS2 / STALL_A
PEAK_A = 30.0  # the driver's own limit


def current_a(duty: float, volts: float, speed_mps: float) -> float:
    """Current of a motor [A], positive while it pushes forward.

    Args:
        duty: Share of the pack's voltage, [-1, 1].
        volts: Of the pack [V].
        speed_mps: Of the rim [m/s].
    """
    amps = (duty * volts - VOLT_PER_MPS * speed_mps) / OHM
    return max(-PEAK_A, min(PEAK_A, amps))


def pushed(
    speed_mps: float, amps: float, dt: float, sine: float, grip_mps2: float, gravity_mps2: float
) -> float:
    """Rim speed [m/s] after `dt` [s] of a current.

    Args:
        speed_mps: Before.
        amps: Of the motor, positive is forward.
        dt: Step.
        sine: Of the slope straight ahead, positive is uphill.
        grip_mps2: Most that tyres pass on.
        gravity_mps2: Of the earth.
    """
    push = max(-grip_mps2, min(grip_mps2, MPS2_PER_A * amps))
    ahead = math.copysign(1.0, speed_mps if speed_mps != 0.0 else push)
    if speed_mps == 0.0 and push == 0.0:
        return 0.0  # the gears hold
    after = ahead * speed_mps + (ahead * (push - gravity_mps2 * sine) - FRICTION_MPS2) * dt
    return ahead * max(0.0, after)  # through zero it stands for a step


def implied_a(before_mps: float, after_mps: float, dt: float, sine: float, gravity_mps2: float) -> float:
    """Current [A] of a motor whose controller brought the rim from one speed to the other."""
    if after_mps == 0.0 or dt <= 0.0:
        return 0.0
    push = (after_mps - before_mps) / dt + gravity_mps2 * sine + math.copysign(FRICTION_MPS2, after_mps)
    return push / MPS2_PER_A
