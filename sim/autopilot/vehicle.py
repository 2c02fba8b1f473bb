"""The stand-in without its socket: bytes in, bytes out, motor duties out; its owner keeps the clock."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from pymavlink.dialects.v20 import development as mavlink

from sim.autopilot import commander, phase, telemetry
from sim.autopilot.commander import CommanderInputs, CommanderState, Kind, Request, Result
from sim.autopilot.commands import Answer, Desk
from sim.autopilot.controller import Controller, Target, wanted_velocity
from sim.autopilot.estimator import Estimate, Estimator, Truth
from sim.autopilot.imu import Imu
from sim.autopilot.landing import landing_target
from sim.autopilot.modes import FlightMode
from sim.autopilot.parameters import Parameters
from sim.autopilot.phase import Phase, PhaseInputs, PhaseState
from sim.autopilot.setpoint import target_of
from sim.autopilot.telemetry import Schedule, Snapshot
from sim.autopilot.vectors import Vector, ned_attitude
from sim.autopilot.vision import ClockOffset, pose_of_odometry, pose_of_vision_estimate
from sim.quad.state import QuadState

BOOT_S = 0.3  # age of the autopilot at its first tick, so that no stamp is zero
HOVER_N = 3.4 * 9.80665
ON_GROUND, IN_AIR, LANDING = 1, 2, 4  # MAV_LANDED_STATE
GRIPPER_REPEAT_S = 0.5
GIMBAL_DELAY_S = 0.26  # after the mode, as recorded; repeated 1.0, 1.5 and 2.0 s after that


class Pack(Protocol):
    """What the autopilot measures of the battery."""

    volts: float
    current_a: float

    @property
    def remaining(self) -> float:
        """Fraction left."""
        ...

    @property
    def used_j(self) -> float:
        """Energy given so far [J]."""
        ...


@dataclass(slots=True)
class Peer:
    """What is known of the other end of the link."""

    ground_station: bool = False  # it has sent a GCS heartbeat; only then STATUSTEXT goes out
    ignored: int = 0  # messages without meaning here


class Vehicle:
    """Autopilot of one quad.

    Args:
        send: Takes the bytes of each outgoing message.
        seed: Of the IMU's noise and biases.
        unix_s: Wall clock at boot, for SYSTEM_TIME [s].
    """

    def __init__(
        self, send: Callable[[bytes], None], *, seed: int = 0, unix_s: float = 1_795_000_000.0
    ) -> None:
        self._send_bytes = send
        self._unix_s = unix_s
        self._codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._inbox: list[bytes] = []
        self._start_s: float | None = None
        self._now_s = 0.0  # since boot
        self._imu = Imu(seed)
        self._offset = ClockOffset()
        self._controller = Controller()
        self._schedule = Schedule()
        self._later: list[tuple[float, mavlink.MAVLink_message]] = []
        self._pings = 0
        self._desk = Desk(self)
        self.parameters = Parameters()
        self.estimator = Estimator()
        self.estimate = Estimate()
        self.commander = CommanderState()
        self._announced = self.commander  # as it was at the end of the last tick
        self.phase = PhaseState()
        self.peer = Peer()
        self._setpoint: Target | None = None
        self._setpoint_s = -math.inf
        self._target = Target()
        self._landing_from: Vector | None = None  # where the descent began
        self._home_down_m = 0.0  # height it armed at
        self._motors: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
        self._truth: QuadState | None = None
        self._pack: Pack | None = None

    @property
    def armed(self) -> bool:
        """Whether the rotors may turn."""
        return self.commander.armed

    @property
    def boot_s(self) -> float:
        """Time since boot [s]."""
        return self._now_s

    def receive(self, data: bytes) -> None:
        """Take bytes off the link; they are looked at in the next step."""
        self._inbox.append(data)

    def step(self, now_s: float, truth: QuadState, pack: Pack) -> tuple[float, ...] | None:
        """One tick of 4 ms.

        Args:
            now_s: Time on any monotonic clock [s].
            truth: What the physics says.
            pack: The battery.

        Returns:
            (4,) duty of front right, rear left, front left, rear right; None when disarmed.
        """
        if self._start_s is None:
            self._start_s = now_s - BOOT_S
            self._boot_commands()
        dt_s = max(0.0, now_s - self._start_s - self._now_s) if self._now_s > 0.0 else 0.004
        self._now_s = now_s - self._start_s
        self._truth, self._pack = truth, pack
        self.estimate = self.estimator.step(_truth_ned(self._now_s, truth))
        self._read_inbox()
        self.commander = commander.step(self.commander, self._inputs(), self._now_s)
        self._announce()
        self._fly(min(dt_s, 0.02), truth, pack)
        self._talk()
        return self._motors if self.armed else None

    # --- link -----------------------------------------------------------------------------------------

    def send(self, message: mavlink.MAVLink_message) -> None:
        """Pack and send one message now."""
        data = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) & 255
        self._send_bytes(data)

    def _read_inbox(self) -> None:
        inbox, self._inbox = self._inbox, []
        for data in inbox:
            for message in self._parser.parse_buffer(data) or ():
                self._handle(message)

    def _handle(self, message: mavlink.MAVLink_message) -> None:
        match message.get_type():
            case "SET_POSITION_TARGET_LOCAL_NED":
                self._take_setpoint(message)
            case "ODOMETRY":
                pose = pose_of_odometry(message, self._offset.local_s(message.time_usec, self._now_s))
                if pose is not None:
                    self.estimator.fuse(pose)
            case "VISION_POSITION_ESTIMATE":
                pose = pose_of_vision_estimate(message, self._offset.local_s(message.usec, self._now_s))
                if pose is not None:
                    self.estimator.fuse(pose)
            case "HEARTBEAT":
                self.peer.ground_station |= message.type == mavlink.MAV_TYPE_GCS
            case "TIMESYNC" if message.tc1 == 0:
                self.send(mavlink.MAVLink_timesync_message(int(self._now_s * 1e9), message.ts1))
            case "TIMESYNC":
                self._offset.answer(message.tc1, message.ts1, self._now_s)
            case _:
                if not self._desk.take(message):
                    self.peer.ignored += 1

    def _take_setpoint(self, message: mavlink.MAVLink_message) -> None:
        target = target_of(message, self.estimate)
        if target is not None:
            self._setpoint, self._setpoint_s = target, self._now_s

    # --- decisions ------------------------------------------------------------------------------------

    def ask(self, asked: Request) -> Result:
        """Put one request to the commander."""
        was = self.commander
        self.commander, result = commander.request(was, asked, self._inputs(), self._now_s)
        if self.commander.armed and not was.armed:
            self._home_down_m = self.estimate.position_m[2]
        if result is not Result.ACCEPTED and asked.kind is Kind.ARM:
            self._say("Arming denied: no mode that could fly")
        return result

    def _inputs(self) -> CommanderInputs:
        setpoint = self._setpoint
        usable = False
        if setpoint is not None:
            needs_position = any(map(math.isfinite, setpoint.position_m))
            usable = self.estimate.position_valid if needs_position else self.estimate.velocity_valid
        body = self._truth.quaternion if self._truth is not None else (1.0, 0.0, 0.0, 0.0)
        upright = 1.0 - 2.0 * (float(body[1]) ** 2 + float(body[2]) ** 2)
        return CommanderInputs(
            setpoint_age_s=self._now_s - self._setpoint_s,
            loss_s=self.parameters["COM_OF_LOSS_T"],
            setpoint_usable=usable,
            landed=self.phase.landed(self._now_s),
            tilt_rad=math.acos(max(-1.0, min(1.0, upright))),
        )

    def _announce(self) -> None:
        was, now = self._announced, self.commander
        self._announced = now
        if now.failsafe and not was.failsafe:
            self._say("Failsafe activated: landing")
        if now.armed and now.mode is FlightMode.LAND and (was.mode is not FlightMode.LAND):
            self._gimbal_commands()

    # --- flight ---------------------------------------------------------------------------------------

    def _fly(self, dt_s: float, truth: QuadState, pack: Pack) -> None:
        self._target = self._wanted()
        climb = _climbs(self.estimate, self._target)
        self.phase = phase.step(
            self.phase,
            PhaseInputs(
                armed=self.armed,
                climb_wanted=climb < -0.05,
                descent_wanted=climb > 0.05 or self._controller.demand.thrust_n < 0.5 * HOVER_N,
                touching=truth.on_ground,
                speed_down_mps=-float(truth.velocity_mps[2]),
                lifted=not truth.on_ground or self.phase.thrust_share(self._now_s) > 1.5,
            ),
            self._now_s,
        )
        if self.phase.phase is Phase.DISARMED:
            self._motors = (0.0, 0.0, 0.0, 0.0)
            self._controller.reset()
            return
        share = self.phase.thrust_share(self._now_s)
        if share <= 0.0 or self.phase.cut(self._now_s):
            self._motors = tuple(self._controller.idle(pack.volts))
            return
        self._motors = tuple(
            self._controller.step(dt_s, self.estimate, self._target, share=share, volts=pack.volts)
        )

    def _wanted(self) -> Target:
        if self.commander.mode is FlightMode.LAND:
            if self._landing_from is None:
                self._landing_from = self.estimate.position_m
            return landing_target(self.estimate, self._landing_from, self._home_down_m, self._target)
        self._landing_from = None
        if self.commander.mode is FlightMode.OFFBOARD and self._setpoint is not None:
            return self._setpoint
        return Target()

    # --- telemetry ------------------------------------------------------------------------------------

    def _talk(self) -> None:
        if self._later and self._later[0][0] <= self._now_s:
            ready = [m for due_s, m in self._later if due_s <= self._now_s]
            self._later = [item for item in self._later if item[0] > self._now_s]
            for message in ready:
                self.send(message)
        due = self._schedule.due(self._now_s)
        if not due:
            return
        shot = self.snapshot()
        for message_id in due:
            self.send(telemetry.BUILDERS[message_id](shot))
            self._pings += message_id == mavlink.MAVLINK_MSG_ID_PING

    def snapshot(self) -> Snapshot:
        """What telemetry would show now."""
        truth, pack, state = self._truth, self._pack, self.commander
        if truth is None or pack is None:
            raise RuntimeError("no step has been taken yet")
        inputs = self._inputs()
        landed = ON_GROUND if inputs.landed else LANDING if state.mode is FlightMode.LAND else IN_AIR
        return Snapshot(
            boot_s=self._now_s,
            unix_s=self._unix_s + self._now_s,
            estimate=self.estimate,
            imu=self._imu.measure(truth.specific_force_mps2, truth.angular_velocity_rps),
            flying=self.phase.thrust_share(self._now_s) > 0.0 and not self.phase.cut(self._now_s),
            target=self._target,
            demand=self._controller.demand,
            motors=self._motors,
            armed=state.armed,
            base_mode=commander.base_mode(state, setpoint_seen=self._setpoint is not None),
            custom_mode=state.mode.custom_mode,
            intended_mode=state.intended.custom_mode,
            system_status=commander.system_status(state, inputs),
            landed_state=landed,
            can_arm=commander.can_arm(state, inputs),
            volts=pack.volts,
            current_a=pack.current_a,
            remaining=pack.remaining,
            used_j=pack.used_j,
            ping=self._pings,
        )

    @property
    def schedule(self) -> Schedule:
        """Message intervals, for the command desk."""
        return self._schedule

    def queue(
        self, messages: list[mavlink.MAVLink_message], *, every_s: float = 0.0, after_s: float = 0.0
    ) -> None:
        """Send messages later, evenly spaced."""
        begin_s = self._now_s + after_s
        self._later.extend((begin_s + i * every_s, m) for i, m in enumerate(messages))
        self._later.sort(key=lambda item: item[0])

    def answer(self, answer: Answer) -> None:
        """Acknowledge a command to whoever sent it."""
        self.send(
            mavlink.MAVLink_command_ack_message(
                answer.command, int(answer.result), 0, 0, answer.to_system, answer.to_component
            )
        )

    def _say(self, text: str) -> None:
        if self.peer.ground_station:
            self.send(mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_CRITICAL, text.encode()))

    def _boot_commands(self) -> None:
        """PX4 sends DO_GRIPPER to everyone at boot and repeats it three times for want of an answer."""
        command = mavlink.MAV_CMD_DO_GRIPPER
        messages = [
            mavlink.MAVLink_command_long_message(0, 0, command, i, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            for i in range(4)
        ]
        self._later = [(BOOT_S + i * GRIPPER_REPEAT_S, m) for i, m in enumerate(messages)]

    def _gimbal_commands(self) -> None:
        """When a landing begins PX4 points a gimbal that nobody has, and repeats itself."""
        nan = math.nan
        configure, point = (
            mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE,
            mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
        )

        def command(number: int, count: int, *p: float) -> mavlink.MAVLink_message:
            return mavlink.MAVLink_command_long_message(1, 0, number, count, *p)

        take = (1.0, 1.0, -1.0, -1.0, 0.0, 0.0, 0.0)
        now = [
            command(configure, 0, *take),
            command(point, 0, nan, nan, nan, nan, 2.0, 0.0, 0.0),
            command(configure, 0, -3.0, -3.0, -1.0, -1.0, 0.0, 0.0, 0.0),
        ]
        self.queue(now, after_s=GIMBAL_DELAY_S)
        self.queue(
            [command(configure, i, *take) for i in (1, 2, 3)], every_s=0.5, after_s=GIMBAL_DELAY_S + 1.0
        )


def _truth_ned(now_s: float, truth: QuadState) -> Truth:
    x, y, z = (float(v) for v in truth.position_m)
    vx, vy, vz = (float(v) for v in truth.velocity_mps)
    p, q, r = (float(v) for v in truth.angular_velocity_rps)
    return Truth(
        now_s, (y, x, -z), (vy, vx, -vz), ned_attitude(*(float(v) for v in truth.quaternion)), (p, -q, -r)
    )


def _climbs(now: Estimate, target: Target) -> float:
    """Speed downwards that the target asks for [m/s]; negative climbs."""
    down = wanted_velocity(now, target)[2]
    if math.isfinite(down):
        return down
    push = target.acceleration_mps2[2]
    return push if math.isfinite(push) else 0.0
