"""What is asked of an autopilot when the link opens: streams, version, and an origin where it wants one."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping

from labr_autonomy.air import px4
from labr_autonomy.air.commands import Commands
from labr_autonomy.air.mailbox import Mailbox
from labr_autonomy.air.setpoints import Fields, origin_fields
from labr_autonomy.air.telemetry import Received
from labr_autonomy.clock import Clock
from labr_autonomy.errors import LinkError

_log = logging.getLogger("labr.air")

ANSWERS = ("AUTOPILOT_VERSION", "GPS_GLOBAL_ORIGIN")  # kept by the mailbox for this
ANSWER_S = 0.5  # a message asked for comes within this, or the autopilot has it not
ORIGIN_SENDS = 5
POLL_S = 0.02


class Handshake:
    """Questions to one autopilot.

    Args:
        send: Sends one message.
        commands: Sends commands and waits for their acknowledgement.
        mailbox: Where answers arrive.
        clock: Time.
    """

    def __init__(
        self, send: Callable[[str, Fields], None], commands: Commands, mailbox: Mailbox, clock: Clock
    ) -> None:
        self._send = send
        self._commands = commands
        self._mailbox = mailbox
        self._clock = clock

    async def ask_for_streams(self, streams: Mapping[str, tuple[int, float]]) -> None:
        """Ask for each message at its rate [Hz]; what is refused is logged.

        Raises:
            LinkError: The very first request is not acknowledged.
        """
        answered = 0
        for name, (number, rate_hz) in streams.items():
            try:
                result = await self._commands.run(
                    f"send {name}", px4.CMD_SET_MESSAGE_INTERVAL, float(number), 1e6 / rate_hz
                )
            except LinkError as error:
                _log.warning("%s", error)
                if answered == 0:
                    raise
                continue
            answered += 1
            if result != px4.ACCEPTED:
                _log.warning("the autopilot refused to send %s: %s", name, px4.result_name(result))

    async def ask_for_message(self, name: str, number: int) -> Received | None:
        """One message on request; None where the autopilot does not send it."""
        asked_s = self._clock.now_s()
        try:
            result = await self._commands.run(f"send {name}", px4.CMD_REQUEST_MESSAGE, float(number))
        except LinkError as error:
            _log.warning("%s", error)
            return None
        return await self._answer(name, asked_s) if result == px4.ACCEPTED else None

    async def set_origin(self) -> None:
        """Give ArduPilot the global origin that it wants before it fuses poses; one it has already stays.

        Raises:
            LinkError: It does not confirm.
        """
        if await self.ask_for_message("GPS_GLOBAL_ORIGIN", px4.MSG_GPS_GLOBAL_ORIGIN) is not None:
            return
        for _ in range(ORIGIN_SENDS):
            asked_s = self._clock.now_s()
            self._send("SET_GPS_GLOBAL_ORIGIN", origin_fields(px4.VEHICLE_SYSTEM))
            if await self._answer("GPS_GLOBAL_ORIGIN", asked_s) is not None:
                return
        raise LinkError(
            "the autopilot did not confirm the origin of its position estimate",
            "Check that its EKF3 runs (AHRS_EKF_TYPE 3).",
        )

    async def _answer(self, name: str, asked_s: float) -> Received | None:
        deadline_s = self._clock.now_s() + ANSWER_S
        while self._clock.now_s() < deadline_s:
            message = self._mailbox.latest.get(name)
            if message is not None and message.arrival_s >= asked_s:
                return message.fields
            await self._clock.sleep_until(self._clock.now_s() + POLL_S)
        return None
