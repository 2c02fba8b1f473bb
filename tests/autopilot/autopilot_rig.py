"""Physics, battery and stand-in on a simulated clock, with a client that talks MAVLink to it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from pymavlink.dialects.v20 import development as mavlink

from labr_autonomy.frames import quaternion_enu_flu_to_ned_frd, rotation_matrix
from sim.autopilot.vehicle import Vehicle
from sim.battery import Battery
from sim.quad import STEP_S, Quad, QuadState

NAN = math.nan
NORTH = math.pi / 2.0  # heading of a robot that looks north, in ENU
OFFBOARD = (1.0, 6.0, 0.0)
HOLD = (1.0, 4.0, 3.0)
ARM, SET_MODE, LAND, TAKEOFF, INTERVAL, REQUEST = 400, 176, 21, 22, 511, 512


def parked(x_m: float = 0.0, y_m: float = 0.0, z_m: float = 0.12, yaw_rad: float = NORTH) -> QuadState:
    """The robot at rest on its wheels, as the rover's physics would say it."""
    return QuadState(
        position_m=np.array([x_m, y_m, z_m]),
        velocity_mps=np.zeros(3),
        quaternion=np.array([math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2)]),
        angular_velocity_rps=np.zeros(3),
        specific_force_mps2=np.array([0.0, 0.0, 9.80665]),
        electrical_w=0.0,
        wheel_load_n=np.full(4, 8.34),
        on_wheels=True,
    )


def vision_message(truth: QuadState, stamp_us: int, *, frame: int = 20, shift_m=(0.0, 0.0, 0.0)):
    """ODOMETRY as the air channel sends it: NED axes, velocity in the body."""
    x, y, z = (float(v) for v in truth.position_m)
    v = rotation_matrix(truth.quaternion).T @ truth.velocity_mps
    q = [float(c) for c in quaternion_enu_flu_to_ned_frd(truth.quaternion)]
    at = (y + shift_m[0], x + shift_m[1], -z + shift_m[2])
    nan = [NAN] * 21
    return mavlink.MAVLink_odometry_message(
        stamp_us, frame, 12, *at, q, v[0], -v[1], -v[2], 0.0, 0.0, 0.0, nan, nan, 0, 0
    )


def setpoint_message(
    mask: int, n=0.0, e=0.0, d=0.0, vn=0.0, ve=0.0, vd=0.0, an=0.0, ae=0.0, ad=0.0, yaw=0.0, rate=0.0
):
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, mask, n, e, d, vn, ve, vd, an, ae, ad, yaw, rate
    )


class Rig:
    """A flight faster than real time. The client is system 1, component 191, as a companion is."""

    def __init__(self, *, flying_body: bool = True, seed: int = 1, yaw_rad: float = NORTH) -> None:
        self.now_s = 100.0
        self.sent: list[tuple[float, mavlink.MAVLink_message]] = []
        self._parser = mavlink.MAVLink(None)
        self.vehicle = Vehicle(self._capture, seed=seed)
        self.battery = Battery()
        self.quad = Quad() if flying_body else None
        if self.quad is not None:
            self.quad.reset(np.array([0.0, 0.0, 0.12]), yaw_rad)
        self.truth = self.quad.state if self.quad is not None else parked()
        self.client = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
        self.setpoint: Callable[[], mavlink.MAVLink_message] | None = None
        self.vision = True
        self.vision_frame = 20
        self.shift_m = (0.0, 0.0, 0.0)
        self.answer_timesync = True
        self.ticks = 0
        self._seen = 0

    @property
    def time_s(self) -> float:
        """Since the start of the rig."""
        return self.now_s - 100.0

    def _capture(self, data: bytes) -> None:
        messages = self._parser.parse_buffer(data)
        assert messages, "the stand-in sent something that does not parse"
        self.sent.extend((self.time_s, m) for m in messages)

    def send(self, message: mavlink.MAVLink_message) -> None:
        self.vehicle.receive(message.pack(self.client))
        self.client.seq = (self.client.seq + 1) & 255

    def command(self, number: int, *parameters: float) -> int:
        """Send a COMMAND_LONG and return the result of its acknowledgement, which comes within one tick."""
        before = len(self.sent)
        p = [*parameters, *([NAN] * (7 - len(parameters)))]
        self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *p))
        self.run(STEP_S)
        acks = [m for _, m in self.sent[before:] if m.get_type() == "COMMAND_ACK" and m.command == number]
        assert len(acks) == 1, f"{len(acks)} acknowledgements of command {number}"
        assert (acks[0].target_system, acks[0].target_component) == (1, 191)
        return acks[0].result

    def run(self, duration_s: float, each: Callable[[Rig], None] | None = None) -> None:
        for _ in range(max(1, round(duration_s / STEP_S))):
            self.tick()
            if each is not None:
                each(self)

    def tick(self) -> None:
        self.ticks += 1
        self.now_s = 100.0 + self.ticks * STEP_S
        if self.vision and self.ticks % 8 == 0:
            stamp_us = int((self.vehicle.boot_s + 0.0) * 1e6)
            self.send(vision_message(self.truth, stamp_us, frame=self.vision_frame, shift_m=self.shift_m))
        if self.setpoint is not None and self.ticks % 5 == 0:
            self.send(self.setpoint())
        motors = self.vehicle.step(self.now_s, self.truth, self.battery)
        # Without rotors the rover's physics has the robot; a quad at rest stays at rest.
        still = motors is None and self.truth.on_ground and abs(float(self.truth.velocity_mps[2])) < 1e-3
        if self.quad is not None and not still:
            self.battery.draw("rotors", self.truth.electrical_w)
            self.quad.set_volts(self.battery.step(STEP_S))
            self.truth = self.quad.step(np.zeros(4) if motors is None else np.array(motors))

    def fly_to(self, n: float, e: float, d: float) -> None:
        """Stream a position, with the velocity and acceleration left out, looking north."""
        self.setpoint = lambda: setpoint_message(2552, n, e, d)

    def take_off(self, height_m: float = 1.0) -> None:
        """Offboard, arm and climb by set-point; returns while it hovers."""
        self.fly_to(0.0, 0.0, -0.12 - height_m)
        self.run(0.5)
        assert self.command(SET_MODE, *OFFBOARD) == 0
        assert self.command(ARM, 1.0) == 0
        self.run(7.0)
        assert self.vehicle.phase.phase.value == "flight"

    def messages(self, name: str) -> list[tuple[float, mavlink.MAVLink_message]]:
        return [(t, m) for t, m in self.sent if m.get_type() == name]
