"""MAVSDK's connection to one autopilot: opened, used from the loop's thread, and destroyed."""

from __future__ import annotations

import asyncio
import json
import logging
from typing import Any

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.connection_result import ConnectionResult
from mavsdk.enums import ForwardingOption
from mavsdk.logging import LogLevel, log_subscribe
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkDirectError, MavlinkMessage
from mavsdk.plugins.param import Param, ParamError, ParamResult

from labr_autonomy.air.setpoints import Fields
from labr_autonomy.errors import BadInput, LinkError

_log = logging.getLogger("labr.mavsdk")
_LEVELS = {
    LogLevel.DEBUG: logging.DEBUG,
    LogLevel.INFO: logging.DEBUG,
    LogLevel.WARN: logging.INFO,
    LogLevel.ERROR: logging.WARNING,
}
# PX4 says that it has no such parameter; ArduPilot says nothing
ABSENT = (ParamResult.TIMEOUT, ParamResult.DOES_NOT_EXIST)


def _log_quietly(level: LogLevel, message: str, _file: str | None, _line: int) -> bool:
    _log.log(_LEVELS.get(level, logging.INFO), message)
    return True  # MAVSDK prints nothing itself


class Link:
    """One MAVSDK instance."""

    def __init__(self) -> None:
        log_subscribe(_log_quietly)
        self._sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER))
        self._direct: MavlinkDirect | None = None
        self._param: Param | None = None

    def add(self, url: str, *, forward: bool) -> None:
        """Open a connection.

        Raises:
            BadInput: The URL cannot be read.
            LinkError: The port or device cannot be opened.
        """
        option = ForwardingOption.ON if forward else ForwardingOption.OFF
        result = self._sdk.add_any_connection_with_forwarding(url, option)
        if result == ConnectionResult.SUCCESS:
            return
        if result in (ConnectionResult.CONNECTION_URL_INVALID, ConnectionResult.BAUDRATE_UNKNOWN):
            raise BadInput(
                f"{url!r} is no address of an autopilot",
                "Write udpin://HOST:PORT, udpout://HOST:PORT, tcpout://HOST:PORT or serial:///dev/NAME:BAUD.",
            )
        reason = result.name.lower().replace("_", " ")
        raise LinkError(
            f"the air link {url} could not be opened: {reason}",
            "Check that the device exists and that no other program uses it.",
        )

    async def first_autopilot(self, timeout_s: float) -> Any:
        """The first system with an autopilot, or None after `timeout_s`."""
        loop = asyncio.get_running_loop()
        found: asyncio.Future[Any] = loop.create_future()

        def settle(system: Any) -> None:
            if not found.done():
                found.set_result(system)

        handle = self._sdk.first_autopilot_async(timeout_s, lambda s: loop.call_soon_threadsafe(settle, s))
        try:
            return await found
        finally:
            self._sdk.cancel_first_autopilot(handle)

    def attach(self, system: Any) -> MavlinkDirect:
        """Talk to `system` from now on."""
        self._direct = MavlinkDirect(system)
        self._param = Param(system)
        return self._direct

    def read_parameter(self, name: str, *, whole: bool) -> float | None:
        """One parameter of the autopilot; blocks. None when there is none of that name, or no answer.

        MAVSDK knows how each family writes integers: PX4 bytewise, ArduPilot as a float.

        Raises:
            LinkError: The link is not open, or the parameter is of the other kind.
        """
        try:
            return float(
                self._params().get_param_int(name) if whole else self._params().get_param_float(name)
            )
        except ParamError as error:
            if error.result in ABSENT:
                return None
            raise self._parameter_fault(f"{name} could not be read", error) from error

    def write_parameter(self, name: str, value: float, *, whole: bool) -> None:
        """Set one parameter; blocks.

        Raises:
            LinkError: It was not taken.
        """
        try:
            if whole:
                self._params().set_param_int(name, int(value))
            else:
                self._params().set_param_float(name, value)
        except ParamError as error:
            raise self._parameter_fault(f"{name} could not be set to {value:g}", error) from error

    def _params(self) -> Param:
        if self._param is None:
            raise LinkError("the air link is not open", "Connect first.")
        return self._param

    @staticmethod
    def _parameter_fault(what: str, error: ParamError) -> LinkError:
        reason = error.result.name.lower().replace("_", " ")
        return LinkError(f"the autopilot's parameter {what}: {reason}", "Check the telemetry link.")

    def send(self, name: str, fields: Fields) -> None:
        """Send one message once; nothing repeats it.

        Raises:
            LinkError: It could not be sent.
        """
        if self._direct is None:
            raise LinkError(f"{name} was not sent: the air link is not open", "Connect first.")
        message = MavlinkMessage(name, 0, 0, 0, 0, json.dumps(fields))
        try:
            self._direct.send_message(message)
        except MavlinkDirectError as error:
            reason = error.result.name.lower().replace("_", " ")
            raise LinkError(f"{name} was not sent: {reason}", "Check the telemetry link.") from error

    def close(self) -> None:
        """End the connections and MAVSDK's threads."""
        self._direct = self._param = None
        self._sdk.destroy()
