"""Port, link, log and event loop joined into one thing that can be lost and opened again."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Protocol

from firmware_bridge.link import Counters, Link, Message
from firmware_bridge.port import SerialPort
from labr_autonomy.clock import Clock, utc_s
from labr_autonomy.errors import LinkError


class FrameLog(Protocol):
    """Where every frame of both directions is written."""

    def write(self, stamp_utc_s: float, frame: bytes) -> None:
        """Keep `frame`, seen at `stamp_utc_s` [s since the epoch]."""
        ...


class Wire:
    """A serial line to the land controller, read by the running event loop.

    Args:
        device: Path of the serial device.
        baud: Symbol rate [1/s].
        clock: Time of reception.
        log: Both directions go there; may be None.
        on_message: Gets each message with its time of reception [s].
        on_lost: Called once with the reason when the device goes away.
    """

    def __init__(
        self,
        device: str,
        baud: int,
        clock: Clock,
        log: FrameLog | None,
        on_message: Callable[[Message, float], None],
        on_lost: Callable[[str], None],
    ) -> None:
        self._device = device
        self._baud = baud
        self._clock = clock
        self._log = log
        self._on_message = on_message
        self._on_lost = on_lost
        self._link = Link()
        self._port: SerialPort | None = None
        self._unsent = b""
        self.dropped = 0  # frames that were not sent because the device took nothing
        self.received_bytes = 0

    @property
    def is_open(self) -> bool:
        """True while the device is held."""
        return self._port is not None

    @property
    def counters(self) -> Counters:
        """What the link has seen."""
        return self._link.counters

    def open(self) -> None:
        """Take the device and begin to read.

        Raises:
            LinkError: Absent, busy or forbidden.
        """
        self._port = SerialPort(self._device, self._baud)
        self._link.restart()
        self._unsent = b""
        asyncio.get_running_loop().add_reader(self._port.fd, self._on_readable)

    def close(self) -> None:
        """Give the device back; does nothing when there is none."""
        if self._port is None:
            return
        asyncio.get_running_loop().remove_reader(self._port.fd)
        self._port.close()
        self._port = None

    def send(self, message: Message) -> bool:
        """Send at once or not at all: nothing waits in a queue to become old. False if it was not sent."""
        if self._port is None:
            return False
        frame = self._link.encode(message)
        try:
            if self._unsent:  # the rest of a frame that went out in part
                self._unsent = self._unsent[self._port.write(self._unsent) :]
            if self._unsent:
                self.dropped += 1
                return False
            taken = self._port.write(frame)
        except LinkError as error:
            self._lose(error.what)
            return False
        if taken == 0:
            self.dropped += 1
            return False
        self._unsent = frame[taken:]
        if self._log is not None:
            self._log.write(utc_s(), frame)
        return True

    def _on_readable(self) -> None:
        if self._port is None:
            return
        try:
            data = self._port.read()
        except LinkError as error:
            self._lose(error.what)
            return
        now_s = self._clock.now_s()
        self.received_bytes += len(data)
        for received in self._link.feed(data, now_s):
            if self._log is not None:
                self._log.write(utc_s(), received.raw)
            self._on_message(received.message, now_s)

    def _lose(self, reason: str) -> None:
        self.close()
        self._on_lost(reason)
