"""A serial device, opened for one user only and read without waiting. Works on a pty as well."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import termios

import serial
from serial.tools import list_ports

from labr_autonomy.errors import LinkError

READ_BYTES = 4096


def _refusal(device: str, code: int | None, baud: int) -> LinkError:
    """Why the device could not be opened, as a sentence."""
    if code in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        present = ", ".join(sorted(port.device for port in list_ports.comports())) or "none"
        return LinkError(
            f"The serial device {device} is not there (serial devices present: {present})",
            "Plug the land controller in, or correct links.ground in robot.yaml.",
        )
    if code in (errno.EBUSY, errno.EAGAIN):
        return LinkError(
            f"The serial device {device} is in use by another program",
            "End the other program; only one may drive the wheels.",
        )
    if code in (errno.EACCES, errno.EPERM):
        return LinkError(
            f"This user may not open the serial device {device}",
            "Add the user to the group that owns it (dialout on Debian) and log in again.",
        )
    why = os.strerror(code) if code is not None else f"{baud} baud is not possible there"
    return LinkError(
        f"The serial device {device} cannot be opened: {why}",
        "Check links.ground and links.ground_baud in robot.yaml.",
    )


class SerialPort:
    """An open serial device. Nobody else can open it until `close`.

    Args:
        device: Path of the device; on the robot one of /dev/serial/by-id.
        baud: Symbol rate [1/s].

    Raises:
        LinkError: The device is absent, busy, forbidden or not a serial device.
    """

    def __init__(self, device: str, baud: int) -> None:
        try:
            self._serial = serial.Serial(device, baud, timeout=0, exclusive=True)
        except (OSError, ValueError, termios.error) as error:
            raise _refusal(device, getattr(error, "errno", None), baud) from None
        self.fd: int = self._serial.fileno()
        with contextlib.suppress(OSError):  # not every driver knows it; the lock above is held anyway
            fcntl.ioctl(self.fd, termios.TIOCEXCL)
        os.set_blocking(self.fd, False)
        with contextlib.suppress(OSError, termios.error):
            self._tell_silence_from_the_end()
            termios.tcflush(self.fd, termios.TCIFLUSH)  # what was said before is of no use

    def _tell_silence_from_the_end(self) -> None:
        """Make an empty read mean a device that is gone; pyserial's VMIN of 0 makes silence look the same."""
        attributes = termios.tcgetattr(self.fd)
        attributes[6][termios.VMIN] = 1
        termios.tcsetattr(self.fd, termios.TCSANOW, attributes)

    def read(self) -> bytes:
        """What has arrived, possibly nothing.

        Raises:
            LinkError: The device is gone.
        """
        try:
            data = os.read(self.fd, READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise LinkError(f"The serial device was unplugged ({error.strerror})") from None
        if not data:
            raise LinkError("The serial device was unplugged (end of file)")
        return data

    def write(self, data: bytes) -> int:
        """Hand `data` to the driver; returns how many bytes it took.

        Raises:
            LinkError: The device is gone.
        """
        try:
            return os.write(self.fd, data)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise LinkError(f"The serial device was unplugged ({error.strerror})") from None

    def close(self) -> None:
        """Give the device back; a second call does nothing."""
        if not self._serial.is_open:
            return
        with contextlib.suppress(OSError):
            fcntl.ioctl(self.fd, termios.TIOCNXCL)
        with contextlib.suppress(OSError, termios.error):
            self._serial.close()
