"""Error-state Kalman filter of position, velocity, attitude and IMU biases: the arithmetic, without a clock.

Error state (15): position [m] odom, velocity [m/s] odom, rotation [rad] body, gyroscope bias [rad/s],
accelerometer bias [m/s^2]; the true attitude is q * exp(rotation). After J. Sola, "Quaternion kinematics
for the error-state Kalman filter" (2017), sections 5 and 7, with the body-fixed rotation error.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from labr_autonomy.estimation import correction, strapdown
from labr_autonomy.estimation.vio_message import VioSample
from labr_autonomy.types import Array, ImuSample

GRAVITY_MPS2 = 9.80665  # ISO 80000-3
P, V, R, BG, BA = (slice(i, i + 3) for i in range(0, 15, 3))
_DIAGONAL = np.arange(15)
_EYE, _EYE15 = np.eye(3), np.eye(15)


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations. The IMU's hold for a Pixhawk on a flying frame: propellers alias into 50 Hz."""

    accelerometer_mps2_rthz: float = 0.12  # 0.8 m/s^2 a sample at 50 Hz
    gyroscope_rps_rthz: float = 0.004  # 1.6 deg/s a sample at 50 Hz
    accelerometer_bias_mps3_rthz: float = 2e-3
    gyroscope_bias_rps2_rthz: float = 2e-4
    start_velocity_mps: float = 0.1
    start_accelerometer_bias_mps2: float = 0.2
    start_gyroscope_bias_rps: float = 0.02
    vio_position_floor_m: float = 0.005  # never believe a source that claims less
    vio_rotation_floor_rad: float = 0.002
    vio_velocity_mps: float = 0.03
    wheel_speed_mps: float = 0.03
    wheel_speed_share: float = 0.03  # of the speed: radius error and creep
    wheel_side_mps: float = 0.05  # non-holonomic constraint, sideways
    wheel_up_mps: float = 0.05  # and vertically
    smooth_mps2: float = 4.0  # two readings differ by this much through noise and ordinary flight
    smooth_rps: float = 0.8
    blind_mps2: float = 1.5  # unknown acceleration while the IMU is silent
    blind_rps: float = 0.8  # unknown turning while the IMU is silent


@dataclass(frozen=True, slots=True)
class State:
    """Nominal state with the covariance of its error."""

    position_m: Array  # (3,) odom
    velocity_mps: Array  # (3,) odom
    quaternion: Array  # (4,) wxyz, body to odom
    rotation: Array  # (3, 3) the same attitude as a matrix
    gyroscope_bias_rps: Array  # (3,) body
    accelerometer_bias_mps2: Array  # (3,) body
    covariance: Array  # (15, 15)


def start(sample: VioSample, noise: Noise) -> State:
    """The state that the first VIO sample tells."""
    q, rotation = correction.turned_by(sample.quaternion, np.zeros(3))
    covariance = np.zeros((15, 15))
    covariance[:3, :3] = _floored(sample.covariance[:3, :3], noise.vio_position_floor_m)
    covariance[R, R] = _floored(sample.covariance[3:, 3:], noise.vio_rotation_floor_rad)
    for block, sigma in (
        (V, noise.start_velocity_mps),
        (BG, noise.start_gyroscope_bias_rps),
        (BA, noise.start_accelerometer_bias_mps2),
    ):
        covariance[block, block] = np.eye(3) * sigma**2
    return State(
        sample.position_m.copy(),
        sample.velocity_mps.copy(),
        q,
        rotation,
        np.zeros(3),
        np.zeros(3),
        covariance,
    )


@dataclass(frozen=True, slots=True)
class Roughness:
    """How much the IMU changed from one reading to the next, beyond its noise.

    At 50 Hz a knock of a few milliseconds (a touchdown) is sampled or missed as it happens; what lies
    between two readings that differ is not known, and the filter has to admit it.
    """

    force_mps2: float = 0.0
    rate_rps: float = 0.0


SMOOTH = Roughness()


def roughness(before: ImuSample, after: ImuSample, noise: Noise) -> Roughness:
    """Roughness between two consecutive readings."""
    force = math.dist(after.specific_force_mps2, before.specific_force_mps2)
    rate = math.dist(after.angular_velocity_rps, before.angular_velocity_rps)
    return Roughness(max(0.0, force - noise.smooth_mps2), max(0.0, rate - noise.smooth_rps))


def advance(
    s: State,
    specific_force_mps2: Array,
    rate_rps: Array,
    dt_s: float,
    noise: Noise,
    rough: Roughness = SMOOTH,
) -> State:
    """Dead reckoning over `dt_s` with one mean IMU reading (body)."""
    position_m, velocity_mps, q, rotation, covariance = strapdown.advance(
        s.position_m,
        s.velocity_mps,
        s.quaternion,
        s.covariance,
        specific_force_mps2 - s.accelerometer_bias_mps2,
        rate_rps - s.gyroscope_bias_rps,
        dt_s,
        GRAVITY_MPS2,
    )
    added = _process(noise, dt_s)
    if rough is not SMOOTH:
        added[V] += (rough.force_mps2 * dt_s) ** 2
        added[P] += (0.5 * rough.force_mps2 * dt_s * dt_s) ** 2
        added[R] += (rough.rate_rps * dt_s) ** 2
    covariance[_DIAGONAL, _DIAGONAL] += added
    return State(
        position_m,
        velocity_mps,
        q,
        rotation,
        s.gyroscope_bias_rps,
        s.accelerometer_bias_mps2,
        covariance,
    )


def coast(s: State, dt_s: float, noise: Noise) -> State:
    """Go on at constant velocity and attitude over `dt_s` without an IMU, and admit how little is known."""
    f = _EYE15.copy()
    f[P, V] = _EYE * dt_s
    covariance = f @ s.covariance @ f.T
    q = _process(noise, dt_s)
    q[P] += (0.5 * noise.blind_mps2 * dt_s * dt_s) ** 2
    q[V] += (noise.blind_mps2 * dt_s) ** 2
    q[R] += (noise.blind_rps * dt_s) ** 2
    covariance[_DIAGONAL, _DIAGONAL] += q
    return State(
        s.position_m + s.velocity_mps * dt_s,
        s.velocity_mps,
        s.quaternion,
        s.rotation,
        s.gyroscope_bias_rps,
        s.accelerometer_bias_mps2,
        covariance,
    )


@functools.lru_cache(maxsize=8)
def _densities(noise: Noise) -> Array:
    """Diagonal of the process noise of one second, without that of the position, (15,)."""
    out = np.zeros(15)
    out[V] = noise.accelerometer_mps2_rthz**2
    out[R] = noise.gyroscope_rps_rthz**2
    out[BG] = noise.gyroscope_bias_rps2_rthz**2
    out[BA] = noise.accelerometer_bias_mps3_rthz**2
    return out


def _process(noise: Noise, dt_s: float) -> Array:
    """Diagonal of the process noise of one step, (15,)."""
    out: Array = _densities(noise) * dt_s
    out[P] = out[V] * (dt_s * dt_s / 3.0)
    return out


def _floored(covariance: Array, sigma: float) -> Array:
    """`covariance` (3, 3) with no variance below sigma squared."""
    out = covariance.copy()
    i = np.arange(3)
    out[i, i] = np.maximum(out[i, i], sigma**2)
    return out


def correct_vio(s: State, sample: VioSample, gate: float, noise: Noise) -> tuple[State, float]:
    """Take in a VIO pose at the state's own instant unless its squared Mahalanobis distance is above `gate`.

    Returns:
        The new state (the same object when gated) and the distance, chi-square of 9 if all is well.
    """
    error, covariance, distance = correction.vio(
        s.position_m,
        s.velocity_mps,
        s.quaternion,
        s.covariance,
        sample.position_m,
        sample.velocity_mps,
        sample.quaternion,
        sample.covariance,
        (noise.vio_position_floor_m, noise.vio_rotation_floor_rad, noise.vio_velocity_mps),
        gate,
    )
    if not distance <= gate:
        return s, distance
    return _injected(s, error, covariance), distance


def correct_wheels(
    s: State, speed_mps: float, gate_speed: float, gate_side: float, noise: Noise
) -> tuple[State, float, float]:
    """Take in the wheels: forward speed as measured, none sideways and none upwards (body frame).

    The two parts are gated apart, so that a spinning wheel does not cost the sideways constraint.

    Args:
        s: State at the instant of the measurement.
        speed_mps: Forward speed by the encoders.
        gate_speed: Largest believed squared Mahalanobis distance of the speed, chi-square of 1.
        gate_side: The same of the sideways and upward constraint, chi-square of 2.
        noise: What to believe.

    Returns:
        The new state (the same object when both are gated) and the two distances.
    """
    sigma = noise.wheel_speed_mps + noise.wheel_speed_share * abs(speed_mps)
    error, covariance, slip, side = correction.wheels(
        s.velocity_mps,
        s.rotation,
        s.covariance,
        speed_mps,
        (sigma * sigma, noise.wheel_side_mps**2, noise.wheel_up_mps**2),
        (gate_speed, gate_side),
    )
    if not slip <= gate_speed and not side <= gate_side:  # NaN counts as gated
        return s, slip, side
    return _injected(s, error, covariance), slip, side


def _injected(s: State, error: Array, covariance: Array) -> State:
    """The nominal state with its estimated error moved in."""
    q, rotation = correction.turned_by(s.quaternion, error[R])
    return State(
        s.position_m + error[P],
        s.velocity_mps + error[V],
        q,
        rotation,
        s.gyroscope_bias_rps + error[BG],
        s.accelerometer_bias_mps2 + error[BA],
        covariance,
    )


def warm_up() -> None:
    """Compile or load the kernels, so that the first reading and the first pose of a flight are not late."""
    strapdown.warm_up()
    correction.warm_up()
