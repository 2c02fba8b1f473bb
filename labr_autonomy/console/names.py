"""Names of the shared memory through which a flight and its console know each other."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path

STATE_MAX = 48 * 1024  # bytes of one snapshot; usual ones take 6 kB
STATE_SLOTS = 4
REQUEST_MAX = 1024
REQUEST_SLOTS = 32  # requests that may arrive within one tick

_FOLDER = Path("/dev/shm")
_STATE = re.compile(r"labr_(\d+)_console")


def state_slot(pid: int) -> str:
    """Where the executive with this process id shows its state."""
    return f"labr_{pid}_console"


def map_slot(pid: int) -> str:
    """Where it shows its map and the trail."""
    return f"labr_{pid}_map"


def request_slot(pid: int) -> str:
    """Where its console asks."""
    return f"labr_{pid}_asked"


def running() -> list[int]:
    """Process ids of the executives on this machine that can be watched, the newest first."""
    found = []
    for file in _FOLDER.glob("labr_*_console"):
        match = _STATE.fullmatch(file.name)
        if match and Path(f"/proc/{match[1]}").exists():
            with contextlib.suppress(FileNotFoundError):  # it ends just now
                found.append((file.stat().st_mtime, int(match[1])))
    return [pid for _, pid in sorted(found, reverse=True)]
