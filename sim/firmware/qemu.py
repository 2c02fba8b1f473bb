"""An emulated STM32F405 (QEMU's netduinoplus2) that runs the firmware, with its serial ports as sockets.

What the emulation lacks, and what stands in for it: pins, PWM and encoder timers (the plant on the second
serial port), the watchdog (`reset` from outside). A serial port whose bytes nobody takes would stop the
processor: whoever owns this must keep reading both.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import socket
import subprocess
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from labr_autonomy.errors import LinkError, Refused
from labr_autonomy.processes import REALTIME_PRIORITY, die_with_parent

MACHINE = "netduinoplus2"
PROGRAM = "qemu-system-arm"
ANSWER_S = 10.0
END_S = 3.0
PRIORITY = REALTIME_PRIORITY - 1  # the simulation around it goes first


def _like_a_chip() -> None:
    """In the new process: end with its starter, and share the processor with nobody where that is allowed."""
    die_with_parent()
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))


class Qemu:
    """A running machine; use as a context manager.

    Args:
        elf: The image, `firmware_bridge.build.image().elf`.
        log: File for QEMU's words on accesses to devices that it does not have; None for nowhere.

    Attributes:
        link: Socket of USART1, the computer's side.
        plant: Socket of USART2, the simulated robot's side.

    Raises:
        Refused: QEMU is not installed.
        LinkError: It does not start.
    """

    def __init__(self, elf: Path, log: Path | None = None) -> None:
        if shutil.which(PROGRAM) is None:
            raise Refused(f"the emulator {PROGRAM} is not installed", f"apt-get install {PROGRAM}")
        pairs = [socket.socketpair() for _ in range(3)]
        self.link, self.plant, self._qmp = (ours for ours, _ in pairs)
        theirs = [end for _, end in pairs]
        command = [PROGRAM, "-M", MACHINE, "-display", "none", "-monitor", "none", "-kernel", str(elf), "-S"]
        for name, end in zip(("link", "plant", "qmp"), theirs, strict=True):
            command += ["-chardev", f"socket,id={name},fd={end.fileno()}"]
        command += ["-serial", "chardev:link", "-serial", "chardev:plant", "-mon", "chardev=qmp,mode=control"]
        if log is not None:
            command += ["-d", "unimp", "-D", str(log)]
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            pass_fds=[end.fileno() for end in theirs],
            preexec_fn=_like_a_chip,
            start_new_session=True,  # Ctrl-C in the terminal is for the executive
        )
        for end in theirs:
            end.close()
        self._qmp.settimeout(ANSWER_S)
        self._answers = self._qmp.makefile("rb")
        try:
            self._answer()  # the greeting
            self._command("qmp_capabilities")
            self._command("cont")
        except BaseException:
            self.close()
            raise
        for port in (self.link, self.plant):
            port.setblocking(False)

    def __enter__(self) -> Qemu:
        """Itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End it."""
        self.close()

    @property
    def pid(self) -> int:
        """Of its process."""
        return self._process.pid

    def reset(self) -> None:
        """What the reset pin does; RAM keeps its content."""
        self._command("system_reset")

    def stop(self) -> None:
        """Freeze the processor and its clocks."""
        self._command("stop")

    def go_on(self) -> None:
        """Undo `stop`."""
        self._command("cont")

    def monitor(self, line: str) -> None:
        """Give the emulator's own console a command, such as "gdbserver ..."."""
        self._command("human-monitor-command", {"command-line": line})

    def close(self) -> None:
        """End the machine; a second call does nothing."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(timeout=END_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._answers.close()
        for port in (self.link, self.plant, self._qmp):
            port.close()
        if self._process.stderr is not None:
            self._process.stderr.close()

    def _command(self, name: str, arguments: Mapping[str, str] | None = None) -> None:
        with contextlib.suppress(BrokenPipeError):  # `_answer` says why it is gone
            self._qmp.sendall(json.dumps({"execute": name, "arguments": dict(arguments or {})}).encode())
        while "return" not in (answer := self._answer()):
            if "error" in answer:
                raise LinkError(f"the emulator refused {name}: {answer['error'].get('desc')}")

    def _answer(self) -> dict[str, Any]:
        """One line of QMP: an answer or an event."""
        try:
            line = self._answers.readline()
        except TimeoutError:
            raise LinkError(f"the emulator did not answer within {ANSWER_S:.0f} s") from None
        if not line:
            said = self._process.stderr.read().decode().strip() if self._process.stderr else ""
            raise LinkError(f"the emulator ended: {said or 'without a word'}")
        answer: dict[str, Any] = json.loads(line)
        return answer
