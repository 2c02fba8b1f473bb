"""Who may speak to a local UDP socket that is meant for MAVSDK: one socket of this process, always the same.

Every program on the computer can reach 127.0.0.1. Without this, one of them could have its frames signed in
our name, put into the log, or get what is meant for MAVSDK.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

Address = tuple[str, int]

FILES = Path("/proc/self/fd")
SOCKETS = (Path("/proc/self/net/udp"), Path("/proc/self/net/udp6"))  # columns: proc_net_udp(5)
LOCAL, INODE = 1, 9


class Peer:
    """MAVSDK's end of a local link, once it has spoken."""

    def __init__(self) -> None:
        self.address: Address | None = None
        self.strangers = 0  # datagrams of anybody else

    def admits(self, sender: Address) -> bool:
        """Whether a datagram comes from it. The first socket of this process that speaks stays the peer."""
        if self.address is None and belongs_to_us(sender[1]):
            self.address = sender
        if sender == self.address:
            return True
        self.strangers += 1
        return False


def belongs_to_us(port: int) -> bool:
    """Whether a UDP socket of this process has this local port; takes about a millisecond."""
    ours = set()
    for file in FILES.iterdir():
        with contextlib.suppress(OSError):  # closed meanwhile
            ours.add(os.readlink(file))
    return any(f"socket:[{inode}]" in ours for inode in _inodes(port))


def _inodes(port: int) -> list[str]:
    """Inodes of all UDP sockets with this local port."""
    tables = [table.read_text().splitlines()[1:] for table in SOCKETS if table.exists()]
    rows = [line.split() for lines in tables for line in lines]
    return [row[INODE] for row in rows if int(row[LOCAL].rpartition(":")[2], 16) == port]
