"""Requests that count when their effect shows in the autopilot's state, not when they are acknowledged."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from labr_autonomy.air import px4
from labr_autonomy.air.commands import Commands
from labr_autonomy.air.mailbox import Mailbox
from labr_autonomy.air.report import Report
from labr_autonomy.air.telemetry import AirState
from labr_autonomy.clock import Clock
from labr_autonomy.errors import LinkError

EFFECT_S = 2.0  # an acknowledged request must show in the state within this; heartbeats come at 1 Hz
REASON_S = 0.3  # the words of a refusal come just after its acknowledgement
POLL_S = 0.02


class Effects:
    """Asks, and waits for what was asked for.

    Args:
        commands: Sends commands and waits for their acknowledgement.
        mailbox: Where heartbeats arrive; whoever empties it calls `beat`.
        report: What the autopilot says in words.
        state: The state now.
        clock: Time.
    """

    def __init__(
        self,
        commands: Commands,
        mailbox: Mailbox,
        report: Report,
        state: Callable[[], AirState],
        clock: Clock,
    ) -> None:
        self._commands = commands
        self._mailbox = mailbox
        self._report = report
        self._state = state
        self._clock = clock
        self._beat = asyncio.Event()

    def beat(self) -> None:
        """A heartbeat has arrived; on the loop."""
        self._beat.set()

    async def request(
        self,
        name: str,
        reached: Callable[[AirState], bool],
        command: int,
        *params: float,
        effect_s: float = EFFECT_S,
    ) -> None:
        """Ask once, and see the effect.

        Args:
            name: What is asked for, to complete "the request to ...".
            reached: Whether the state shows it.
            command: MAV_CMD.
            params: param1 and following.
            effect_s: It must show within this after the acknowledgement.

        Raises:
            LinkError: Refused with the autopilot's reason, not acknowledged, or without effect.
        """
        asked_s = self._clock.now_s()
        result = await self._commands.run(name, command, *params)
        if result != px4.ACCEPTED:
            said = await self._reason(asked_s)
            reason = f'; it says "{said}"' if said else ""
            raise LinkError(f"the autopilot refused to {name}: {px4.result_name(result)}{reason}")
        limit_s = self._clock.now_s() + effect_s
        await self.until(
            lambda: reached(self._state()),
            asked_s,
            limit_s,
            f"the autopilot accepted the request to {name}, but {effect_s:.0f} s later there is no effect",
        )

    async def until(
        self, reached: Callable[[], bool], since_s: float, deadline_s: float, else_say: str
    ) -> None:
        """Wait for a heartbeat younger than `since_s` with which `reached` holds.

        Raises:
            LinkError: `else_say`, at the deadline.
        """
        while True:
            beat = self._mailbox.latest.get("HEARTBEAT")
            if beat is not None and beat.arrival_s > since_s and reached():
                return
            self._beat.clear()
            left_s = deadline_s - self._clock.now_s()
            try:
                async with asyncio.timeout(max(0.0, left_s)):
                    await self._beat.wait()
            except TimeoutError:
                mode = f" (mode {self._state().mode})" if beat is not None else ""
                raise LinkError(f"{else_say}{mode}", "Check the autopilot and its link.") from None

    async def _reason(self, asked_s: float) -> str:
        """What the autopilot says of a refusal; its words come after the acknowledgement."""
        deadline_s = self._clock.now_s() + REASON_S
        while not (said := self._report.reason(asked_s)) and self._clock.now_s() < deadline_s:
            await self._clock.sleep_until(self._clock.now_s() + POLL_S)
        return said
