"""What moves the robot: the rover while the rotors are off and it stands, the quad otherwise. One truth."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import quaternion_from_rpy, yaw_of
from labr_autonomy.types import Array
from sim.battery import Battery
from sim.quad.quad import Quad
from sim.quad.state import QuadState
from sim.rover import Rover
from sim.worlds.surface import Surface

STEP_S = 0.004  # physics at 250 Hz
FLOOR_EVERY = 25  # steps between looks at the floor below (10 Hz)
CLEARANCE_EVERY = 10  # steps between looks at the obstacles around (25 Hz)
NEAR_FLOOR_M = 0.25  # below this height the floor itself is no obstacle
LOADED_N = 8.0  # a quarter of the weight closes the suspension switches
REST_MPS = 0.15
GRAVITY_MPS2 = 9.80665
START_REACH_M = 0.5  # the floor at the start lies at most this far above its stated height


@dataclass(frozen=True, slots=True)
class WheelDrive:
    """What the land controller asks of the motors."""

    left_mps: float
    right_mps: float
    braked: bool


class Plant:
    """True state of the robot in its world.

    Args:
        config: The robot.
        surface: The world's triangles.
        start: x, y [m], heading [rad] and height of the floor [m] in odom.
        seed: For wheel slip.
    """

    def __init__(
        self, config: RobotConfig, surface: Surface, start: tuple[float, float, float, float], seed: int
    ) -> None:
        self._config = config
        self._surface = surface
        self.quad = Quad(STEP_S)
        self.rover = Rover(config, seed)
        self.battery = Battery(config.energy.pack_j)
        x, y, self._yaw, floor_z_m = start
        self.floor_z_m = self._floor_below(x, y, floor_z_m + START_REACH_M)
        position = np.array([x, y, self.floor_z_m + config.body.below_m])
        self.state = QuadState(
            position_m=position,
            velocity_mps=np.zeros(3),
            quaternion=quaternion_from_rpy(0.0, 0.0, self._yaw),
            angular_velocity_rps=np.zeros(3),
            specific_force_mps2=np.array([0.0, 0.0, GRAVITY_MPS2]),
            electrical_w=0.0,
            wheel_load_n=np.full(4, 0.25 * config.body.mass_kg * GRAVITY_MPS2),
            on_wheels=True,
        )
        self._steps = 0
        self.clearance_m = surface.clearance(position, on_floor=True)

    def _floor_below(self, x: float, y: float, z: float) -> float:
        floor = self._surface.floor_below(x, y, z)
        return floor if math.isfinite(floor) else 0.0

    @property
    def wheel_load(self) -> bool:
        """Whether the suspension switches are closed."""
        return self.state.on_wheels or float(self.state.wheel_load_n.sum()) > LOADED_N

    @property
    def height_m(self) -> float:
        """Wheels above the floor."""
        return float(self.state.position_m[2]) - self._config.body.below_m - self.floor_z_m

    def step(self, motors: Array | None, drive: WheelDrive) -> QuadState:
        """Advance by `STEP_S`.

        Args:
            motors: (4,) duty of the rotors, None while they are off.
            drive: Wheel targets.
        """
        if self._steps % FLOOR_EVERY == 0:
            p = self.state.position_m
            self.floor_z_m = self._floor_below(float(p[0]), float(p[1]), float(p[2]))
            self.quad.set_floor(self.floor_z_m)
        volts = self.battery.volts
        self.quad.set_volts(volts)
        if motors is None and self.state.on_wheels:
            self._roll(drive)
        else:
            self._fly(np.zeros(4) if motors is None else motors, off=motors is None, drive=drive)
        self.battery.draw("rotors", self.state.electrical_w)
        self.battery.draw("wheels", self.rover.state.watts)
        self.battery.step(STEP_S)
        if self._steps % CLEARANCE_EVERY == 0:
            near = self.height_m < NEAR_FLOOR_M
            self.clearance_m = self._surface.clearance(self.state.position_m, on_floor=near)
        self._steps += 1
        return self.state

    def _roll(self, drive: WheelDrive) -> None:
        before = self.state
        rolled = self.rover.step(STEP_S, drive.left_mps, drive.right_mps, braked=drive.braked)
        middle = self._yaw + 0.5 * rolled.w_rps * STEP_S
        move = rolled.v_mps * STEP_S * np.array([math.cos(middle), math.sin(middle), 0.0])
        there = before.position_m + move
        if self.clearance_m <= 0.0 and self._surface.clearance(there, on_floor=True) < self.clearance_m:
            there = before.position_m  # an obstacle does not give way
        there[2] = self.floor_z_m + self._config.body.below_m
        self._yaw = math.remainder(self._yaw + rolled.w_rps * STEP_S, 2.0 * math.pi)
        c, s = math.cos(self._yaw), math.sin(self._yaw)
        velocity = (there - before.position_m) / STEP_S
        acceleration = (velocity - before.velocity_mps) / STEP_S
        forward = float(acceleration[0] * c + acceleration[1] * s)
        left = float(-acceleration[0] * s + acceleration[1] * c)
        self.state = QuadState(
            position_m=there,
            velocity_mps=velocity,
            quaternion=quaternion_from_rpy(0.0, 0.0, self._yaw),
            angular_velocity_rps=np.array([0.0, 0.0, rolled.w_rps]),
            specific_force_mps2=np.array([forward, left, GRAVITY_MPS2]),
            electrical_w=0.0,
            wheel_load_n=before.wheel_load_n,
            on_wheels=True,
        )

    def _fly(self, motors: Array, *, off: bool, drive: WheelDrive) -> None:
        if self.state.on_wheels:
            self.quad.reset(self.state.position_m, self._yaw)
        self.rover.step(STEP_S, 0.0, 0.0, braked=drive.braked)
        self.state = self.quad.step(motors)
        at_rest = float(np.linalg.norm(self.state.velocity_mps)) < REST_MPS
        if off and at_rest and float(self.state.wheel_load_n.sum()) > LOADED_N:
            self._yaw = yaw_of(self.state.quaternion)
            self.state = replace(self.state, on_wheels=True, electrical_w=0.0, velocity_mps=np.zeros(3))
