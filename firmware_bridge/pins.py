"""What the land controller's pins tell it, and what it puts on its motors."""

from __future__ import annotations

from typing import NamedTuple


class Inputs(NamedTuple):
    """Pins, encoders and currents at one moment."""

    battery_v: float
    current_a: float  # from the pack
    wheel_load: bool  # suspension switches: the wheels carry the weight
    rotors_possible: bool  # the rotors' supply is on
    left_ticks: int
    right_ticks: int
    left_a: float = 0.0  # of each motor, positive while it pushes forward
    right_a: float = 0.0
    driver_fault: bool = False  # a motor driver says so
    estop_pressed: bool = False  # the button on the robot


class Duty(NamedTuple):
    """What the motor stage gets."""

    left: float = 0.0  # [-1, 1], positive is forward
    right: float = 0.0
    braked: bool = True


def wrapped(ticks: int) -> int:
    """An encoder's count as 32 bits hold it."""
    return (ticks + 0x80000000 & 0xFFFFFFFF) - 0x80000000
