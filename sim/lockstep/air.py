"""The air channel without MAVLink: the stand-in's flight code, seen through PX4's telemetry rates."""

from __future__ import annotations

import math

import numpy as np

from labr_autonomy.air.telemetry import AirState
from labr_autonomy.frames import flu_frd, yaw_enu_ned, yaw_of
from labr_autonomy.modes.transition import Command
from labr_autonomy.types import ImuSample, Odometry, SetPoint
from sim.autopilot.brain import Brain, Motors, Pack
from sim.autopilot.commander import Kind, Request, Result
from sim.autopilot.controller import Target
from sim.autopilot.estimator import VisionPose
from sim.autopilot.imu import Imu
from sim.autopilot.modes import FlightMode
from sim.autopilot.parameters import Parameters
from sim.autopilot.vectors import Vector
from sim.quad.state import QuadState

HEARTBEAT_S = 1.0  # armed and mode arrive with it, as over the real link
LANDED_S = 0.2  # EXTENDED_SYS_STATE at 5 Hz
ASLEEP_EVERY = 5  # a disarmed autopilot decides at 50 Hz: nothing of it moves the robot
MODES = {FlightMode.OFFBOARD: "offboard", FlightMode.LAND: "land"}

REQUESTS = {
    Command.OFFBOARD: Request(Kind.MODE, FlightMode.OFFBOARD),
    Command.ARM: Request(Kind.ARM),
    Command.LAND: Request(Kind.LAND),
    Command.DISARM: Request(Kind.DISARM),
}


class AirSeam:
    """The autopilot as the flight sees it.

    Args:
        seed: Of the IMU's noise and biases, and of when its heartbeats come.
    """

    def __init__(self, seed: int) -> None:
        self.brain = Brain(Parameters())
        self._imu = Imu(seed)
        self._beat_due_s = HEARTBEAT_S * float(np.random.default_rng([seed, 0x42]).random())
        self._landed_due_s = 0.0
        self._beat_s = 0.0
        self._armed, self._mode, self._landed = False, "hold", "on_ground"
        self._battery_left = 1.0
        self._volts = 0.0
        self._steps = 0

    @property
    def armed(self) -> bool:
        """Whether the rotors may turn, in truth."""
        return self.brain.armed

    def step(self, now_s: float, dt_s: float, truth: QuadState, pack: Pack) -> Motors | None:
        """One physics step; returns the duties until the next one, None while disarmed."""
        self._steps += 1
        asleep = not self.brain.armed
        if asleep and self._steps % ASLEEP_EVERY:
            return None
        self.brain.observe(now_s, truth)
        self.brain.decide()
        motors = self.brain.fly(dt_s * (ASLEEP_EVERY if asleep else 1), truth, pack)
        self._talk(now_s, pack)
        return motors

    def _talk(self, now_s: float, pack: Pack) -> None:
        if now_s >= self._beat_due_s:
            self._beat_due_s += HEARTBEAT_S
            self._beat_s = now_s
            self._armed = self.brain.armed
            self._mode = MODES.get(self.brain.commander.mode, "hold")
            self._battery_left, self._volts = pack.remaining, pack.volts
        if now_s >= self._landed_due_s:
            self._landed_due_s += LANDED_S
            self._landed = "on_ground" if self.brain.phase.landed(now_s) else "in_air"

    def imu(self, now_s: float, truth: QuadState) -> ImuSample:
        """One reading, body FLU."""
        frd = np.array(self._imu.measure(truth.specific_force_mps2, truth.angular_velocity_rps))
        turned = flu_frd(frd.reshape(2, 3))
        return ImuSample(now_s, turned[0], turned[1])

    def state(self, now_s: float) -> AirState:
        """What the flight knows of it."""
        return AirState(
            stamp_s=now_s,
            connected=True,
            armed=self._armed,
            mode=self._mode,
            landed=self._landed,
            position_m=None,
            velocity_mps=None,
            attitude=None,
            battery_v=self._volts,
            battery_remaining=self._battery_left,
            current_a=None,
            heartbeat_age_s=now_s - self._beat_s,
            failsafe=self.brain.commander.failsafe,
        )

    def request(self, command: Command) -> str:
        """Carry out a request; returns why it was refused, "" when it was not."""
        result = self.brain.ask(REQUESTS[command])
        accepted = result is Result.ACCEPTED
        return "" if accepted else f"the autopilot refused to {command.value}: {result.name.lower()}"

    def send_setpoint(self, s: SetPoint) -> None:
        """One set-point, odom."""
        self.brain.take_setpoint(
            Target(
                _ned(s.position_m),
                _ned(s.velocity_mps),
                _ned(s.acceleration_mps2),
                yaw_enu_ned(s.yaw_rad),
                -s.yaw_rate_rps,
            )
        )

    def send_vision(self, o: Odometry) -> None:
        """One pose for the autopilot's own estimator, odom."""
        yaw = yaw_enu_ned(yaw_of(o.pose.quaternion))
        if math.isfinite(yaw):
            self.brain.estimator.fuse(
                VisionPose(o.stamp_s, _ned(o.pose.position_m), _ned(o.velocity_mps), yaw)
            )


def _ned(enu: np.ndarray) -> Vector:
    return float(enu[1]), float(enu[0]), -float(enu[2])
