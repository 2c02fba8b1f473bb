"""A pseudo-terminal that looks like a USB serial port to the computer; its cable can be pulled."""

from __future__ import annotations

import os
import pty
import termios
import tty
from pathlib import Path

READ_BYTES = 4096


class Terminal:
    """The device's end.

    Args:
        link_path: Where to keep a symbolic link to the terminal, as udev does under /dev/serial/by-id, so
            that the path survives unplugging.
    """

    def __init__(self, link_path: Path | None = None) -> None:
        self._link_path = link_path
        self._master: int | None = None
        self._slave_path = ""
        self.replug()

    @property
    def path(self) -> str:
        """Device path for the computer."""
        return str(self._link_path) if self._link_path is not None else self._slave_path

    @property
    def plugged(self) -> bool:
        """Whether the cable is in."""
        return self._master is not None

    def fileno(self) -> int:
        """Descriptor that becomes readable when the computer says something; -1 while unplugged."""
        return -1 if self._master is None else self._master

    def read(self) -> bytes:
        """What the computer has said, possibly nothing."""
        if self._master is None:
            return b""
        try:
            return os.read(self._master, READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError:  # EIO: nobody has the other side open
            return b""

    def write(self, data: bytes) -> int:
        """Say something; returns how many bytes found room."""
        if self._master is None:
            return 0
        try:
            return os.write(self._master, data)
        except OSError:
            return 0

    def unplug(self) -> None:
        """Pull the cable."""
        if self._master is not None:
            os.close(self._master)
            self._master = None
        if self._link_path is not None:
            self._link_path.unlink(missing_ok=True)

    def replug(self) -> bool:
        """Put the cable back; the kernel gives the terminal a new number. False if it was in."""
        if self._master is not None:
            return False
        self._master, slave = pty.openpty()
        tty.setraw(slave, termios.TCSANOW)
        self._slave_path = os.ttyname(slave)
        os.close(slave)
        os.set_blocking(self._master, False)
        if self._link_path is not None:
            fresh = self._link_path.with_name(self._link_path.name + ".new")
            fresh.unlink(missing_ok=True)
            fresh.symlink_to(self._slave_path)
            fresh.replace(self._link_path)
        return True
