"""Requests that the land controller answers: emergency stop, its two-step end, parameters.

A request is repeated with the same sequence number until it is answered; each of them may be carried out
twice without harm. Whether an emergency stop holds is read off the telemetry, never off the answer.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

from firmware_bridge.dialect import labr_land as dialect
from firmware_bridge.link import Message, text_of
from labr_autonomy.clock import Clock
from labr_autonomy.errors import LinkError, Refused
from labr_autonomy.ground.words import result_words

POLL_S = 0.01
REPEAT_S = 0.05  # of a request that was not answered
TIMEOUT_S = 1.0
U16 = 0xFFFF

Request: TypeAlias = (
    dialect.MAVLink_land_estop_release_message
    | dialect.MAVLink_land_param_read_message
    | dialect.MAVLink_land_param_write_message
)


class Requests:
    """Ask and wait for the answer.

    Args:
        send: Sends one message, at once or not at all.
        clock: For timeouts.
        session: The open session, 0 if none.
        mode: Newest LAND_MODE of the telemetry, None before the first.
    """

    def __init__(
        self,
        send: Callable[[Message], bool],
        clock: Clock,
        session: Callable[[], int],
        mode: Callable[[], int | None],
    ) -> None:
        self._send = send
        self._clock = clock
        self._session = session
        self._mode = mode
        self._sequence = 0
        self._answers: dict[int, tuple[int, int]] = {}  # request sequence -> LAND_RESULT, token
        self._parameters: dict[int, tuple[str, float, int]] = {}  # index -> name, value, count

    def next_sequence(self) -> int:
        """A new sequence number; requests and velocity commands share the counter."""
        self._sequence = (self._sequence + 1) & U16
        return self._sequence

    def on_ack(self, message: dialect.MAVLink_land_ack_message) -> None:
        """Take an answer; refused velocity commands show in the telemetry instead."""
        if message.of != dialect.MAVLINK_MSG_ID_LAND_VELOCITY:
            self._answers[message.cmd_seq] = (message.result, message.token)

    def on_param(self, message: dialect.MAVLink_land_param_message) -> None:
        """Take the value of a parameter."""
        self._parameters[message.index] = (text_of(message.name), message.value, message.count)

    async def estop(self) -> None:
        """See `GroundChannel.estop`."""
        message = dialect.MAVLink_land_estop_message(self.next_sequence())
        await self._until(
            lambda: self._mode() == dialect.LAND_MODE_ESTOP,
            lambda: self._send(message),
            "the emergency stop",
        )

    async def request_release(self) -> int:
        """See `GroundChannel.request_release`."""
        return await self._request(
            dialect.MAVLink_land_estop_release_message(self._session(), 0, self.next_sequence(), 1)
        )

    async def confirm_release(self, token: int) -> None:
        """See `GroundChannel.confirm_release`."""
        message = dialect.MAVLink_land_estop_release_message(self._session(), token, self.next_sequence(), 2)
        await self._until(
            lambda: self._mode() not in (None, dialect.LAND_MODE_ESTOP),
            lambda: self._send(message),
            "the end of the emergency stop",
        )

    async def read_parameters(self) -> dict[str, float]:
        """See `GroundChannel.read_parameters`."""
        self._parameters.clear()
        index, count = 0, 1
        while index < count:
            message = dialect.MAVLink_land_param_read_message(self.next_sequence(), index, b"")
            await self._request(message, value_of=index)
            count = self._parameters[index][2]
            index += 1
        return {name: value for name, value, _ in self._parameters.values()}

    async def write_parameter(self, name: str, value: float) -> None:
        """See `GroundChannel.write_parameter`."""
        await self._request(
            dialect.MAVLink_land_param_write_message(
                self._session(), value, self.next_sequence(), name.encode()[:16]
            )
        )

    async def _request(self, message: Request, value_of: int | None = None) -> int:
        """Send until it is acknowledged, and its value has come if it asks for one; returns the token."""
        sequence = int(message.cmd_seq)
        self._answers.pop(sequence, None)

        def answered() -> bool:
            if sequence not in self._answers:
                return False
            refused = self._answers[sequence][0] != dialect.LAND_RESULT_OK
            return refused or value_of is None or value_of in self._parameters

        await self._until(answered, lambda: self._send(message), "a request")
        result, token = self._answers.pop(sequence)
        if result != dialect.LAND_RESULT_OK:
            raise Refused(f"The land controller refused: {result_words(result)}")
        return token

    async def _until(self, done: Callable[[], bool], again: Callable[[], bool], what: str) -> None:
        """Repeat `again` until `done`."""
        deadline_s = self._clock.now_s() + TIMEOUT_S
        due_s = -math.inf
        while not done():
            now_s = self._clock.now_s()
            if now_s >= deadline_s:
                raise LinkError(
                    f"The land controller did not confirm {what} within {TIMEOUT_S:.1f} s",
                    "Check the link with labr-mission doctor; the switch on the robot always works.",
                )
            if now_s >= due_s:
                due_s = now_s + REPEAT_S
                again()
            await self._clock.sleep_until(now_s + POLL_S)
