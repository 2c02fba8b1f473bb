"""The stand-in without its socket: bytes in, bytes out, motor duties out; its owner keeps the clock."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from pymavlink.dialects.v20 import development as mavlink

from sim.autopilot import commander, telemetry
from sim.autopilot.brain import Brain, Motors, Pack
from sim.autopilot.commander import CommanderState, Kind, Request, Result
from sim.autopilot.commands import Answer, Desk
from sim.autopilot.estimator import Estimate, Estimator
from sim.autopilot.events import Event, EventMessage
from sim.autopilot.imu import Imu
from sim.autopilot.modes import FlightMode
from sim.autopilot.parameters import Parameters
from sim.autopilot.phase import PhaseState
from sim.autopilot.setpoint import target_of
from sim.autopilot.telemetry import Schedule, Snapshot
from sim.autopilot.vision import ClockOffset, pose_of_odometry, pose_of_vision_estimate
from sim.quad.state import QuadState

BOOT_S = 0.3  # age of the autopilot at its first tick, so that no stamp is zero
ON_GROUND, IN_AIR, LANDING = 1, 2, 4  # MAV_LANDED_STATE
GRIPPER_REPEAT_S = 0.5
GIMBAL_DELAY_S = 0.26  # after the mode, as recorded; repeated 1.0, 1.5 and 2.0 s after that


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
        self._schedule = Schedule()
        self._later: list[tuple[float, mavlink.MAVLink_message]] = []
        self._pings = 0
        self._desk = Desk(self)
        self.parameters = Parameters()
        self.brain = Brain(self.parameters)
        self._announced = self.commander  # as it was at the end of the last tick
        self._announced_landed = True
        self._announced_signal: bool | None = None  # whether set-points are usable
        self._events = 0
        self.peer = Peer()
        self._truth: QuadState | None = None
        self._pack: Pack | None = None

    @property
    def armed(self) -> bool:
        """Whether the rotors may turn."""
        return self.brain.armed

    @property
    def mode_name(self) -> str:
        """Mode that runs, in a word."""
        return self.commander.mode.name.lower()

    @property
    def estimator(self) -> Estimator:
        """What the poses are fused by."""
        return self.brain.estimator

    @property
    def estimate(self) -> Estimate:
        """Where it believes to be."""
        return self.brain.estimate

    @property
    def commander(self) -> CommanderState:
        """Mode and arming."""
        return self.brain.commander

    @property
    def phase(self) -> PhaseState:
        """From spinning up to standing again."""
        return self.brain.phase

    @property
    def boot_s(self) -> float:
        """Time since boot [s]."""
        return self._now_s

    def receive(self, data: bytes) -> None:
        """Take bytes off the link; they are looked at in the next step."""
        self._inbox.append(data)

    def step(self, now_s: float, truth: QuadState, pack: Pack) -> Motors | None:
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
        self.brain.observe(self._now_s, truth)
        self._read_inbox()
        self.brain.decide()
        self._announce()
        motors = self.brain.fly(dt_s, truth, pack)
        self._talk()
        return motors

    # --- link -----------------------------------------------------------------------------------------

    def send(self, message: mavlink.MAVLink_message | EventMessage) -> None:
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
            self.brain.take_setpoint(target)

    # --- decisions ------------------------------------------------------------------------------------

    def ask(self, asked: Request) -> Result:
        """Put one request to the commander."""
        result = self.brain.ask(asked)
        if result is not Result.ACCEPTED and asked.kind is Kind.ARM:
            self._say("Arming denied: no mode that could fly", Event.ARM_DENIED)
        if result is not Result.ACCEPTED and asked.kind is Kind.DISARM:
            self._say("Disarming denied: not landed", Event.DISARM_DENIED)
        return result

    def _announce(self) -> None:
        was, now = self._announced, self.commander
        self._announced = now
        inputs = self.brain.inputs()
        signal = commander.can_run(FlightMode.OFFBOARD, inputs)
        if signal is not self._announced_signal:
            self._announced_signal = signal
            for event in (Event.CHECKS,) if signal else (Event.CHECKS, Event.NO_SETPOINTS):
                self._tell(event)
        if now.failsafe and not was.failsafe:
            self._say("Failsafe activated: landing", Event.FAILSAFE)
        if now.armed and not was.armed:
            self._tell(Event.ARMED)
        if inputs.landed is not self._announced_landed:
            self._announced_landed = inputs.landed
            self._tell(Event.LANDED if inputs.landed else Event.TAKE_OFF)
        if was.armed and not now.armed:
            self._tell(Event.DISARMED)
        if now.armed and now.mode is FlightMode.LAND and (was.mode is not FlightMode.LAND):
            self._gimbal_commands()

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
        inputs = self.brain.inputs()
        landed = ON_GROUND if inputs.landed else LANDING if state.mode is FlightMode.LAND else IN_AIR
        return Snapshot(
            boot_s=self._now_s,
            unix_s=self._unix_s + self._now_s,
            estimate=self.estimate,
            imu=self._imu.measure(truth.specific_force_mps2, truth.angular_velocity_rps),
            flying=self.phase.thrust_share(self._now_s) > 0.0 and not self.phase.cut(self._now_s),
            target=self.brain.target,
            demand=self.brain.controller.demand,
            motors=self.brain.motors,
            armed=state.armed,
            base_mode=commander.base_mode(state, setpoint_seen=self.brain.setpoint is not None),
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

    def _tell(self, event: Event) -> None:
        """An event goes out on every link."""
        self._events += 1
        self.send(EventMessage(event, int(self._now_s * 1e3), self._events & 0xFFFF))

    def _say(self, text: str, event: Event) -> None:
        self._tell(event)
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
