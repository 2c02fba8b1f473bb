"""COMMAND_LONG and its COMMAND_ACK, awaited on the loop.

The repeats belong to the coroutine that asked: cancelled or overtaken, it sends nothing more. (MAVSDK's own
commands go on being repeated by its thread after the caller has given up.) One command is under way at a
time and the latest request wins, so that a landing never waits behind, or is undone by, an older request.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

from labr_autonomy.air import px4
from labr_autonomy.air.setpoints import Fields
from labr_autonomy.air.telemetry import Received
from labr_autonomy.errors import LinkError

REPEAT_S = 0.3  # PX4 acknowledges within 20 ms; this leaves room for 300 ms of link delay
SENDS = 5
PROGRESS_S = 5.0  # how long to wait on after an acknowledgement that says "in progress"


@dataclass(slots=True)
class _Pending:
    name: str
    command: int
    result: asyncio.Future[int]
    in_progress: asyncio.Event


def command_fields(command: int, params: tuple[float, ...], confirmation: int, system: int) -> Fields:
    """Fields of COMMAND_LONG (76) to the autopilot of `system`; parameters not given are 0."""
    padded = (*params, *([0.0] * (7 - len(params))))
    return {
        "target_system": system,
        "target_component": px4.AUTOPILOT_COMPONENT,
        "command": command,
        "confirmation": confirmation,
        **{f"param{i}": value for i, value in enumerate(padded, start=1)},
    }


class Commands:
    """Sends commands and matches their acknowledgements."""

    def __init__(self, send: Callable[[str, Fields], None], system: int) -> None:
        self._send = send
        self._system = system
        self._pending: _Pending | None = None

    def take_ack(self, fields: Received) -> None:
        """A COMMAND_ACK arrived; on the loop."""
        pending = self._pending
        if pending is None or int(fields["command"]) != pending.command or pending.result.done():
            return
        if int(fields["result"]) == px4.IN_PROGRESS:
            pending.in_progress.set()
        else:
            pending.result.set_result(int(fields["result"]))

    def overtake(self, by: str) -> None:
        """End the command under way, if any."""
        if self._pending is not None and not self._pending.result.done():
            sentence = f"the request to {self._pending.name} was overtaken by the request to {by}"
            self._pending.result.set_exception(LinkError(sentence))

    async def run(self, name: str, command: int, *params: float) -> int:
        """Send until acknowledged and return the MAV_RESULT.

        Args:
            name: What is asked for, to complete "the request to ...".
            command: MAV_CMD.
            params: param1 and following.

        Raises:
            LinkError: No acknowledgement within `SENDS * REPEAT_S`, or a later request overtook this one.
        """
        self.overtake(name)
        pending = _Pending(name, command, asyncio.get_running_loop().create_future(), asyncio.Event())
        self._pending = pending
        try:
            for confirmation in range(SENDS):
                self._send("COMMAND_LONG", command_fields(command, params, confirmation, self._system))
                if await self._answered(pending, REPEAT_S):
                    return pending.result.result()
                if pending.in_progress.is_set():
                    if await self._answered(pending, PROGRESS_S):
                        return pending.result.result()
                    break
        finally:
            if self._pending is pending:
                self._pending = None
            if not pending.result.cancel() and not pending.result.cancelled():
                pending.result.exception()  # seen, also when the asker was cancelled in the same moment
        raise LinkError(
            f"the autopilot did not acknowledge the request to {name}, sent {confirmation + 1} times",
            "Check the telemetry link.",
        )

    @staticmethod
    async def _answered(pending: _Pending, timeout_s: float) -> bool:
        done, _ = await asyncio.wait([pending.result], timeout=timeout_s)
        return bool(done)
