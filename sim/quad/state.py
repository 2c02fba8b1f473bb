"""What the physics knows about the robot at one instant, in the air or on its wheels."""

from __future__ import annotations

from dataclasses import dataclass

from labr_autonomy.types import Array


@dataclass(frozen=True, slots=True)
class QuadState:
    """True state of the robot. World is odom at start: ENU, z up; body is FLU."""

    position_m: Array  # (3,) body origin in world
    velocity_mps: Array  # (3,) world
    quaternion: Array  # (4,) wxyz, body to world
    angular_velocity_rps: Array  # (3,) body
    specific_force_mps2: Array  # (3,) body; +g on z at rest
    electrical_w: float  # power of the four motor controllers
    wheel_load_n: Array  # (4,) front right, rear left, front left, rear right
    on_wheels: bool = False  # the rover's physics moves it: rotors off, driving or parked

    @property
    def on_ground(self) -> bool:
        """Whether any wheel carries weight."""
        return self.on_wheels or bool((self.wheel_load_n > 0.0).any())
