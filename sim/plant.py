"""What moves the robot: the chassis while the rotors are off and it stands, the quad otherwise. One truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import roll_pitch_of, yaw_of
from labr_autonomy.types import Array
from sim.battery import Battery
from sim.chassis import Chassis
from sim.disturbances import Disturbances, WindField
from sim.land_core import Inputs
from sim.quad.quad import CONTACT_M, Quad
from sim.quad.state import QuadState
from sim.rover import Rover
from sim.terrain import AXLE_M, Plane
from sim.worlds.surface import Surface

STEP_S = 0.004  # physics at 250 Hz
WHEELS_EVERY = 5  # steps between looks at the floor under the wheels (50 Hz)
FLOOR_EVERY = 25  # the same in flight (10 Hz)
NEAR_EVERY = 10  # steps between looks around, at the wind, and in flight near the floor at it (25 Hz)
NEAR_FLOOR_M = 0.25  # below this height the floor itself is no obstacle
LOOK_M = 0.5  # below this height the slope of the floor matters
LOADED_N = 8.0  # a quarter of the weight closes the suspension switches
REST_MPS = 0.15
_STILL = (0.0, 0.0, 0.0, 0.0)  # duty of resting rotors
START_REACH_M = 0.5  # the floor at the start lies at most this far above its stated height


@dataclass(frozen=True, slots=True)
class WheelDrive:
    """What the land controller asks of the motors."""

    left_mps: float
    right_mps: float
    braked: bool


class Body(Protocol):
    """What moves the robot while its rotors may turn."""

    def reset(
        self,
        position_m: Array,
        yaw_rad: float,
        *,
        quaternion: Array | None = None,
        velocity_mps: Array | None = None,
    ) -> None:
        """Take the robot over with still rotors."""
        ...

    def set_floor(self, z_m: float) -> None:
        """Height of the floor under the robot [m]."""
        ...

    def set_wind(self, wind_mps: Array) -> None:
        """Velocity of the air (3,) [m/s]."""
        ...

    def set_volts(self, volts: float) -> None:
        """Terminal voltage of the pack [V]."""
        ...

    def step(self, motor_commands: Array | Sequence[float]) -> QuadState:
        """Advance by `STEP_S` with (4,) duties."""
        ...


class Plant:
    """True state of the robot in its world.

    Args:
        config: The robot.
        surface: The world's triangles.
        start: x, y [m], heading [rad] and height of the floor [m] in odom.
        seed: For wheel slip and wind.
        disturbances: Wind, slip, lags and battery; still air and the usual slip when left out.
        quad: What flies; JSBSim's quadrotor when left out.
    """

    def __init__(
        self,
        config: RobotConfig,
        surface: Surface,
        start: tuple[float, float, float, float],
        seed: int,
        disturbances: Disturbances | None = None,
        quad: Body | None = None,
    ) -> None:
        d = disturbances or Disturbances()
        self._body = config.body
        self._surface = surface
        self.quad: Body = Quad(STEP_S) if quad is None else quad
        self.rover = Rover(config, seed, d.slip, d.actuators.wheel_tau_s)
        self.battery = Battery(
            config.energy.pack_j, remaining=d.battery.charge, resistance_ohm=d.battery.resistance_ohm
        )
        self.wind = WindField(d.wind, seed)
        lag_s = d.actuators.rotor_lag_s
        self._duty_share = 1.0 - math.exp(-STEP_S / lag_s) if lag_s > 0.0 else 1.0
        self._duty = list(_STILL)
        self._chassis = Chassis(config, surface, self.rover, STEP_S)
        x, y, yaw, floor_z_m = start
        self.state = self._chassis.place(x, y, yaw, floor_z_m + START_REACH_M)
        self._floor = self._chassis.plane
        self._steps = 0
        self._seen: Array | None = None  # (3,) where `clearance_m` was found
        self.clearance_m = 0.0
        self._look_around()
        self.falls = 0  # times the floor under the middle of the body ended

    @property
    def floor_z_m(self) -> float:
        """Height of the floor under the robot, odom [m]."""
        return self._floor.z_m

    def pins(self, *, armed: bool) -> Inputs:
        """What the land controller's pins tell it; `armed` puts power on the rotors."""
        rolled = self.rover.state
        return Inputs(
            battery_v=self.battery.volts,
            current_a=self.battery.current_a,
            wheel_load=self.wheel_load,
            rotors_possible=armed,
            left_ticks=rolled.left_ticks,
            right_ticks=rolled.right_ticks,
        )

    @property
    def wheel_load(self) -> bool:
        """Whether the suspension switches are closed."""
        return self.state.on_wheels or float(self.state.wheel_load_n.sum()) > LOADED_N

    @property
    def height_m(self) -> float:
        """Wheels above the floor."""
        if self.state.on_wheels:
            return 0.0
        return float(self.state.position_m[2]) - self._body.below_m - self._floor.z_m

    def step(self, motors: Array | None, drive: WheelDrive) -> QuadState:
        """Advance by `STEP_S`.

        Args:
            motors: (4,) duty of the rotors, None while they are off.
            drive: Wheel targets.
        """
        if self._steps % NEAR_EVERY == 0 and not self.wind.still:
            self.quad.set_wind(self.wind.step(NEAR_EVERY * STEP_S))
        self._look_down()
        if motors is None and self.state.on_wheels:
            self.state = self._chassis.roll(
                self.state, drive.left_mps, drive.right_mps, drive.braked, self.clearance_m
            )
            self._floor = self._chassis.plane
        else:
            self._fly(motors, drive)
        self.battery.draw("rotors", self.state.electrical_w)
        self.battery.draw("wheels", self.rover.state.watts)
        self.battery.step(STEP_S)
        if self._steps % NEAR_EVERY == 0:
            self._look_around()
        self._steps += 1
        return self.state

    def _look_down(self) -> None:
        """Where the floor is: often under the wheels, seldom from high up."""
        if self.state.on_wheels:
            if self._steps % WHEELS_EVERY == 0:
                self._chassis.look_down(self.state)
                if self._chassis.lost_floor:
                    self._fall()
        elif self._steps % (NEAR_EVERY if self.height_m < LOOK_M else FLOOR_EVERY) == 0:
            x, y, z = self.state.position_m.tolist()
            if self.height_m < LOOK_M:
                self._floor = self._chassis.plane_below(self.state.position_m, yaw_of(self.state.quaternion))
            else:
                floor = self._surface.floor_below(x, y, z)
                self._floor = Plane(floor if math.isfinite(floor) else 0.0)
            self.quad.set_floor(self._floor.z_m)

    def _look_around(self) -> None:
        position = self.state.position_m
        if position is self._seen:
            return
        self._seen = position
        near = self.height_m < NEAR_FLOOR_M
        slope = self._floor.slope if near else (0.0, 0.0)
        self.clearance_m = self._surface.clearance(position, on_floor=near, slope=slope)

    def _fall(self) -> None:
        """The floor has ended under the middle: the body goes on as a thrown one."""
        self.falls += 1
        x, y, z = self.state.position_m.tolist()
        floor = self._surface.floor_below(x, y, z)
        self._floor = Plane(floor if math.isfinite(floor) else 0.0)
        self._let_go(self.state.position_m)

    def _let_go(self, position_m: Array) -> None:
        """Hand the body to the quad's physics as it moves."""
        s = self.state
        self.quad.set_floor(self._floor.z_m)
        self.quad.reset(position_m, 0.0, quaternion=s.quaternion, velocity_mps=s.velocity_mps)
        self._duty = list(_STILL)
        self.state = replace(s, position_m=position_m, on_wheels=False)

    def _fly(self, motors: Array | None, drive: WheelDrive) -> None:
        if self.state.on_wheels:
            self._let_go(self._above_flat_floor())
        self.rover.step(STEP_S, 0.0, 0.0, braked=drive.braked)
        self.quad.set_volts(self.battery.volts)
        asked: Sequence[float] = _STILL if motors is None else motors.tolist()
        if self._duty_share < 1.0:
            share = self._duty_share
            asked = [now + share * (aim - now) for now, aim in zip(self._duty, asked, strict=True)]
            self._duty = asked
        self.state = self.quad.step(asked)
        if motors is None:
            vx, vy, vz = self.state.velocity_mps.tolist()
            slow = vx * vx + vy * vy + vz * vz < REST_MPS * REST_MPS
            if slow and float(self.state.wheel_load_n.sum()) > LOADED_N:
                self.state = self._chassis.take(self.state, yaw_of(self.state.quaternion))

    def _above_flat_floor(self) -> Array:
        """Where a tilted body just touches JSBSim's floor, which is flat: from there it sits down level."""
        roll, pitch = roll_pitch_of(self.state.quaternion)
        reach = AXLE_M * abs(math.sin(pitch)) + 0.5 * self._body.track_m * abs(math.sin(roll))
        deeper = reach + CONTACT_M * math.cos(roll) * math.cos(pitch) - CONTACT_M
        x, y, z = self.state.position_m.tolist()
        return np.array([x, y, max(z, self._floor.z_m + self._body.below_m + deeper)])
