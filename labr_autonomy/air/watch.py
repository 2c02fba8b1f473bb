"""A window for a ground station (QGroundControl, MAVProxy): it sees every frame of the air link.

Read-only unless allowed: what the ground station says is then dropped here, before it reaches anybody. When
it may speak, it may do all that the autopilot lets a ground station do; the pilot yields to a mode that it
chooses.
"""

from __future__ import annotations

import contextlib
import socket
from dataclasses import dataclass
from urllib.parse import urlsplit

from labr_autonomy.air.address import port_of
from labr_autonomy.errors import BadInput, LinkError

DATAGRAM_MAX = 2048
BATCH_MAX = 200


@dataclass(frozen=True, slots=True)
class WatchAt:
    """Where a ground station listens, and whether it may speak."""

    host: str
    port: int
    may_speak: bool = False

    @staticmethod
    def parse(url: str, *, may_speak: bool) -> WatchAt:
        """From `udp://HOST:PORT`.

        Raises:
            BadInput: It is no such address.
        """
        parts = urlsplit(url)
        port = port_of(parts)
        if parts.scheme not in ("udp", "udpout") or not parts.hostname or not port:
            raise BadInput(
                f"'{url}' is no address of a ground station", "Write it like udp://127.0.0.1:14550."
            )
        return WatchAt(parts.hostname, port, may_speak)


class Watch:
    """The socket towards a ground station; used by the recorder's thread.

    Raises:
        LinkError: The host is not known.
    """

    def __init__(self, at: WatchAt) -> None:
        self._may_speak = at.may_speak
        try:
            self._remote = socket.getaddrinfo(at.host, at.port, socket.AF_INET, socket.SOCK_DGRAM)[0][4]
        except OSError as error:
            raise LinkError(f"the host {at.host} of the ground station is not known: {error}") from None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self.dropped = 0  # datagrams of a ground station that may not speak

    def show(self, data: bytes) -> None:
        """Pass a frame on; a ground station that is not there costs nothing."""
        with contextlib.suppress(OSError):
            self._socket.sendto(data, self._remote)

    def heard(self) -> list[bytes]:
        """What the ground station says and may say."""
        out: list[bytes] = []
        for _ in range(BATCH_MAX):
            try:
                data, sender = self._socket.recvfrom(DATAGRAM_MAX)
            except OSError:
                break
            if self._may_speak and sender == self._remote:
                out.append(data)
            else:
                self.dropped += 1
        return out

    def close(self) -> None:
        """Close the socket; may be called twice."""
        self._socket.close()
