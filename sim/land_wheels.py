"""One wheel's speed controller: feed-forward and PI on the encoder's speed, with the motor's current limited.

Pure, and followed line by line by `firmware_bridge/core/land_wheel.c`.
"""

from __future__ import annotations

from typing import NamedTuple

from firmware_bridge.parameters import Parameters

STANDS_MPS = 5e-4  # a slower target is none
STILL_MPS = 0.02  # slower than this a wheel that is to stand gets no duty
YIELD_PER_AS = 4.0  # share of the duty given up for an ampere too much during a second
RECOVER_PER_S = 2.0  # share of the duty won back in a second


class Wheel(NamedTuple):
    """What the controller remembers of a wheel."""

    duty: float = 0.0  # [-1, 1], positive is forward
    integral: float = 0.0  # its part of the duty
    ceiling: float = 1.0  # of the duty's magnitude, lowered by too much current


def step(
    w: Wheel, target_mps: float, measured_mps: float, current_a: float, p: Parameters, dt_s: float
) -> Wheel:
    """Advance by one period.

    Args:
        w: State.
        target_mps: Where the ramp stands.
        measured_mps: By the encoder.
        current_a: Of the motor, either sign.
        p: Gains and limit.
        dt_s: Period.
    """
    excess_a = abs(current_a) - p.wheel_current
    if excess_a > 0.0:
        ceiling = max(0.0, min(w.ceiling, abs(w.duty)) - YIELD_PER_AS * excess_a * dt_s)
    else:
        ceiling = min(1.0, w.ceiling + RECOVER_PER_S * dt_s)
    if abs(target_mps) < STANDS_MPS and abs(measured_mps) < STILL_MPS:
        return Wheel(0.0, 0.0, ceiling)
    error = target_mps - measured_mps
    integral = w.integral + p.gain_i * error * dt_s
    wanted = target_mps / p.free_speed + p.gain_p * error + integral
    if abs(wanted) > ceiling:
        if error * wanted > 0.0:
            integral = w.integral  # at its limit it would only wind up
        wanted = ceiling if wanted > 0.0 else -ceiling
    return Wheel(wanted, integral, ceiling)
