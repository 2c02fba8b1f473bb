"""Pieces of work in processes of this machine, single threaded each; in this process where one is asked."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from typing import TypeVar

from labr_autonomy.errors import LabrError
from labr_autonomy.processes import die_with_parent, lean_children

J = TypeVar("J")
A = TypeVar("A")


def carried_out(work: Callable[[J], A], jobs: Sequence[J], processes: int) -> Iterator[A]:
    """Answers as they come.

    Args:
        work: What to do with a job; importable by name.
        jobs: All of them.
        processes: How many at once; 1 does without any other process.

    Raises:
        LabrError: when a process dies. Whatever the work raises comes through as it is.
    """
    if processes == 1 or len(jobs) < 2:
        yield from map(work, jobs)
        return
    spawn = get_context("spawn")
    count = min(processes, len(jobs))
    pool = ProcessPoolExecutor(count, mp_context=spawn, initializer=_begin, initargs=(os.getpid(),))
    waiting: set[Future[A]] = set()
    try:
        with lean_children():
            waiting = {pool.submit(work, job) for job in jobs}
        while waiting:
            done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for future in done:
                yield future.result()
    except BrokenProcessPool:
        raise LabrError(
            "a worker process died", "Run the same command again, with fewer --jobs if memory ran out."
        ) from None
    finally:
        pool.shutdown(wait=not waiting, cancel_futures=True)


def _begin(parent_pid: int) -> None:
    """A worker's first words."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends it at once: files appear whole or not at all
    die_with_parent(parent_pid=parent_pid)
