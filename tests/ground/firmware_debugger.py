"""The emulated processor's memory and registers, by GDB's remote protocol."""

from __future__ import annotations

import contextlib
import re
import socket

SP = 13


class Debugger:
    """Stops the machine while it is open.

    Args:
        machine: A `sim.firmware.qemu.Qemu`.
        folder: For the socket.
    """

    def __init__(self, machine, folder) -> None:
        path = folder / "gdb.sock"
        machine.monitor(f"gdbserver unix:{path},server=on,wait=off")
        self._machine = machine
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(10.0)
        self._socket.connect(str(path))
        self._received = b""

    def __enter__(self):
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(OSError):
            self._ask("D")  # it runs on
        self._socket.close()
        self._machine.monitor("gdbserver none")

    def _ask(self, words: str) -> str:
        self._socket.sendall(f"${words}#{sum(words.encode()) & 0xFF:02x}".encode())
        while (answer := self._packet()).startswith(("T", "S")):
            pass  # it says that it has stopped, when it finds the time
        return answer

    def _packet(self) -> str:
        while (found := re.match(rb"[+-]*\$([^#]*)#..", self._received)) is None:
            self._received += self._socket.recv(4096)
        self._received = self._received[found.end() :]
        self._socket.sendall(b"+")
        return found[1].decode()

    def read(self, address: int, size: int) -> bytes:
        return b"".join(
            bytes.fromhex(self._ask(f"m{address + at:x},{min(512, size - at):x}"))
            for at in range(0, size, 512)
        )

    def write(self, address: int, data: bytes) -> None:
        assert self._ask(f"M{address:x},{len(data):x}:{data.hex()}") == "OK"

    def set_register(self, number: int, value: int) -> None:
        self._ask("qXfer:features:read:target.xml:0,ffb")  # who asks for it may set single registers
        assert self._ask(f"P{number:x}={value.to_bytes(4, 'little').hex()}") == "OK"
