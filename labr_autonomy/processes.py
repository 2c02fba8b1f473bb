"""What a process asks of the kernel: to end with its parent, and to be woken on time."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

PR_SET_PDEATHSIG = 1  # prctl(2)
REALTIME_PRIORITY = 5  # above every ordinary process, below the kernel's own threads


# One thread each, because several such processes share the cores; and a heap that keeps what it was given:
# arrays of a few hundred kilobytes come and go in every cycle, and mapping them anew costs a sixth of it.
LEAN = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "OPENCV_FOR_THREADS_NUM": "1",
    "MALLOC_MMAP_THRESHOLD_": str(1 << 28),  # mallopt(3), glibc; elsewhere nobody reads it
    "MALLOC_TRIM_THRESHOLD_": str(1 << 29),
}


@contextlib.contextmanager
def lean_children() -> Iterator[None]:
    """Processes started within get `LEAN` in their environment, over what they would have had."""
    before = {name: os.environ.get(name) for name in LEAN}
    os.environ.update(LEAN)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def die_with_parent(signal_number: int = signal.SIGKILL, *, parent_pid: int | None = None) -> None:
    """Ask the kernel to end this process when the thread that started it ends (prctl(2)); Linux only.

    Args:
        signal_number: What ends it.
        parent_pid: The starter's process id, to notice that it died before this call; by default whoever is
            the parent now.
    """
    if not sys.platform.startswith("linux"):
        return
    parent = os.getppid() if parent_pid is None else parent_pid
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(PR_SET_PDEATHSIG, signal_number, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_PDEATHSIG) failed")
    if os.getppid() != parent:
        raise SystemExit(0)


@contextlib.contextmanager
def on_time() -> Iterator[bool]:
    """Let the calling thread be scheduled before ordinary ones (SCHED_RR), where that is permitted.

    It takes root, CAP_SYS_NICE or an rtprio limit (limits.conf(5)); without it everything works as well, and
    yields to other load. Threads and processes that are started within do not inherit it.

    Yields:
        Whether it was granted.
    """
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(REALTIME_PRIORITY))
    except PermissionError:
        yield False
        return
    try:
        yield True
    finally:
        os.sched_setscheduler(0, *before)


def keep_cores() -> int:
    """Let the other threads of this process be scheduled before ordinary ones as well, where permitted.

    The set-points wait for whichever of them holds the interpreter's lock, or one of MAVSDK's, so none may
    lose its core to other load in the middle. They yield to `on_time`; Linux only.

    Returns:
        How many threads it was granted for.
    """
    beneath = os.sched_param(REALTIME_PRIORITY - 1)
    granted = 0
    for task in Path("/proc/self/task").glob("[0-9]*"):
        number = int(task.name)
        if number == threading.get_native_id():
            continue
        with contextlib.suppress(PermissionError, ProcessLookupError):
            os.sched_setscheduler(number, os.SCHED_RR | os.SCHED_RESET_ON_FORK, beneath)
            granted += 1
    return granted
