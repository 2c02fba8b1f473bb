"""Starts the console as a process of its own, and learns where its page is. Imports nothing heavy."""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labr_autonomy.errors import BadInput, LinkError, Refused

END_S = 5.0
LOCAL = "127.0.0.1"
PORT = 8460

log = logging.getLogger("labr.console")


@dataclass(frozen=True, slots=True)
class ConsoleOptions:
    """Where the page is served."""

    host: str = LOCAL
    port: int = PORT  # 0: any free one
    token_file: Path | None = None


class ConsoleProcess:
    """A running console; use as a context manager.

    Args:
        options: Where it is served.
        pid: The executive to watch, or
        run: the folder of a run to replay.
        log_path: Where its standard error goes.
    """

    def __init__(
        self, options: ConsoleOptions, *, pid: int | None = None, run: Path | None = None, log_path: Path
    ) -> None:
        self._options = options
        self._spec: dict[str, Any] = {
            "host": options.host,
            "port": options.port,
            "token_file": None if options.token_file is None else str(options.token_file),
            "parent": os.getpid(),
            **({"pid": pid} if run is None else {"run": str(run)}),
        }
        self._log_path = log_path
        self._process: subprocess.Popen[str] | None = None
        self.urls: tuple[str, str] = ("", "")  # for operators, for viewers

    @property
    def sentences(self) -> list[str]:
        """What the person at the terminal must know."""
        said = [f"console, with control: {self.urls[0]}", f"console, watching only: {self.urls[1]}"]
        if self._options.host not in (LOCAL, "::1"):
            said.append(
                f"WARNING: {self._options.host} can be reached over the network, and the page is not "
                "encrypted: whoever reads along can take control. Use a network of your own, or an SSH tunnel"
            )
        return said

    def __enter__(self) -> ConsoleProcess:
        """Start it and wait until it listens.

        Raises:
            BadInput, Refused: with the console's own sentence.
            LinkError: when it ends without a word.
        """
        scratch = tempfile.gettempdir()
        with self._log_path.open("ab") as errors:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "labr_autonomy.console.server"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                env={
                    **os.environ,
                    "NICEGUI_STORAGE_PATH": str(Path(scratch) / f"labr-console-{os.getpid()}"),
                },
            )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(
                json.dumps(self._spec) + "\n"
            )  # not on the command line, which all can see
            self._process.stdin.close()
        except BrokenPipeError:
            log.warning("the console ended while it was told what to serve")
        try:
            answer = json.loads(self._process.stdout.readline())
        except ValueError:
            self.close()
            raise LinkError(
                f"the console ended before it was ready: {self._last_words()}",
                "Run labr-mission doctor, and report this sentence if it finds nothing",
            ) from None
        if answer["event"] != "ready":
            self.close()
            kind = BadInput if answer["exit_code"] == BadInput.exit_code else Refused
            raise kind(answer["what"], answer["do"])
        self.urls = (answer["urls"][0], answer["urls"][1])
        return self

    def __exit__(self, *_: object) -> None:
        """End it."""
        self.close()

    def wait(self) -> None:
        """Until it ends by itself.

        Raises:
            LinkError: when it has failed.
        """
        if self._process is not None and self._process.wait() != 0:
            raise LinkError(
                f"the console has ended: {self._last_words()}", "Start it anew; a flight goes on without it"
            )

    def _last_words(self) -> str:
        """The last line of its log, which may be gone when somebody wants to look."""
        lines = self._log_path.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return lines[-1].strip() if lines else "without a word"

    @property
    def pid(self) -> int | None:
        """Process id."""
        return None if self._process is None else self._process.pid

    def close(self) -> None:
        """Ask it to end, and make sure that it does."""
        process, self._process = self._process, None
        if process is None:
            return
        process.terminate()
        try:
            process.wait(timeout=END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if process.stdout is not None:
            process.stdout.close()
