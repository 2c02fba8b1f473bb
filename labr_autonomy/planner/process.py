"""The planner as a process of its own: one request in flight, the newest wins; it dies with its parent."""

from __future__ import annotations

import asyncio
import importlib.metadata
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path

from labr_autonomy.clock import SystemClock
from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import LabrError, LinkError
from labr_autonomy.planner.messages import PlanRequest, PlanResult, Ready
from labr_autonomy.processes import die_with_parent, lean_children

POLL_S = 0.5
LOAD_TIMEOUT_S = 180.0  # the first start compiles the map's kernels
END_S = 2.0
NICE = 5  # planning yields to the 50 Hz set-points


def _serve(connection: Connection, config: RobotConfig, depth_name: str, log_path: Path) -> None:
    """Body of the planner process."""
    die_with_parent()
    with log_path.open("ab") as log_file:  # what a fault leaves behind is for the file, not for the operator
        os.dup2(log_file.fileno(), sys.stderr.fileno())
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the executive's business
    os.nice(NICE)
    clock = SystemClock()
    began_s = clock.now_s()
    try:
        from labr_autonomy.perception.frame_slot import FrameReader
        from labr_autonomy.planner.pipeline import Pipeline
        from labr_autonomy.planner.recorder import PlannerLog

        pipeline = Pipeline(config)
        frames = FrameReader(depth_name, timeout_s=30.0)
    except LabrError as error:
        connection.send(error.args[0])
        return
    names = ("casadi", "onnxruntime", "numpy", "numba", "opencv-python-headless")
    connection.send(Ready({n: importlib.metadata.version(n) for n in names}, clock.now_s() - began_s))
    recorder = PlannerLog(_fresh(log_path.with_suffix(".mcap")), config)
    try:
        while True:
            if not connection.poll(POLL_S):
                continue
            request: PlanRequest = connection.recv()
            while connection.poll():  # the newest request is the only one that matters
                request = connection.recv()
            frame = frames.get(request.frame_sequence)
            result = pipeline.cycle(request, frame)
            connection.send(result)
            recorder.cycle(request, frame, result)  # after the answer: nobody waits for the disk
    except (EOFError, BrokenPipeError, ConnectionResetError):  # the executive has ended
        recorder.close()


def _fresh(path: Path) -> Path:
    """A name that is free: `planner.mcap`, and `planner-2.mcap` for the one that replaces a dead planner."""
    number = 1
    found = path
    while found.exists():
        number += 1
        found = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return found


class PlannerLink:
    """The executive's end: sends requests, calls back with results, notices death.

    Args:
        config: The robot.
        depth_name: Frame slot to read.
        log_path: Where its standard error goes.
    """

    def __init__(self, config: RobotConfig, depth_name: str, log_path: Path) -> None:
        self._config = config
        self._log_path = log_path
        self._depth_name = depth_name
        self._process: multiprocessing.process.BaseProcess | None = None
        self._connection: Connection | None = None
        self.on_result: Callable[[PlanResult], None] = lambda result: None
        self.busy = False
        self.restarts = 0

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process is not None and self._process.is_alive()

    @property
    def pid(self) -> int | None:
        """Process id."""
        return self._process.pid if self._process is not None else None

    def start(self) -> None:
        """Spawn the process; it loads in the background."""
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        self._process = context.Process(
            target=_serve,
            args=(theirs, self._config, self._depth_name, self._log_path),
            name="labr-planner",
            daemon=True,
        )
        with lean_children():
            self._process.start()
        theirs.close()
        self._connection = ours
        self.busy = True

    async def wait_ready(self, timeout_s: float = LOAD_TIMEOUT_S) -> Ready:
        """Wait until the planner has loaded.

        Raises:
            LinkError: when it does not, with its own reason.
        """
        assert self._connection is not None, "start() comes first"
        arrived = asyncio.Event()
        loop = asyncio.get_running_loop()
        loop.add_reader(self._connection.fileno(), arrived.set)
        try:
            async with asyncio.timeout(timeout_s):
                await arrived.wait()
            first = self._connection.recv()
        except TimeoutError:
            raise LinkError(
                f"the planner did not load within {timeout_s:.0f} s", "Try again on an idle machine"
            ) from None
        except (EOFError, ConnectionResetError):
            code = self._process.exitcode if self._process else None
            raise LinkError(
                f"the planner process ended while loading (exit code {code})",
                f"Its reason is in {self._log_path}",
            ) from None
        finally:
            loop.remove_reader(self._connection.fileno())
        if not isinstance(first, Ready):
            raise LinkError(str(first).rstrip("."))
        loop.add_reader(self._connection.fileno(), self._readable)
        self.busy = False
        return first

    def _readable(self) -> None:
        assert self._connection is not None
        try:
            while self._connection.poll():
                result = self._connection.recv()
                self.busy = False
                self.on_result(result)
        except (EOFError, OSError):  # also in the middle of a message
            self._drop()

    def send(self, request: PlanRequest) -> bool:
        """Hand over a request unless one is in work; True when it went."""
        if self.busy or self._connection is None or not self.alive:
            return False
        try:
            self._connection.send(request)
        except (BrokenPipeError, ConnectionResetError):
            self._drop()
            return False
        self.busy = True
        return True

    def _drop(self) -> None:
        if self._connection is not None:
            asyncio.get_running_loop().remove_reader(self._connection.fileno())
            self._connection.close()
            self._connection = None

    async def restart(self) -> None:
        """Replace a dead process."""
        self.restarts += 1
        self._drop()
        self.start()
        await self.wait_ready()

    def close(self) -> None:
        """Let go of its pipe, on which it closes its log and ends; make sure that it does."""
        self._drop()
        if self._process is not None:
            self._process.join(timeout=END_S)
            if self._process.is_alive():
                self._process.kill()
                self._process.join(timeout=END_S)
            self._process = None
