"""Python twin of the land controller: `land_core` behind the wire protocol, on a pseudo-terminal.

To the companion computer it looks like the STM32 on its USB serial port. `unplug` and `replug` do what
pulling the cable does; `reboot` what a reset does.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from firmware_bridge.dialect import labr_land as wire
from firmware_bridge.link import CONTROLLER, Link, Message, text_of
from firmware_bridge.parameters import Parameters
from firmware_bridge.pins import Duty, Inputs, wrapped
from firmware_bridge.version import FIRMWARE
from labr_autonomy.clock import Clock
from labr_autonomy.config import RobotConfig
from sim import land_core as core
from sim import land_wheels
from sim.terminal import Terminal

STATE_PERIOD_MS = 20
HEARTBEAT_PERIOD_MS = 100
STEP_MAX_S = 0.040  # a late step ramps no further than this
CLOCK_ERROR_PPM = 40.0  # crystal of the controller against the computer's
U16, U32 = 0xFFFF, 0xFFFFFFFF

Request = (
    wire.MAVLink_land_velocity_message
    | wire.MAVLink_land_param_read_message
    | wire.MAVLink_land_param_write_message
    | wire.MAVLink_land_estop_message
    | wire.MAVLink_land_estop_release_message
)


class WheelTargets(NamedTuple):
    """What the motors are told; unpacks as `left, right, braked`."""

    left_mps: float
    right_mps: float
    braked: bool


class LandController:
    """The twin.

    Args:
        config: The robot; its limits become the firmware's parameters.
        clock: Tells when the controller boots; afterwards `step` tells the time.
        seed: For the serial number, the boot time and the error of its crystal.
        link_path: See `Terminal`.
        protocol: Protocol version it claims; for tests of the handshake.
        dialect_hash: Dialect it claims; for tests of the handshake.
    """

    def __init__(
        self,
        config: RobotConfig,
        clock: Clock,
        seed: int,
        *,
        link_path: Path | None = None,
        protocol: int = wire.PROTOCOL,
        dialect_hash: int = wire.DIALECT_HASH,
    ) -> None:
        self.parameters = Parameters.of(config)
        self.state = core.State()
        self.wheels = (land_wheels.Wheel(), land_wheels.Wheel())  # left, right
        self.dropped_frames = 0  # that found no reader
        self._protocol = protocol
        self._dialect_hash = dialect_hash
        self._serial = f"{(seed * 0x9E3779B97F4A7C15 + 0x4C414252) & (1 << 96) - 1:024X}"
        self._rate = 1.0 + CLOCK_ERROR_PPM * 1e-6 * (1.0 if seed % 2 else -1.0)
        self._boot_s = clock.now_s() - 1.0 - 0.01 * (seed % 100)
        self._now_ms = 0
        self._last_s: float | None = None
        self._due_state_ms = 0
        self._due_heartbeat_ms = 0
        self._inputs = Inputs(0.0, 0.0, False, True, 0, 0)
        self._link = Link(CONTROLLER)
        self._terminal = Terminal(link_path)
        self._handlers: dict[int, Callable[[Any], None]] = {
            wire.MAVLINK_MSG_ID_LAND_HELLO: self._on_hello,
            wire.MAVLINK_MSG_ID_LAND_HEARTBEAT: self._on_heartbeat,
            wire.MAVLINK_MSG_ID_LAND_VELOCITY: self._on_velocity,
            wire.MAVLINK_MSG_ID_LAND_PARAM_READ: self._on_param_read,
            wire.MAVLINK_MSG_ID_LAND_PARAM_WRITE: self._on_param_write,
            wire.MAVLINK_MSG_ID_LAND_ESTOP: self._on_estop,
            wire.MAVLINK_MSG_ID_LAND_ESTOP_RELEASE: self._on_release,
            wire.MAVLINK_MSG_ID_LAND_TIMESYNC: self._on_timesync,
        }

    @property
    def path(self) -> str:
        """Device path for the companion computer."""
        return self._terminal.path

    @property
    def duty(self) -> Duty:
        """What bare motors would get; the twin's own rover has motors with a speed controller."""
        left, right = self.wheels
        return Duty(left.duty, right.duty, self.state.drive.braked)

    def fileno(self) -> int:
        """Descriptor that becomes readable when the computer says something; -1 while unplugged."""
        return self._terminal.fileno()

    def step(self, now_s: float, inputs: Inputs) -> WheelTargets:
        """Read the wire, decide, report. Call it at 250 Hz, with the rover advanced to `now_s` before."""
        self._now_ms = self._milliseconds(now_s)
        dt_s = 0.0 if self._last_s is None else min(max(0.0, now_s - self._last_s), STEP_MAX_S)
        self._last_s = now_s
        self._inputs = inputs
        for received in self._link.feed(self._terminal.read(), now_s):
            handler = self._handlers.get(received.message.get_msgId())
            if handler is not None:
                handler(received.message)
        self.state = core.tick(self.state, inputs, self.parameters, self._now_ms, dt_s)
        self._turn_wheels(dt_s)
        self._report()
        drive = self.state.drive
        return WheelTargets(drive.left_mps, drive.right_mps, drive.braked)

    def _turn_wheels(self, dt_s: float) -> None:
        """Duty of both motors, for a plant that has bare ones."""
        s, i, (left, right) = self.state, self._inputs, self.wheels
        if s.drive.braked:
            self.wheels = (land_wheels.Wheel(), land_wheels.Wheel())
            return
        self.wheels = (
            land_wheels.step(left, s.drive.left_mps, s.left_mps, i.left_a, self.parameters, dt_s),
            land_wheels.step(right, s.drive.right_mps, s.right_mps, i.right_a, self.parameters, dt_s),
        )

    def unplug(self) -> None:
        """Pull the cable. The controller itself keeps its power."""
        self._terminal.unplug()

    def replug(self) -> None:
        """Put the cable back; the kernel gives the terminal a new number."""
        if self._terminal.replug():
            self._link.restart()

    def reboot(self, now_s: float) -> None:
        """Reset the processor; only the emergency stop and the boot count survive."""
        self.state = core.State(boot_count=self.state.boot_count + 1, estop=self.state.estop)
        self._boot_s = now_s
        self.wheels = (land_wheels.Wheel(), land_wheels.Wheel())
        self._due_state_ms = self._due_heartbeat_ms = 0
        self._link.restart()

    def press_estop(self) -> None:
        """The button on the robot."""
        self.state = core.on_estop(self.state)

    def close(self) -> None:
        """Give the terminal back."""
        self.unplug()

    def _milliseconds(self, now_s: float) -> int:
        return int((now_s - self._boot_s) * self._rate * 1000.0) & U32

    def _send(self, message: Message) -> None:
        frame = self._link.encode(message)
        if self._terminal.plugged and self._terminal.write(frame) < len(frame):
            self.dropped_frames += 1

    def _report(self) -> None:
        if core.ahead(self._now_ms, self._due_state_ms, 32) >= 0:
            self._due_state_ms = _next_due(self._due_state_ms, self._now_ms, STATE_PERIOD_MS)
            self._send(self._state_message())
        if core.ahead(self._now_ms, self._due_heartbeat_ms, 32) >= 0:
            self._due_heartbeat_ms = _next_due(self._due_heartbeat_ms, self._now_ms, HEARTBEAT_PERIOD_MS)
            s = self.state
            self._send(wire.MAVLink_land_heartbeat_message(s.session, self._now_ms, s.mode, int(s.engaged)))

    def _state_message(self) -> Message:
        s, i, counters = self.state, self._inputs, self._link.counters
        age = core.NEVER_MS
        if s.accepted_ms is not None:
            age = core.ahead(self._now_ms, s.accepted_ms, 32)
        return wire.MAVLink_land_state_message(
            time_ms=self._now_ms,
            ticks_left=wrapped(i.left_ticks),
            ticks_right=wrapped(i.right_ticks),
            v=_int16(500.0 * (s.left_mps + s.right_mps)),
            w=_int16(1000.0 * (s.right_mps - s.left_mps) / self.parameters.track),
            faults=s.faults,
            battery_mv=_uint16(1000.0 * i.battery_v),
            current_ma=_uint16(1000.0 * i.current_a),
            current_left=_int16(1000.0 * i.left_a),
            current_right=_int16(1000.0 * i.right_a),
            duty_left=_int16(1000.0 * self.wheels[0].duty),
            duty_right=_int16(1000.0 * self.wheels[1].duty),
            command_age=age,
            cmd_seq=s.sequence or 0,
            rx_good=counters.good & U16,
            rx_bad=counters.bad_crc & U16,
            rx_lost=counters.lost & U16,
            mode=s.mode,
            status=s.status,
            last_result=s.last_result,
        )

    def _ack(self, message: Request, result: int, token: int = 0) -> None:
        sequence = int(message.cmd_seq)
        self._send(wire.MAVLink_land_ack_message(token, message.get_msgId(), sequence, result))

    def _on_hello(self, m: wire.MAVLink_land_hello_message) -> None:
        same = (self._protocol, self._dialect_hash) == (wire.PROTOCOL, wire.DIALECT_HASH)
        protocol = m.protocol if same else 0  # a twin of another age opens no session for this dialect
        self.state = core.on_hello(self.state, m.nonce, protocol, m.dialect_hash, self._now_ms)
        major, minor, patch = FIRMWARE
        self._send(
            wire.MAVLink_land_identity_message(
                nonce=m.nonce,
                session=self.state.session,
                dialect_hash=self._dialect_hash,
                firmware=major << 16 | minor << 8 | patch,
                boot_count=self.state.boot_count,
                time_ms=self._now_ms,
                protocol=self._protocol,
                reset_cause=wire.LAND_RESET_POWER,
                serial=self._serial.encode(),
            )
        )

    def _on_heartbeat(self, m: wire.MAVLink_land_heartbeat_message) -> None:
        self.state = core.on_heartbeat(self.state, m.session, m.engaged == 1, self._now_ms)

    def _on_velocity(self, m: wire.MAVLink_land_velocity_message) -> None:
        command = core.Command(
            session=m.session,
            deadline_ms=m.deadline_ms,
            v_mmps=m.v,
            w_mradps=m.w,
            sequence=m.cmd_seq,
            engaged=bool(m.flags & wire.LAND_FLAG_ENGAGED),
            air_lock=bool(m.flags & wire.LAND_FLAG_AIR_LOCK),
        )
        self.state = core.on_velocity(self.state, command, self.parameters, self._now_ms)
        if self.state.last_result != wire.LAND_RESULT_OK:
            self._ack(m, self.state.last_result)

    def _on_param_read(self, m: wire.MAVLink_land_param_read_message) -> None:
        names = self.parameters.names()
        name = text_of(m.name)
        if not name and m.index < len(names):
            name = names[m.index]
        self._answer_param(m, name)

    def _on_param_write(self, m: wire.MAVLink_land_param_write_message) -> None:
        if not self.state.session or m.session != self.state.session:
            self._ack(m, wire.LAND_RESULT_SESSION)
            return
        if self.state.engaged:
            self._ack(m, wire.LAND_RESULT_BUSY)
            return
        name = text_of(m.name)
        changed = self.parameters.written(name, m.value)
        if changed is None:
            self._ack(
                m, wire.LAND_RESULT_RANGE if name in self.parameters.names() else wire.LAND_RESULT_UNKNOWN
            )
            return
        self.parameters = changed
        self._answer_param(m, name)

    def _answer_param(self, m: Request, name: str) -> None:
        value = self.parameters.get(name)
        if value is None:
            self._ack(m, wire.LAND_RESULT_UNKNOWN)
            return
        names = self.parameters.names()
        self._ack(m, wire.LAND_RESULT_OK)
        self._send(wire.MAVLink_land_param_message(value, names.index(name), len(names), name.encode()))

    def _on_estop(self, m: wire.MAVLink_land_estop_message) -> None:
        was = self.state.estop
        self.state = core.on_estop(self.state)
        self._ack(m, wire.LAND_RESULT_OK)
        if not was:
            self._send(
                wire.MAVLink_land_log_message(
                    self._now_ms, wire.LAND_SEVERITY_WARNING, b"emergency stop latched by command"
                )
            )

    def _on_release(self, m: wire.MAVLink_land_estop_release_message) -> None:
        self.state, result, token = core.on_release(self.state, m.session, m.step, m.token, self._now_ms)
        self._ack(m, result, token)

    def _on_timesync(self, m: wire.MAVLink_land_timesync_message) -> None:
        if m.controller_us == 0:
            self._send(wire.MAVLink_land_timesync_message(m.computer_us, self._now_ms * 1000))


def _next_due(due_ms: int, now_ms: int, period_ms: int) -> int:
    """The next due time after now, on the grid of the old one; missed reports are skipped."""
    behind = core.ahead(now_ms, due_ms, 32)
    return (due_ms + (behind // period_ms + 1) * period_ms) & U32


def _int16(value: float) -> int:
    return max(-32768, min(32767, round(value)))


def _uint16(value: float) -> int:
    return max(0, min(U16, round(value)))
