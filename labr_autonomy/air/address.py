"""MAVSDK's way of writing addresses, read for pymavlink."""

from __future__ import annotations

from urllib.parse import urlsplit

from labr_autonomy.errors import BadInput

_SCHEMES = {"udpin": "udpin", "udp": "udpin", "udpout": "udpout", "tcp": "tcp", "tcpout": "tcp"}


def device_of(url: str) -> tuple[str, int]:
    """What pymavlink calls a MAVSDK URL, and its baud rate.

    Raises:
        BadInput: It is no such URL.
    """
    parts = urlsplit(url)
    try:
        port = parts.port
    except ValueError:
        port = None
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
