"""MAVSDK's way of writing addresses, read for pymavlink."""

from __future__ import annotations

from typing import Any
from urllib.parse import SplitResult, urlsplit

from pymavlink import mavutil

from labr_autonomy.errors import BadInput, LinkError

_SCHEMES = {"udpin": "udpin", "udp": "udpin", "udpout": "udpout", "tcp": "tcp", "tcpout": "tcp"}


def device_of(url: str) -> tuple[str, int]:
    """What pymavlink calls a MAVSDK URL, and its baud rate.

    Raises:
        BadInput: It is no such URL.
    """
    parts = urlsplit(url)
    port = port_of(parts)
    scheme = _SCHEMES.get(parts.scheme)
    if scheme and parts.hostname and port:
        return f"{scheme}:{parts.hostname}:{port}", 0
    name, _, baud = url.removeprefix("serial://").rpartition(":")
    if url.startswith("serial://") and name and baud.isdigit():
        return name, int(baud)
    raise BadInput(
        f"{url!r} is no address of an autopilot",
        "Write udpin://HOST:PORT, udpout://HOST:PORT, tcp://HOST:PORT or serial:///dev/NAME:BAUD.",
    )


def port_of(parts: SplitResult) -> int | None:
    """The port of an address, None where it names none or no number."""
    try:
        return parts.port
    except ValueError:
        return None


def opened(url: str) -> Any:
    """Pymavlink's end of a link.

    Raises:
        BadInput: The URL cannot be read.
        LinkError: It cannot be opened.
    """
    device, baud = device_of(url)
    try:
        return mavutil.mavlink_connection(
            device, baud=baud or 57600, dialect="development", force_connected=True
        )
    except (OSError, ValueError) as error:
        raise LinkError(f"{url} cannot be opened: {error}", "Free it, or name another.") from None
