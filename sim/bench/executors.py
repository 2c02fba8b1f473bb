"""Where flights are computed: in processes of this machine, or on a Ray cluster (`sim.bench.cluster`).

Each process has one pipe and one job at a time, so that a process that dies takes exactly one flight with
it, and it is known which. (A pool of concurrent.futures fails every waiting job when one worker dies.)
"""

from __future__ import annotations

import contextlib
import faulthandler
import multiprocessing
import os
import signal
import traceback
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Protocol

from labr_autonomy.errors import LabrError
from labr_autonomy.processes import die_with_parent, lean_children
from sim.bench.jobs import Answer, Job, Work

WALL_MAX_S = 3600.0  # of one flight; a worker that hangs longer ends itself and leaves its stack in the log


@dataclass(frozen=True, slots=True)
class Finished:
    """A job that has ended, one way or the other."""

    job: Job
    answer: Answer | None
    error: str = ""  # a sentence, when there is no answer
    details: str = ""  # its traceback


class Executor(Protocol):
    """Takes jobs, gives back what has finished, in any order."""

    @property
    def free(self) -> int:
        """How many jobs it takes at once now."""
        ...

    @property
    def busy(self) -> int:
        """How many jobs it works on."""
        ...

    def submit(self, job: Job) -> None:
        """Begin a job; only while one is `free`."""
        ...

    def next_finished(self) -> Finished:
        """Wait for the next job to end; only while one is `busy`."""
        ...

    def close(self) -> None:
        """End whatever still runs."""
        ...


def failure(job: Job, error: Exception) -> Finished:
    """A job that raised, as a sentence; call it while the error is being handled."""
    lines = str(error).strip().splitlines() or ["no message"]
    sentence = str(error) if isinstance(error, LabrError) else f"{type(error).__name__}: {lines[0]}"
    return Finished(job, None, sentence, traceback.format_exc())


def attempt(work: Work, job: Job) -> Finished:
    """Do a job; a fault of the program in it is a finding of the benchmark, not its end."""
    try:
        return Finished(job, work(job))
    except Exception as error:  # noqa: BLE001 - recorded with its traceback, and the command ends with 1
        return failure(job, error)


class ProcessExecutor:
    """Processes of this machine.

    Args:
        work: What to do with a job; importable by name.
        jobs: How many at once.
        log_path: What the workers write to their standard streams; the last words of one that died.
    """

    def __init__(self, work: Work, jobs: int, log_path: Path) -> None:
        self._work = work
        self._log_path = log_path
        self._idle: list[_Lane] = []
        self._running: dict[Connection, tuple[_Lane, Job]] = {}
        self._jobs = jobs

    @property
    def free(self) -> int:
        """How many jobs it takes at once now."""
        return self._jobs - len(self._running)

    @property
    def busy(self) -> int:
        """How many jobs it works on."""
        return len(self._running)

    def submit(self, job: Job) -> None:
        """Begin a job."""
        lane = self._idle.pop() if self._idle else _Lane(self._work, self._log_path)
        self._running[lane.pipe] = (lane, job)
        with contextlib.suppress(BrokenPipeError):  # it died while idle: `next_finished` says so
            lane.pipe.send(job)

    def next_finished(self) -> Finished:
        """Wait for the next job to end."""
        pipe = wait(list(self._running))[0]
        assert isinstance(pipe, Connection)
        lane, job = self._running[pipe]
        try:
            finished: Finished = pipe.recv()
        except (EOFError, ConnectionResetError):
            finished = Finished(job, None, lane.last_words(), f"see {self._log_path.name}")
            lane.end()
        else:
            self._idle.append(lane)
        del self._running[pipe]
        return finished

    def close(self) -> None:
        """End every worker at once."""
        for lane in [*self._idle, *(lane for lane, _ in self._running.values())]:
            lane.end()
        self._idle.clear()
        self._running.clear()


class _Lane:
    """One worker process and its pipe."""

    def __init__(self, work: Work, log_path: Path) -> None:
        spawn = multiprocessing.get_context("spawn")
        self.pipe, theirs = spawn.Pipe()
        arguments = (theirs, work, os.getpid(), str(log_path))
        self._process = spawn.Process(target=_serve, args=arguments, daemon=True)
        with lean_children():
            self._process.start()
        theirs.close()  # so that the pipe ends with the worker

    def last_words(self) -> str:
        """How the worker ended, as a sentence."""
        self._process.join()
        code = self._process.exitcode or 0
        how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
        return f"the worker process died ({how})"

    def end(self) -> None:
        """End the worker at once."""
        self._process.kill()
        self._process.join()
        self.pipe.close()


def _serve(pipe: Connection, work: Work, parent_pid: int, log_path: str) -> None:
    """The worker's whole life."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to the whole terminal group; the parent acts
    die_with_parent(parent_pid=parent_pid)
    log = os.open(log_path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
    for stream in (1, 2):  # native libraries write to these, and stdout belongs to --json
        os.dup2(log, stream)
    faulthandler.enable(file=2)
    with contextlib.suppress(EOFError):  # the parent has closed the pipe
        while True:
            job = pipe.recv()
            faulthandler.dump_traceback_later(WALL_MAX_S, exit=True, file=2)
            finished = attempt(work, job)
            faulthandler.cancel_dump_traceback_later()
            pipe.send(finished)
