"""The socket behind VIO: UDP in, checked `VioSample`s out; whatever is refused is counted by its reason."""

from __future__ import annotations

import asyncio
import math
from collections import Counter
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

from labr_autonomy.clock import Clock, SystemClock
from labr_autonomy.errors import BadInput, LinkError
from labr_autonomy.estimation.vio_message import Refusal, VioSample, decode_vio, encode_vio

__all__ = ["Refusal", "VioLink", "VioSample", "encode_vio", "udp_address"]

FUTURE_MAX_S = 0.05  # a stamp further ahead means that the source runs on another clock


def udp_address(url: str) -> tuple[str, int]:
    """Host and port of `udp://HOST:PORT`."""
    parts = urlsplit(url)
    try:
        port = parts.port
    except ValueError:
        port = None
    if parts.scheme != "udp" or not parts.hostname or port is None:
        raise BadInput(f"'{url}' is no address for VIO poses", "Write it like udp://127.0.0.1:14560.")
    return parts.hostname, port


class VioLink(asyncio.DatagramProtocol):
    """Receives MAVLink ODOMETRY and hands each usable sample to `callback`, in the event loop's thread.

    Args:
        url: `udp://HOST:PORT` to bind.
        callback: Called with every accepted sample.
        clock: The clock that the samples' stamps are on.
    """

    def __init__(self, url: str, callback: Callable[[VioSample], Any], clock: Clock | None = None) -> None:
        self._address = udp_address(url)
        self._url = url
        self._callback = callback
        self._clock: Clock = clock or SystemClock()
        self._transport: asyncio.BaseTransport | None = None
        self._latest_s = -math.inf
        self.accepted = 0
        self.refused: Counter[Refusal] = Counter()

    async def open(self) -> None:
        """Bind the port."""
        loop = asyncio.get_running_loop()
        try:
            await loop.create_datagram_endpoint(lambda: self, local_addr=self._address)
        except OSError as error:
            raise LinkError(
                f"cannot receive VIO poses at {self._url}: {error.strerror or error}",
                "Free the port, or change links.vio in robot.yaml.",
            ) from error

    @property
    def port(self) -> int:
        """The bound UDP port; of use when the URL says 0."""
        if self._transport is None:
            raise LinkError(f"VIO link {self._url} is not open", "Await open() first.")
        return int(self._transport.get_extra_info("sockname")[1])

    def close(self) -> None:
        """Release the port; may be called twice."""
        if self._transport is not None:
            self._transport.close()
            self._transport = None

    def age_s(self, now_s: float) -> float:
        """Time since the newest accepted sample was exposed [s]; infinite before the first."""
        return now_s - self._latest_s

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the transport, so that `close` releases the port however the endpoint was made."""
        self._transport = transport

    def datagram_received(self, data: bytes, addr: tuple[str | Any, int]) -> None:
        """Check each message of a datagram and pass the samples on."""
        for item in decode_vio(data):
            verdict = self._refusal(item)
            if verdict is not None:
                self.refused[verdict] += 1
            elif isinstance(item, VioSample):
                self._latest_s = item.stamp_s
                self.accepted += 1
                self._callback(item)

    def _refusal(self, item: VioSample | Refusal) -> Refusal | None:
        """Why `item` cannot be used now, or None."""
        if isinstance(item, Refusal):
            return item
        if item.stamp_s > self._clock.now_s() + FUTURE_MAX_S:
            return Refusal.FUTURE
        return None if item.stamp_s > self._latest_s else Refusal.STAMP
