"""The robot's pose: IMU, VIO and wheels in the order they were measured, however late they arrive.

Each measurement is a node of a one-second timeline that keeps the state after it. A measurement that
comes late (VIO by 30 to 250 ms) is put at its place and the nodes behind it are worked through again.
The odom frame is the VIO's: its slow drift is not observable here and not part of the covariance.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import Counter, deque
from dataclasses import dataclass

import numpy as np

from labr_autonomy.errors import LabrError
from labr_autonomy.estimation import error_state as es
from labr_autonomy.estimation.vio_message import VioSample
from labr_autonomy.frames import quaternion_multiply, rotation_vector_quaternion
from labr_autonomy.types import Array, ImuSample, Odometry, Pose, WheelOdometry

HISTORY_S = 1.0
LATE_MAX_S = 0.6  # nothing older is put into the timeline
IMU_GAP_S = 0.1  # beyond this the last reading says nothing about now
PREDICT_MAX_S = 0.1
# Gates: chi-square quantiles at 1 - 1e-5, so that a healthy sensor is practically never refused.
GATE_VIO = 39.3  # 9 degrees of freedom
GATE_WHEEL_SPEED = 19.5  # 1
GATE_WHEEL_SIDE = 23.0  # 2
TILT_MAX_RAD = math.radians(6.0)  # VIO's "up" against gravity at the start
EARLY_READINGS = 64  # more than a second of them
NEAR_S, NEAR_READINGS = 0.6, 10  # readings whose mean is compared
REST_BAND_MPS2 = 0.6  # specific force this near g counts as unaccelerated
RESTART_AFTER = 30  # VIO samples refused in a row that agree with each other: the filter is wrong, not VIO
STEADY_WHEEL_MPS = 0.15  # and VIO and wheels may differ by this much
STEADY_M = 0.05  # two VIO samples agree when they are no further apart than their velocity says
STEADY_GAP_S = 0.2

Payload = ImuSample | VioSample | WheelOdometry


@dataclass(slots=True)
class _Node:
    """One measurement and what was known after it."""

    stamp_s: float
    payload: Payload
    state: es.State
    imu: ImuSample | None  # newest reading at this node
    rough: es.Roughness = es.SMOOTH  # how that reading differs from the one before
    counted: bool = False


class PoseFilter:
    """Error-state filter with delayed updates. Not thread-safe: it belongs to one event loop.

    Args:
        noise: What to believe about the sensors.
    """

    def __init__(self, noise: es.Noise | None = None) -> None:
        self._noise = noise or es.Noise()
        self._nodes: list[_Node] = []
        self._stamps: list[float] = []
        self._early: deque[ImuSample] = deque(maxlen=EARLY_READINGS)  # IMU readings before the start
        self._newest_s = {"imu": -math.inf, "vio": -math.inf, "vio_accepted": -math.inf, "wheels": -math.inf}
        self.refused: Counter[str] = Counter()
        self.vio_rejected_in_a_row = 0
        self.wheels_rejected_in_a_row = 0
        self.restarts = 0  # times the filter gave in to a VIO that contradicted it long and steadily
        self._steady = 0
        self._last_vio: VioSample | None = None
        self._last_wheels: WheelOdometry | None = None  # while they carry the robot
        self.vio_distance = 0.0  # squared Mahalanobis distance of the newest VIO sample, 9 on average

    @property
    def ready(self) -> bool:
        """Whether a first VIO sample has given the pose."""
        return bool(self._nodes)

    @property
    def state(self) -> es.State:
        """Newest state with biases and full covariance."""
        if not self._nodes:
            raise LabrError("the pose filter has no pose yet", "Wait for the first VIO sample.")
        return self._nodes[-1].state

    def reset(self) -> None:
        """Forget the pose; the next VIO sample starts anew."""
        self._steady = 0
        self._early.extend(n.payload for n in self._nodes if isinstance(n.payload, ImuSample))
        self._nodes.clear()
        self._stamps.clear()
        self.vio_rejected_in_a_row = 0
        self.wheels_rejected_in_a_row = 0

    def add_imu(self, sample: ImuSample) -> bool:
        """Dead-reckon with an inertial reading; False when it is not usable."""
        finite = (
            np.isfinite(sample.specific_force_mps2).all() and np.isfinite(sample.angular_velocity_rps).all()
        )
        if not finite or not sample.stamp_s > self._newest_s["imu"]:
            self.refused["imu"] += 1
            return False
        self._newest_s["imu"] = sample.stamp_s
        if not self._nodes:
            self._early.append(sample)
            return False
        return self._insert(sample.stamp_s, sample) is not None

    def add_vio(self, sample: VioSample) -> bool:
        """Take in a VIO pose; the first one starts the filter. False when it is refused."""
        if not sample.stamp_s > self._newest_s["vio"]:
            self.refused["vio"] += 1
            return False
        self._newest_s["vio"] = sample.stamp_s
        if not self._nodes:
            return self._start(sample)
        rejected = self.vio_rejected_in_a_row
        steady = self._agrees_with_itself(sample)
        if self._insert(sample.stamp_s, sample) is None:
            self.refused["vio_late"] += 1
            return False
        if self.vio_rejected_in_a_row <= rejected:
            self._steady = 0
            return True
        self._steady = self._steady + 1 if steady else 0
        if self._steady < RESTART_AFTER:
            return False
        self.restarts += 1
        self.reset()
        return self._start(sample)

    def _agrees_with_itself(self, sample: VioSample) -> bool:
        """Whether VIO moved since its last sample as it says it moves, and the wheels do not deny it.

        A source that repeats one pose to the last bit has stopped working.
        """
        last, self._last_vio = self._last_vio, sample
        if last is None or np.array_equal(sample.position_m, last.position_m):
            return False
        dt_s = sample.stamp_s - last.stamp_s
        moved = sample.position_m - last.position_m - 0.5 * dt_s * (sample.velocity_mps + last.velocity_mps)
        wheels = self._last_wheels
        if wheels is not None and abs(sample.stamp_s - wheels.stamp_s) < STEADY_GAP_S:
            speed = float(np.linalg.norm(sample.velocity_mps[:2]))
            if abs(speed - abs(wheels.speed_mps)) > STEADY_WHEEL_MPS:
                return False
        return dt_s < STEADY_GAP_S and float(np.linalg.norm(moved)) < STEADY_M

    def add_wheels(self, sample: WheelOdometry, on_ground: bool) -> bool:
        """Take in the wheels' speed while they carry the robot. False when not used."""
        if not math.isfinite(sample.speed_mps) or not sample.stamp_s > self._newest_s["wheels"]:
            self.refused["wheels"] += 1
            return False
        self._newest_s["wheels"] = sample.stamp_s
        if not on_ground:
            return False
        self._last_wheels = sample
        rejected = self.wheels_rejected_in_a_row
        if self._insert(sample.stamp_s, sample) is None:
            return False
        return self.wheels_rejected_in_a_row <= rejected

    def odometry(self) -> Odometry | None:
        """Motion at the newest measurement, or None before the start."""
        return _odometry(self._nodes[-1]) if self._nodes else None

    def at(self, stamp_s: float) -> Odometry | None:
        """Motion at a past stamp, interpolated; slightly ahead of the newest measurement it is predicted."""
        if not self._nodes or not self._stamps[0] <= stamp_s <= self._stamps[-1] + PREDICT_MAX_S:
            return None
        i = bisect_right(self._stamps, stamp_s) - 1
        before = _odometry(self._nodes[i])
        if i + 1 == len(self._nodes):
            return _extrapolated(before, stamp_s - before.stamp_s)
        after = self._nodes[i + 1]
        span = after.stamp_s - before.stamp_s
        share = (stamp_s - before.stamp_s) / span if span > 0.0 else 0.0
        return _between(before, _odometry(after), share)

    def predicted(self, now_s: float) -> Odometry | None:
        """Motion at `now_s` by constant velocity from the newest measurement, over 100 ms at most."""
        latest = self.odometry()
        if latest is None:
            return None
        return _extrapolated(latest, min(max(now_s - latest.stamp_s, 0.0), PREDICT_MAX_S))

    def ages(self, now_s: float) -> dict[str, float]:
        """Time since the newest `imu`, `vio`, `vio_accepted` and `wheels` were measured [s], inf = never."""
        return {name: now_s - stamp_s for name, stamp_s in self._newest_s.items()}

    def _start(self, sample: VioSample) -> bool:
        """Begin at the first VIO sample, unless gravity contradicts its attitude."""
        state = es.start(sample, self._noise)
        if self._contradicts_gravity(state, sample.stamp_s):
            self.refused["vio_tilt"] += 1
            return False
        before = [reading for reading in self._early if reading.stamp_s <= sample.stamp_s]
        later = [reading for reading in self._early if reading.stamp_s > sample.stamp_s]
        self._nodes.append(_Node(sample.stamp_s, sample, state, before[-1] if before else None, counted=True))
        self._stamps.append(sample.stamp_s)
        self._newest_s["vio_accepted"] = sample.stamp_s
        self._early.clear()
        for reading in later:
            self._insert(reading.stamp_s, reading)
        return True

    def _contradicts_gravity(self, state: es.State, stamp_s: float) -> bool:
        """Whether an IMU at rest points "up" somewhere else than the state does."""
        near = [r.specific_force_mps2 for r in self._early if abs(r.stamp_s - stamp_s) < NEAR_S]
        if len(near) < NEAR_READINGS:
            return False
        force = np.sum(near, axis=0) / len(near)
        size = math.sqrt(float(force @ force))
        if abs(size - es.GRAVITY_MPS2) > REST_BAND_MPS2:
            return False
        return float(state.rotation[2] @ force) < size * math.cos(TILT_MAX_RAD)

    def _insert(self, stamp_s: float, payload: Payload) -> _Node | None:
        """Put a measurement at its place and work through everything behind it."""
        nodes, stamps = self._nodes, self._stamps
        if not nodes or stamp_s < stamps[0] or stamp_s < stamps[-1] - LATE_MAX_S:
            return None
        place = bisect_right(stamps, stamp_s)
        node = _Node(stamp_s, payload, nodes[place - 1].state, None)
        nodes.insert(place, node)
        stamps.insert(place, stamp_s)
        for i in range(place, len(nodes)):
            self._work(nodes[i - 1], nodes[i])
        if stamps[-1] - stamps[0] > 1.5 * HISTORY_S:  # in lumps: deleting from the front costs
            old = bisect_right(stamps, stamps[-1] - HISTORY_S) - 1
            del nodes[:old], stamps[:old]
        return node

    def _work(self, before: _Node, node: _Node) -> None:
        """Bring `node` up to date from its predecessor."""
        payload = node.payload
        reading = payload if isinstance(payload, ImuSample) else None
        state = self._carried(before, node.stamp_s, reading)
        node.imu = reading or before.imu
        node.rough = before.rough if reading is None else self._roughness(before, reading)
        if isinstance(payload, VioSample):
            state = self._with_vio(state, payload, node)
        elif isinstance(payload, WheelOdometry):
            state = self._with_wheels(state, payload, node)
        node.state = state
        node.counted = True

    def _carried(self, before: _Node, stamp_s: float, reading: ImuSample | None) -> es.State:
        """The state of `before` carried on to `stamp_s`, by the IMU or without one."""
        dt_s = stamp_s - before.stamp_s
        held = before.imu
        if dt_s <= 0.0:
            return before.state
        if reading is None:
            if held is None or stamp_s - held.stamp_s > IMU_GAP_S:
                return es.coast(before.state, dt_s, self._noise)
            force, rate = held.specific_force_mps2, held.angular_velocity_rps
            return es.advance(before.state, force, rate, dt_s, self._noise, before.rough)
        if held is None or reading.stamp_s - held.stamp_s > IMU_GAP_S:
            return es.coast(before.state, dt_s, self._noise)
        # The mean of both ends of the interval: no lag of half a sample.
        force = 0.5 * (held.specific_force_mps2 + reading.specific_force_mps2)
        rate = 0.5 * (held.angular_velocity_rps + reading.angular_velocity_rps)
        return es.advance(before.state, force, rate, dt_s, self._noise, self._roughness(before, reading))

    def _roughness(self, before: _Node, reading: ImuSample) -> es.Roughness:
        """Of the interval that ends with `reading`: a knock counts for the interval after it as well."""
        if before.imu is None:
            return es.SMOOTH
        now = es.roughness(before.imu, reading, self._noise)
        last = before.rough
        if now == es.SMOOTH and last == es.SMOOTH:
            return es.SMOOTH
        return es.Roughness(
            max(now.force_mps2, 0.5 * last.force_mps2), max(now.rate_rps, 0.5 * last.rate_rps)
        )

    def _with_vio(self, state: es.State, sample: VioSample, node: _Node) -> es.State:
        after, distance = es.correct_vio(state, sample, GATE_VIO, self._noise)
        if not node.counted:
            self.vio_distance = distance
            if after is state:
                self.refused["vio_gate"] += 1
                self.vio_rejected_in_a_row += 1
            else:
                self.vio_rejected_in_a_row = 0
                self._newest_s["vio_accepted"] = sample.stamp_s
        return after

    def _with_wheels(self, state: es.State, sample: WheelOdometry, node: _Node) -> es.State:
        after, slip, side = es.correct_wheels(
            state, sample.speed_mps, GATE_WHEEL_SPEED, GATE_WHEEL_SIDE, self._noise
        )
        if not node.counted:
            if side > GATE_WHEEL_SIDE:
                self.refused["wheel_side"] += 1
            if slip > GATE_WHEEL_SPEED:
                self.refused["wheel_slip"] += 1
                self.wheels_rejected_in_a_row += 1
            else:
                self.wheels_rejected_in_a_row = 0
        return after


def _odometry(node: _Node) -> Odometry:
    """The node as a value for the other rooms."""
    s = node.state
    imu = node.imu
    fresh = imu is not None and node.stamp_s - imu.stamp_s <= IMU_GAP_S
    rate = imu.angular_velocity_rps - s.gyroscope_bias_rps if fresh and imu is not None else np.zeros(3)
    covariance = np.empty((6, 6))
    covariance[:3, :3] = s.covariance[:3, :3]
    covariance[3:, 3:] = s.covariance[6:9, 6:9]
    covariance[:3, 3:] = s.covariance[:3, 6:9]
    covariance[3:, :3] = s.covariance[6:9, :3]
    return Odometry(node.stamp_s, Pose(s.position_m, s.quaternion), s.velocity_mps, rate, covariance)


def _extrapolated(o: Odometry, dt_s: float) -> Odometry:
    """Constant velocity and turning over `dt_s`."""
    if dt_s == 0.0:
        return o
    turn = rotation_vector_quaternion(o.angular_velocity_rps * dt_s)
    pose = Pose(o.pose.position_m + o.velocity_mps * dt_s, quaternion_multiply(o.pose.quaternion, turn))
    return Odometry(o.stamp_s + dt_s, pose, o.velocity_mps, o.angular_velocity_rps, o.covariance)


def _between(a: Odometry, b: Odometry, share: float) -> Odometry:
    """Linear interpolation; the quaternion's chord is close enough over one IMU interval."""

    def mix(x: Array, y: Array) -> Array:
        blended: Array = x * (1.0 - share) + y * share
        return blended

    near = b.pose.quaternion if a.pose.quaternion @ b.pose.quaternion >= 0.0 else -b.pose.quaternion
    q = mix(a.pose.quaternion, near)
    return Odometry(
        a.stamp_s + share * (b.stamp_s - a.stamp_s),
        Pose(mix(a.pose.position_m, b.pose.position_m), q / math.sqrt(float(q @ q))),
        mix(a.velocity_mps, b.velocity_mps),
        mix(a.angular_velocity_rps, b.angular_velocity_rps),
        mix(a.covariance, b.covariance),
    )
