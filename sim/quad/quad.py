"""`Quad`: the JSBSim model in world coordinates (ENU, metres), stepped at 250 Hz.

JSBSim knows places as latitude and longitude on a planet. Ours is a sphere at rest (`planet.xml`), and the
world's origin lies at latitude 0, longitude 0, height 0: east = R*longitude and north = R*latitude hold to
0.1 mm within a kilometre. A reset is a new initial condition (3 ms), never a reload.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import jsbsim
import numpy as np

from labr_autonomy.errors import BadInput
from labr_autonomy.frames import (
    quaternion_enu_flu_to_ned_frd,
    quaternion_from_rpy,
)
from labr_autonomy.types import Array
from sim.quad.state import QuadState

STEP_S = 0.004
G_MPS2 = 9.80665
CONTACT_M = 0.1221  # contacts below the origin, labr_quad.xml
_ROOT = Path(__file__).with_name("jsbsim")
_RADIUS_M = 6_371_000.0  # planet.xml
_FOOT_M = 0.3048
_POUND_N = 4.4482216152605
_MOTORS = range(4)
_WAYS = ("east", "north", "down")
_READ = (
    *("attitude/phi-rad", "attitude/theta-rad", "attitude/psi-rad"),
    *("position/long-gc-rad", "position/lat-geod-rad", "position/h-sl-ft"),
    *("velocities/v-east-fps", "velocities/v-north-fps", "velocities/v-down-fps"),
    *("velocities/p-rad_sec", "velocities/q-rad_sec", "velocities/r-rad_sec"),
    *(f"accelerations/a-pilot-{axis}-ft_sec2" for axis in "xyz"),
    *("esc/watts", "forces/fbz-gear-lbs"),
    *(f"contact/unit[{i}]/compression-ft" for i in _MOTORS),
)
_HALF = math.sqrt(0.5)


def _silence() -> None:
    """Keep JSBSim's banner off the terminal; errors still show."""
    logger = jsbsim.DefaultLogger()
    logger.set_min_level(jsbsim.LogLevel.ERROR)
    jsbsim.set_logger(logger)


class Quad:
    """The quad's physics.

    Args:
        step_s: Integration step [s]; fixed for the life of the object, because JSBSim bakes it into filters.
    """

    def __init__(self, step_s: float = STEP_S) -> None:
        self.step_s = step_s
        self._floor_m = 0.0
        self._wind_mps = np.zeros(3)
        _silence()
        model = jsbsim.FGFDMExec(str(_ROOT))
        model.set_debug_level(0)
        if not model.load_planet(str(_ROOT / "planet.xml"), False):
            raise BadInput(f"JSBSim does not load {_ROOT / 'planet.xml'}", "Reinstall the project.")
        model.set_dt(step_s)  # before load_model
        if not model.load_model("labr_quad"):
            raise BadInput(f"JSBSim does not load the model labr_quad in {_ROOT}", "Reinstall the project.")
        self._model = model
        # A property looked up by its name costs 0.2 to 1.3 us, a kept node 0.05.
        self._get = [self._node(name).get_double_value for name in _READ]
        self._commands = [self._node(f"esc/cmd-norm[{i}]").set_double_value for i in _MOTORS]
        self._volts = self._node("battery/volts").set_double_value
        self._air = [self._node(f"atmosphere/wind-{way}-fps").set_double_value for way in _WAYS]
        self._state: QuadState | None = None
        self.reset(np.array([0.0, 0.0, 0.12]), 0.0)

    def _node(self, name: str) -> jsbsim.FGPropertyNode:
        node = self._model.get_property_manager().get_node(name)
        if node is None:
            raise BadInput(f"JSBSim's model has no property {name}", "Reinstall the project.")
        return node

    @property
    def state(self) -> QuadState:
        """True state after the last step."""
        if self._state is None:
            self._state = self._read()
        return self._state

    def reset(
        self,
        position_m: Array,
        yaw_rad: float,
        *,
        quaternion: Array | None = None,
        velocity_mps: Array | None = None,
    ) -> None:
        """Place the robot with still rotors.

        Args:
            position_m: (3,) body origin, world [m].
            yaw_rad: Heading, world [rad]; ignored when `quaternion` is given.
            quaternion: (4,) wxyz, body to world; level when omitted.
            velocity_mps: (3,) world [m/s]; at rest when omitted.
        """
        model = self._model
        velocity = np.zeros(3) if velocity_mps is None else np.array(velocity_mps, dtype=float)
        if quaternion is None:
            quaternion = quaternion_from_rpy(0.0, 0.0, yaw_rad)
        phi, theta, psi = _euler(quaternion_enu_flu_to_ned_frd(quaternion))
        model["ic/lat-geod-rad"] = float(position_m[1]) / _RADIUS_M
        model["ic/long-gc-rad"] = float(position_m[0]) / _RADIUS_M
        model["ic/terrain-elevation-ft"] = self._floor_m / _FOOT_M
        model["ic/h-sl-ft"] = float(position_m[2]) / _FOOT_M
        model["ic/phi-rad"], model["ic/theta-rad"], model["ic/psi-true-rad"] = phi, theta, psi
        for name in ("p-rad_sec", "q-rad_sec", "r-rad_sec"):
            model["ic/" + name] = 0.0
        for name, value in zip(("e", "n", "d"), velocity * (1.0, 1.0, -1.0), strict=True):
            model[f"ic/v{name}-fps"] = float(value) / _FOOT_M
        for i in _MOTORS:
            model[f"esc/cmd-norm[{i}]"] = 0.0
        # The first pass leaves the forces of the moment before in the integrators; one step with still rotors
        # replaces them by those of the new place, from which the second pass starts.
        for last in (False, True):
            if not model.run_ic():
                raise BadInput(
                    f"JSBSim refuses to start at {np.round(position_m, 3).tolist()} m",
                    "Choose another start pose.",
                )
            self.set_wind(self._wind_mps)  # an initial condition stills the air
            model["propulsion/set-running"] = -1
            if not last:
                model.run()
        # The accelerometer of the initial condition is left over from the moment before it.
        touching = float(position_m[2]) - self._floor_m <= CONTACT_M
        rest = np.array([0.0, 0.0, G_MPS2 if touching else 0.0])
        self._state = QuadState(
            position_m=np.asarray(position_m, dtype=float).copy(),
            velocity_mps=velocity,
            quaternion=quaternion / np.linalg.norm(quaternion),
            angular_velocity_rps=np.zeros(3),
            specific_force_mps2=rest,
            electrical_w=0.0,
            wheel_load_n=np.full(4, 0.25 * 3.4 * rest[2]),
        )

    def set_floor(self, z_m: float) -> None:
        """Height of the floor under the robot, world z [m]; may change from step to step."""
        self._floor_m = z_m
        self._model["position/terrain-elevation-asl-ft"] = z_m / _FOOT_M

    def set_wind(self, wind_mps: Array) -> None:
        """Velocity of the air, world (3,) [m/s]; kept over a reset."""
        self._wind_mps = np.array(wind_mps, dtype=float)
        east, north, up = self._wind_mps.tolist()
        for blow, value in zip(self._air, (east, north, -up), strict=True):
            blow(value / _FOOT_M)

    def set_volts(self, volts: float) -> None:
        """Terminal voltage of the pack [V]."""
        self._volts(volts)

    def step(self, motor_commands: Array | Sequence[float]) -> QuadState:
        """Advance by one step.

        Args:
            motor_commands: (4,) duty 0..1 of front right, rear left, front left, rear right (PX4's order).

        Returns:
            The state after the step.
        """
        for command, duty in zip(self._commands, motor_commands, strict=True):
            command(float(duty))
        self._model.run()
        self._state = self._read()
        return self._state

    def _read(self) -> QuadState:
        phi, theta, psi, lon, lat, high, ve, vn, vd, p, q, r, fx, fy, fz, watts, gear, *pressed = [
            get() for get in self._get
        ]
        return QuadState(
            position_m=np.array([lon * _RADIUS_M, lat * _RADIUS_M, high * _FOOT_M]),
            velocity_mps=np.array([ve * _FOOT_M, vn * _FOOT_M, -vd * _FOOT_M]),
            quaternion=_attitude(phi, theta, psi),
            angular_velocity_rps=np.array([p, -q, -r]),
            specific_force_mps2=np.array([fx * _FOOT_M, -fy * _FOOT_M, -fz * _FOOT_M]),
            electrical_w=watts,
            wheel_load_n=_loads(gear, pressed),
        )


def _loads(gear_lbs: float, pressed_ft: list[float]) -> Array:
    """Load of each wheel [N]: the vertical contact force, shared by how far each spring is pressed in."""
    a, b, c, d = (max(0.0, p) for p in pressed_ft)
    total = a + b + c + d
    if total <= 0.0:
        return np.zeros(4)
    each = max(0.0, -gear_lbs * _POUND_N) / total
    return np.array([a * each, b * each, c * each, d * each])


def _attitude(phi: float, theta: float, psi: float) -> Array:
    """Body-FLU-in-ENU quaternion (4,) wxyz, w >= 0, of JSBSim's Euler angles.

    `frames.quaternion_ned_frd_to_enu_flu` written out: it is two products with constants.
    """
    w, x, y, z = quaternion_from_rpy(phi, theta, psi).tolist()
    a, b, c, d = _HALF * (w + z), _HALF * (x + y), _HALF * (x - y), _HALF * (w - z)
    return np.array([a, b, c, d]) if a >= 0.0 else np.array([-a, -b, -c, -d])


def _euler(q: Array) -> tuple[float, float, float]:
    """Roll, pitch and heading [rad] of a NED-FRD quaternion, z-y-x."""
    w, x, y, z = (float(v) for v in q)
    phi = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    theta = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
    return phi, theta, math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
