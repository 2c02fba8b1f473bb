"""The command desk: COMMAND_LONG and COMMAND_INT, parameters, PING, with PX4's answers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from pymavlink.dialects.v20 import development as mavlink

from sim.autopilot import telemetry
from sim.autopilot.commander import Kind, Request, Result
from sim.autopilot.modes import FlightMode, find_mode
from sim.autopilot.parameters import Parameters
from sim.autopilot.telemetry import Schedule, Snapshot

FORCE = 21196.0
CUSTOM_MODE = 1
LIST_SPACING_S = 0.0008  # 932 parameters in 0.7 s
PARAM_UNKNOWN = 1  # MAV_PARAM_ERROR_DOES_NOT_EXIST


@dataclass(frozen=True, slots=True)
class Answer:
    """One COMMAND_ACK."""

    command: int
    result: Result
    to_system: int
    to_component: int


class Office(Protocol):
    """What the desk needs of the vehicle."""

    parameters: Parameters

    @property
    def schedule(self) -> Schedule:
        """Message intervals."""
        ...

    @property
    def boot_s(self) -> float:
        """Time since boot [s]."""
        ...

    def ask(self, asked: Request) -> Result:
        """Put a request to the commander."""
        ...

    def answer(self, answer: Answer) -> None:
        """Send an acknowledgement."""
        ...

    def send(self, message: mavlink.MAVLink_message) -> None:
        """Send a message."""
        ...

    def queue(
        self, messages: list[mavlink.MAVLink_message], *, every_s: float = 0.0, after_s: float = 0.0
    ) -> None:
        """Send messages later."""
        ...

    def snapshot(self) -> Snapshot:
        """What telemetry would show."""
        ...


class Desk:
    """Answers everything that is neither a set-point nor a pose."""

    def __init__(self, office: Office) -> None:
        self._office = office

    def take(self, message: mavlink.MAVLink_message) -> bool:
        """Handle one message; False when it means nothing here or is for somebody else."""
        if getattr(message, "target_system", 1) not in (0, 1) or getattr(
            message, "target_component", 1
        ) not in (0, 1):
            return False
        match message.get_type():
            case "COMMAND_LONG" | "COMMAND_INT":
                self._command(message)
            case "PARAM_REQUEST_READ":
                reply = self._office.parameters.read(message.param_id, message.param_index)
                self._parameter(reply, message)
            case "PARAM_SET":
                value = message.param_value
                self._parameter(
                    self._office.parameters.write(message.param_id, value, message.param_type), message
                )
            case "PARAM_REQUEST_LIST":
                self._office.queue(self._office.parameters.everything(), every_s=LIST_SPACING_S)
            case "PING" if message.target_system == 0:
                to = (message.get_srcSystem(), message.get_srcComponent())
                self._office.send(mavlink.MAVLink_ping_message(message.time_usec, message.seq, *to))
            case _:
                return False
        return True

    def _parameter(self, reply: mavlink.MAVLink_message | None, asked: mavlink.MAVLink_message) -> None:
        if reply is None:
            to = (asked.get_srcSystem(), asked.get_srcComponent())
            index = getattr(asked, "param_index", -1)
            reply = mavlink.MAVLink_param_error_message(*to, asked.param_id.encode(), index, PARAM_UNKNOWN)
        self._office.send(reply)

    def _command(self, message: mavlink.MAVLink_message) -> None:
        result = self._carry_out(message)
        to = (message.get_srcSystem(), message.get_srcComponent())
        self._office.answer(Answer(message.command, result, *to))

    def _carry_out(self, m: mavlink.MAVLink_message) -> Result:
        match m.command:
            case mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
                kind = Kind.ARM if m.param1 >= 0.5 else Kind.DISARM
                return self._office.ask(Request(kind, force=m.param2 == FORCE))
            case mavlink.MAV_CMD_DO_SET_MODE:
                return self._office.ask(Request(Kind.MODE, _mode_of(m)))
            case mavlink.MAV_CMD_NAV_TAKEOFF:
                return self._office.ask(Request(Kind.TAKEOFF))
            case mavlink.MAV_CMD_NAV_LAND:
                return self._office.ask(Request(Kind.LAND))
            case mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                return self._office.ask(Request(Kind.MODE, FlightMode.RETURN))
            case mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
                known = self._office.schedule.set_interval(_whole(m.param1), m.param2)
                return Result.ACCEPTED if known else Result.DENIED
            case mavlink.MAV_CMD_GET_MESSAGE_INTERVAL:
                message_id = _whole(m.param1)
                interval_us = self._office.schedule.interval_us(message_id)
                self._office.send(mavlink.MAVLink_message_interval_message(message_id, interval_us))
                return Result.ACCEPTED
            case mavlink.MAV_CMD_REQUEST_MESSAGE:
                return self._one_message(_whole(m.param1))
            case mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
                return self._one_message(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        return Result.UNSUPPORTED

    def _one_message(self, message_id: int) -> Result:
        """REQUEST_MESSAGE; HOME_POSITION and the rest that it has not got are denied."""
        if message_id == mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            self._office.send(telemetry.autopilot_version(self._office.snapshot()))
            return Result.ACCEPTED
        builder = telemetry.BUILDERS.get(message_id)
        if builder is None:
            return Result.DENIED
        self._office.send(builder(self._office.snapshot()))
        return Result.ACCEPTED


def _mode_of(m: mavlink.MAVLink_message) -> FlightMode | None:
    if not _whole(m.param1) & CUSTOM_MODE:
        return None
    return find_mode(_whole(m.param2), _whole(m.param3))


def _whole(value: float) -> int:
    return int(value) if math.isfinite(value) else 0
