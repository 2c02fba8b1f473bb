"""PX4's cascade on a 3.4 kg quad: position P -> velocity PI -> attitude P -> rates PI -> mixer.

NED and FRD. Gains are PX4's defaults where the layer is PX4's; rate gains come from the quad's inertia.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim.autopilot.estimator import Estimate
from sim.autopilot.vectors import (
    UNKNOWN,
    ZERO,
    Quaternion,
    Vector,
    clip,
    from_angles,
    matrix,
    rotate,
    wrap,
    yaw_of,
)

G_MPS2 = 9.80665
MASS_KG = 3.4
INERTIA_KGM2 = (0.038, 0.042, 0.068)  # labr_quad.xml
ARM_M = 0.12
TORQUE_M = 0.0161  # propeller torque over thrust: Cp*D / (2*pi*Ct)

POSITION_P = (0.95, 0.95, 1.0)  # MPC_XY_P, MPC_Z_P [1/s]
VELOCITY_P = (1.8, 1.8, 4.0)  # MPC_XY_VEL_P_ACC, MPC_Z_VEL_P_ACC [1/s]
VELOCITY_I = (0.4, 0.4, 2.0)  # MPC_XY_VEL_I_ACC, MPC_Z_VEL_I_ACC [1/s^2]
VELOCITY_D = (0.2, 0.2, 0.0)  # MPC_XY_VEL_D_ACC [-]
INTEGRAL_MAX_MPS2 = 3.0
SPEED_XY_MPS = 12.0  # MPC_XY_VEL_MAX
SPEED_UP_MPS = 3.0  # MPC_Z_VEL_MAX_UP
SPEED_DOWN_MPS = 1.5  # MPC_Z_VEL_MAX_DN
TILT_RAD = math.radians(35.0)  # MPC_TILTMAX_AIR is 45 deg; a robot that flies indoors takes less
ATTITUDE_P = (6.5, 6.5, 2.8)  # MC_ROLL_P, MC_PITCH_P, MC_YAW_P [1/s]
RATE_P = (18.0, 18.0, 6.0)  # [1/s], times inertia
RATE_I = (10.0, 10.0, 3.0)  # [1/s^2], times inertia
RATE_MAX_RPS = (3.8, 3.8, 1.5)

# Motor volts of a thrust: V = a*sqrt(T) + b*T, fitted to the model's propeller and winding.
VOLT_PER_ROOT_N = 3.182
VOLT_PER_N = 0.1857
THRUST_MIN_N = 0.3  # MPC_THR_MIN, for authority
IDLE_V = 2.5


@dataclass(frozen=True, slots=True)
class Target:
    """What to fly; NaN where nothing is demanded."""

    position_m: Vector = UNKNOWN
    velocity_mps: Vector = UNKNOWN
    acceleration_mps2: Vector = UNKNOWN
    yaw_rad: float = math.nan
    yaw_rate_rps: float = math.nan


@dataclass(frozen=True, slots=True)
class Demand:
    """What the cascade made of the target; shown in telemetry."""

    velocity_mps: Vector = UNKNOWN
    acceleration_mps2: Vector = UNKNOWN
    attitude: Quaternion = (1.0, 0.0, 0.0, 0.0)
    rates_rps: Vector = ZERO
    thrust_n: float = 0.0


class Controller:
    """The cascade with its integrators."""

    def __init__(self) -> None:
        self._integral_mps2 = [0.0, 0.0, 0.0]
        self._rate_integral = [0.0, 0.0, 0.0]
        self._last_velocity: Vector | None = None
        self._slope: list[float] = [0.0, 0.0, 0.0]
        self.demand = Demand()

    def reset(self) -> None:
        """Forget everything; on the ground."""
        self._integral_mps2 = [0.0, 0.0, 0.0]
        self._rate_integral = [0.0, 0.0, 0.0]
        self._last_velocity = None
        self._slope = [0.0, 0.0, 0.0]
        self.demand = Demand()

    def idle(self, volts: float) -> list[float]:
        """Motors turning without lift, (4,) duty."""
        self.reset()
        return [clip(IDLE_V / max(volts, 1.0), 0.0, 1.0)] * 4

    def step(self, dt_s: float, now: Estimate, target: Target, *, share: float, volts: float) -> list[float]:
        """One tick.

        Args:
            dt_s: Time since the last tick [s].
            now: The estimate.
            target: What to fly.
            share: Upper limit of the thrust over that of hovering (take-off ramp).
            volts: Terminal voltage of the pack [V].

        Returns:
            (4,) duty of front right, rear left, front left, rear right.
        """
        cap_n = share * MASS_KG * G_MPS2
        velocity = wanted_velocity(now, target)
        acceleration = self._acceleration(dt_s, now, target, velocity, frozen=share < 1.0)
        yaw_rad = target.yaw_rad if math.isfinite(target.yaw_rad) else now.yaw_rad
        attitude, thrust_n = _attitude_thrust(acceleration, yaw_rad)
        thrust_n = min(thrust_n, cap_n)
        feed_rps = target.yaw_rate_rps if math.isfinite(target.yaw_rate_rps) else 0.0
        rates = _wanted_rates(now.attitude, attitude, feed_rps)
        torque = self._torque(dt_s, now.rates_rps, rates, frozen=share < 0.6)
        self.demand = Demand(velocity, acceleration, attitude, rates, thrust_n)
        return mix(thrust_n, torque, volts)

    def _acceleration(
        self, dt_s: float, now: Estimate, target: Target, velocity: Vector, *, frozen: bool
    ) -> Vector:
        slope = self._velocity_slope(dt_s, now.velocity_mps)
        out = []
        for i in range(3):
            feed = target.acceleration_mps2[i]
            value = feed if math.isfinite(feed) else 0.0
            error = velocity[i] - now.velocity_mps[i]
            if math.isfinite(error):
                if not frozen:
                    grown = self._integral_mps2[i] + VELOCITY_I[i] * error * dt_s
                    self._integral_mps2[i] = clip(grown, -INTEGRAL_MAX_MPS2, INTEGRAL_MAX_MPS2)
                value += VELOCITY_P[i] * error + self._integral_mps2[i] - VELOCITY_D[i] * slope[i]
            out.append(value)
        return out[0], out[1], out[2]

    def _velocity_slope(self, dt_s: float, velocity: Vector) -> list[float]:
        """Low-passed derivative of the velocity (5 Hz, MPC_VELD_LP) [m/s^2]."""
        last, self._last_velocity = self._last_velocity, velocity
        if last is not None and dt_s > 0.0:
            gain = dt_s / (dt_s + 1.0 / (2.0 * math.pi * 5.0))
            for i in range(3):
                self._slope[i] += gain * ((velocity[i] - last[i]) / dt_s - self._slope[i])
        return self._slope

    def _torque(self, dt_s: float, rates: Vector, wanted: Vector, *, frozen: bool) -> Vector:
        out = []
        for i in range(3):
            error = wanted[i] - rates[i]
            if not frozen:
                self._rate_integral[i] = clip(self._rate_integral[i] + RATE_I[i] * error * dt_s, -8.0, 8.0)
            out.append(INERTIA_KGM2[i] * (RATE_P[i] * error + self._rate_integral[i]))
        return out[0], out[1], out[2]


def wanted_velocity(now: Estimate, target: Target) -> Vector:
    """Position P plus velocity feed-forward, within the speed limits; NaN on axes without either."""
    out = []
    for i in range(3):
        value = target.velocity_mps[i]
        error = target.position_m[i] - now.position_m[i]
        if math.isfinite(target.position_m[i]):
            pull = POSITION_P[i] * error if math.isfinite(error) else 0.0
            value = pull + (value if math.isfinite(value) else 0.0)
        out.append(value)
    speed = math.hypot(out[0], out[1])
    if speed > SPEED_XY_MPS:
        out[0], out[1] = out[0] * SPEED_XY_MPS / speed, out[1] * SPEED_XY_MPS / speed
    if math.isfinite(out[2]):
        out[2] = clip(out[2], -SPEED_UP_MPS, SPEED_DOWN_MPS)
    return out[0], out[1], out[2]


def _attitude_thrust(acceleration: Vector, yaw_rad: float) -> tuple[Quaternion, float]:
    """Attitude and thrust [N] that give an acceleration; height has priority over the horizontal."""
    lift = max(0.1 * G_MPS2, G_MPS2 - acceleration[2])
    ax, ay = acceleration[0], acceleration[1]
    flat = math.hypot(ax, ay)
    limit = lift * math.tan(TILT_RAD)
    if flat > limit:
        ax, ay, flat = ax * limit / flat, ay * limit / flat, limit
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    forward, right = c * ax + s * ay, -s * ax + c * ay
    pitch = -math.atan2(forward, lift)
    roll = math.atan2(right, math.hypot(lift, forward))
    return from_angles(roll, pitch, yaw_rad), MASS_KG * math.hypot(lift, flat)


def _wanted_rates(now: Quaternion, wanted: Quaternion, yaw_rate_rps: float) -> Vector:
    """Body rates that lift the thrust axis upright first and turn the nose second."""
    axes = matrix(now)
    goal = matrix(wanted)
    down = (goal[0][2], goal[1][2], goal[2][2])
    # The wanted thrust axis seen from the body; the shortest turn to it lies in the body's x-y plane.
    seen = (
        axes[0][0] * down[0] + axes[1][0] * down[1] + axes[2][0] * down[2],
        axes[0][1] * down[0] + axes[1][1] * down[1] + axes[2][1] * down[2],
        axes[0][2] * down[0] + axes[1][2] * down[1] + axes[2][2] * down[2],
    )
    across = math.hypot(seen[0], seen[1])
    angle = math.atan2(across, seen[2])
    scale = angle / across if across > 1e-9 else 1.0
    yaw_error = wrap(yaw_of(wanted) - yaw_of(now))
    yaw = clip(ATTITUDE_P[2] * yaw_error + yaw_rate_rps, -RATE_MAX_RPS[2], RATE_MAX_RPS[2])
    turning = rotate(_transposed(axes), (0.0, 0.0, yaw))
    return (
        clip(-ATTITUDE_P[0] * scale * seen[1] + turning[0], -RATE_MAX_RPS[0], RATE_MAX_RPS[0]),
        clip(ATTITUDE_P[1] * scale * seen[0] + turning[1], -RATE_MAX_RPS[1], RATE_MAX_RPS[1]),
        turning[2],
    )


def _transposed(m: tuple[Vector, Vector, Vector]) -> tuple[Vector, Vector, Vector]:
    return (m[0][0], m[1][0], m[2][0]), (m[0][1], m[1][1], m[2][1]), (m[0][2], m[1][2], m[2][2])


def mix(thrust_n: float, torque_nm: Vector, volts: float) -> list[float]:
    """Duty of the four motors; tilting has priority, then lift, then turning.

    Args:
        thrust_n: Sum of the thrusts [N].
        torque_nm: (3,) about forward, right, down [N*m].
        volts: Terminal voltage [V]; the duty makes up for its sag.
    """
    most = _thrust_of_volts(volts)
    least = min(THRUST_MIN_N, thrust_n / 4.0)
    roll, pitch = torque_nm[0] / (4.0 * ARM_M), torque_nm[1] / (4.0 * ARM_M)
    tilt = (pitch - roll, roll - pitch, roll + pitch, -roll - pitch)
    room = max(0.0, most - least)
    largest = max(tilt)
    if 2.0 * largest > room and largest > 0.0:
        tilt = tuple(t * room / (2.0 * largest) for t in tilt)  # type: ignore[assignment]
        largest = room / 2.0
    lift = clip(thrust_n / 4.0, min(least + largest, thrust_n / 2.0), most - largest)
    spare = min(lift - largest - least, most - lift - largest)
    yaw = clip(torque_nm[2] / (4.0 * TORQUE_M), -max(spare, 0.0), max(spare, 0.0))
    forces = (lift + tilt[0] + yaw, lift + tilt[1] + yaw, lift + tilt[2] - yaw, lift + tilt[3] - yaw)
    idle = IDLE_V / max(volts, 1.0)
    return [clip(_volts_of_thrust(f) / max(volts, 1.0), idle, 1.0) for f in forces]


def _volts_of_thrust(thrust_n: float) -> float:
    thrust_n = max(thrust_n, 0.0)
    return VOLT_PER_ROOT_N * math.sqrt(thrust_n) + VOLT_PER_N * thrust_n


def _thrust_of_volts(volts: float) -> float:
    a, b = VOLT_PER_ROOT_N, VOLT_PER_N
    root = (-a + math.sqrt(a * a + 4.0 * b * max(volts, 1.0))) / (2.0 * b)
    return root * root
