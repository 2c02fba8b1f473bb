"""Parameters of the land controller, readable and writable over the wire by name.

This table is the only one: the Python twin uses it, and `firmware_bridge.build` writes it out for the C side.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from labr_autonomy.config import RobotConfig

TICKS_PER_M = 4000.0  # of the encoders along the rim, four counts a line

# The firmware is the last line: it leaves the executive's controller this much above the robot's own limits,
# and refuses what is beyond.
MARGIN = 1.25

RANGES: dict[str, tuple[float, float]] = {
    "track": (0.05, 2.0),
    "ticks_per_m": (10.0, 100_000.0),
    "speed": (0.05, 3.0),
    "reverse": (0.0, 3.0),
    "yaw_rate": (0.1, 6.0),
    "acceleration": (0.1, 10.0),
    "battery_low": (0.0, 60.0),
    "current_max": (0.5, 60.0),
    "wheel_current": (0.5, 30.0),
    "free_speed": (0.2, 10.0),
    "gain_p": (0.0, 20.0),
    "gain_i": (0.0, 100.0),
}


@dataclass(frozen=True, slots=True)
class Parameters:
    """Values in the order of their index; names have at most 16 characters."""

    track: float  # [m]
    ticks_per_m: float  # [1/m]
    speed: float  # [m/s] forward limit of commands
    reverse: float  # [m/s] backward limit of commands
    yaw_rate: float  # [rad/s]
    acceleration: float  # [m/s^2] ramp of each wheel
    battery_low: float = 15.0  # [V] 3.0 V a cell, 5S
    current_max: float = 15.0  # [A] from the pack while driving; latches a fault
    wheel_current: float = 8.0  # [A] of each motor; its duty yields above
    free_speed: float = 1.8  # [m/s] of a wheel at full duty without load
    gain_p: float = 1.3  # [s/m] duty for a speed error; places the loop at about 12 rad/s
    gain_i: float = 6.5  # [1/m] duty for a position error; its zero lies on the motor's 0.2 s

    @classmethod
    def of(cls, config: RobotConfig) -> Parameters:
        """What is flashed for this robot."""
        land = config.land
        wheel_mps2 = land.acceleration_mps2 + 0.5 * config.body.track_m * land.yaw_acceleration_rps2
        return cls(
            track=config.body.track_m,
            ticks_per_m=TICKS_PER_M,
            speed=MARGIN * land.speed_mps,
            reverse=MARGIN * land.reverse_mps,
            yaw_rate=MARGIN * land.yaw_rate_rps,
            acceleration=MARGIN * wheel_mps2,
        )

    def allows(self, v_mmps: int, w_mradps: int) -> bool:
        """Whether a command is inside the limits; half a unit, as 0.9 m/s on the wire is 0.89999998."""
        forward = -self.reverse * 1000.0 - 0.5 <= v_mmps <= self.speed * 1000.0 + 0.5
        return forward and abs(w_mradps) <= self.yaw_rate * 1000.0 + 0.5

    def names(self) -> tuple[str, ...]:
        """All names, by index."""
        return tuple(f.name for f in fields(self))

    def get(self, name: str) -> float | None:
        """One value, None if there is no such name."""
        return float(getattr(self, name)) if name in RANGES else None

    def written(self, name: str, value: float) -> Parameters | None:
        """A copy with one value changed, None if name or value is not acceptable."""
        low, high = RANGES.get(name, (1.0, 0.0))
        if not low <= value <= high:  # false for NaN as well
            return None
        return replace(self, **{name: value})
