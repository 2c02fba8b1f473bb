"""The robot on its wheels: where the rover takes it over the terrain, and what an IMU would feel there."""

from __future__ import annotations

import math

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.types import Array
from sim.quad.state import QuadState
from sim.rover import Rover
from sim.terrain import Footing, Plane, Suspension
from sim.worlds.surface import Surface

GRAVITY_MPS2 = 9.80665
LOOK_M, LOOK_RAD = 0.01, 0.05  # ways after which the wheels look down again
FRICTION = 0.7  # rubber on a dry floor, as the brakes in rover.py


class Chassis:
    """Moves the body over the floor.

    Args:
        config: Outline and mass.
        surface: The world's triangles.
        rover: Drives it.
        step_s: Step of the physics [s].
    """

    def __init__(self, config: RobotConfig, surface: Surface, rover: Rover, step_s: float) -> None:
        self._below_m = config.body.below_m
        self._load_n = np.full(4, 0.25 * config.body.mass_kg * GRAVITY_MPS2)
        self._surface = surface
        self._rover = rover
        self._footing = Footing(surface, config.body)
        self._step_s = step_s
        self._suspension = Suspension(Plane(0.0))
        self._slide_mps = 0.0  # downhill, along the slope
        self._roll_pitch = (0.0, 0.0)
        self._looked: tuple[float, float, float] | None = None  # x, y, yaw of the last look down
        self._stood = False  # already before the last step: it feels no braking any more
        self.yaw_rad = 0.0
        self.lost_floor = False  # nothing carries the middle of the body any more

    @property
    def plane(self) -> Plane:
        """What the body rests on, at its x and y."""
        return self._suspension.plane

    def plane_below(self, position_m: Array, yaw_rad: float) -> Plane:
        """The floor's plane below a body in the air."""
        x, y, z = position_m.tolist()
        return self._footing.find(x, y, yaw_rad, z)

    def place(self, x_m: float, y_m: float, yaw_rad: float, look_from_m: float) -> QuadState:
        """Stand at rest on the highest floor below `look_from_m` [m]."""
        plane = self._footing.find(x_m, y_m, yaw_rad, look_from_m)
        self._suspension = Suspension(plane)
        return self._rest(np.array([x_m, y_m, plane.z_m + self._below_m * plane.steep]), yaw_rad)

    def take(self, state: QuadState, yaw_rad: float) -> QuadState:
        """Take over a body that came to rest level on its wheels; it settles onto the terrain from there."""
        x, y, z = state.position_m.tolist()
        self._suspension = Suspension(Plane(z - self._below_m))
        self._suspension.aim(self._footing.find(x, y, yaw_rad, z))
        return self._rest(state.position_m, yaw_rad)

    def _rest(self, position_m: Array, yaw_rad: float) -> QuadState:
        self.yaw_rad, self._slide_mps, self.lost_floor = yaw_rad, 0.0, False
        self._looked, self._stood = None, True
        roll, pitch = self._roll_pitch = self.plane.roll_pitch(yaw_rad)
        return QuadState(
            position_m=position_m,
            velocity_mps=np.zeros(3),
            quaternion=quaternion_from_rpy(roll, pitch, yaw_rad),
            angular_velocity_rps=np.zeros(3),
            specific_force_mps2=_in_body(0.0, 0.0, GRAVITY_MPS2, roll, pitch, yaw_rad),
            electrical_w=0.0,
            wheel_load_n=self._load_n,
            on_wheels=True,
        )

    def look_down(self, state: QuadState) -> None:
        """Find the floor under the wheels anew, if the robot has moved since by more than a little."""
        x, y, _ = state.position_m.tolist()
        here = (x, y, self.yaw_rad)
        if self._looked is not None and _near(here, self._looked):
            return
        self._looked = here
        target, self.lost_floor = self._footing.follow(self._suspension.target, x, y, self.yaw_rad)
        if not self.lost_floor:
            self._suspension.aim(target)

    def roll(
        self,
        before: QuadState,
        left: float,
        right: float,
        braked: bool,
        clearance_m: float,
        volts: float | None = None,
    ) -> QuadState:
        """Advance by one step with targets as for `Rover.step`; `clearance_m` is that of the state before."""
        dt = self._step_s
        plane = self.plane
        ahead = plane.east * math.cos(self.yaw_rad) + plane.north * math.sin(self.yaw_rad)
        level = 1.0 / math.sqrt(1.0 + ahead * ahead)
        rolled = self._rover.step(dt, left, right, braked=braked, sine=ahead * level, volts=volts)
        v, w = rolled.v_mps, rolled.w_rps
        if plane.rise > FRICTION or self._slide_mps > 0.0:
            v, w = 0.0, 0.0  # what grip there is goes into the slide
        elif v == 0.0 and w == 0.0 and self._suspension.settled and _at_rest(before):
            if self._stood:
                return before
            self._stood = True
        else:
            self._stood = False
        middle = self.yaw_rad + 0.5 * w * dt
        way = v * level * dt
        dx, dy = way * math.cos(middle), way * math.sin(middle)
        if plane.rise > FRICTION or self._slide_mps > 0.0:
            down = self._slid(plane) / plane.rise if plane.rise > 0.0 else 0.0
            dx, dy = dx - plane.east * down, dy - plane.north * down
        x, y, z = before.position_m.tolist()
        if clearance_m <= 0.0 and (dx or dy) and self._deeper(plane, x + dx, y + dy, clearance_m):
            dx = dy = self._slide_mps = 0.0  # an obstacle does not give way
        plane = self._suspension.step(dt, dx, dy)
        return self._moved(before, (x, y, z), dx, dy, plane, w)

    def _slid(self, plane: Plane) -> float:
        """Way over ground, seen from above, that the robot slides down in this step [m]."""
        pull = GRAVITY_MPS2 * (plane.rise - FRICTION) / plane.steep
        self._slide_mps = max(0.0, self._slide_mps + pull * self._step_s)
        return self._slide_mps / plane.steep * self._step_s

    def _deeper(self, plane: Plane, x_m: float, y_m: float, clearance_m: float) -> bool:
        there = np.array([x_m, y_m, plane.z_m + self._below_m * plane.steep])
        return self._surface.clearance(there, on_floor=True, slope=plane.slope) < clearance_m

    def _moved(
        self,
        before: QuadState,
        place_m: tuple[float, float, float],
        dx_m: float,
        dy_m: float,
        plane: Plane,
        w_rps: float,
    ) -> QuadState:
        dt, g = self._step_s, GRAVITY_MPS2
        x, y, z_before = place_m
        z = plane.z_m + self._below_m * plane.steep
        roll_before, pitch_before = self._roll_pitch
        tilted = plane.east != 0.0 or plane.north != 0.0
        turned = w_rps * math.cos(roll_before) / math.cos(pitch_before) if tilted else w_rps
        yaw = self.yaw_rad = math.remainder(self.yaw_rad + turned * dt, 2.0 * math.pi)
        roll, pitch = self._roll_pitch = plane.roll_pitch(yaw) if tilted else (0.0, 0.0)
        vx, vy, vz = dx_m / dt, dy_m / dt, (z - z_before) / dt
        wx, wy, wz = before.velocity_mps.tolist()
        rates = _body_rates((roll - roll_before) / dt, (pitch - pitch_before) / dt, turned, roll, pitch)
        return QuadState(
            position_m=np.array([x + dx_m, y + dy_m, z]),
            velocity_mps=np.array([vx, vy, vz]),
            quaternion=quaternion_from_rpy(roll, pitch, yaw),
            angular_velocity_rps=rates,
            specific_force_mps2=_in_body(
                (vx - wx) / dt, (vy - wy) / dt, (vz - wz) / dt + g, roll, pitch, yaw
            ),
            electrical_w=0.0,
            wheel_load_n=self._load_n,
            on_wheels=True,
        )


def _at_rest(state: QuadState) -> bool:
    return not (state.velocity_mps.any() or state.angular_velocity_rps.any())


def _near(a: tuple[float, float, float], b: tuple[float, float, float]) -> bool:
    """Whether the wheels stand as good as where they stood."""
    along = abs(a[0] - b[0]) + abs(a[1] - b[1])
    return along < LOOK_M and abs(math.remainder(a[2] - b[2], 2.0 * math.pi)) < LOOK_RAD


def _in_body(x: float, y: float, z: float, roll: float, pitch: float, yaw: float) -> Array:
    """A vector of the world in a body with these z-y-x angles (FLU)."""
    c, s = math.cos(yaw), math.sin(yaw)
    ahead, left = x * c + y * s, y * c - x * s
    if roll == 0.0 and pitch == 0.0:
        return np.array([ahead, left, z])
    c, s = math.cos(pitch), math.sin(pitch)
    ahead, up = c * ahead - s * z, s * ahead + c * z
    c, s = math.cos(roll), math.sin(roll)
    return np.array([ahead, c * left + s * up, c * up - s * left])


def _body_rates(roll_rate: float, pitch_rate: float, yaw_rate: float, roll: float, pitch: float) -> Array:
    """Angular velocity in body (3,) [rad/s] from the rates of z-y-x angles."""
    if roll == 0.0 and pitch == 0.0:
        return np.array([roll_rate, pitch_rate, yaw_rate])
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    return np.array(
        [
            roll_rate - yaw_rate * sp,
            pitch_rate * cr + yaw_rate * sr * cp,
            yaw_rate * cr * cp - pitch_rate * sr,
        ]
    )
