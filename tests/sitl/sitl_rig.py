"""Runs the real command line against the real simulator and watches the true pose."""

import contextlib
import json
import os
import select
import signal
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np

from sim.pose_slot import PoseSlotReader

LABR = [sys.executable, "-m", "labr_autonomy"]

MISSION = """\
version: 1
name: sitl
items:
{items}
limits: {{height_max_m: 2.2, duration_s: 120}}
fence:
  - polygon: [[-7, -5], [7, -5], [7, 5], [-7, 5]]
    keep: in
sim:
  world: {{family: hall, size_m: [14, 10]}}
  seed: 3
  start: {{x: -4.0, y: 0.0, yaw_deg: 0}}
"""


def write_mission(folder: Path, *items: str) -> Path:
    path = folder / "mission.yaml"
    path.write_text(MISSION.format(items="\n".join(f"  - {item}" for item in items)))
    return path


@contextlib.contextmanager
def simulator(mission: Path, folder: Path):
    """`labr-mission sim` in a process of its own; yields (robot.yaml, reader of the true pose)."""
    process = subprocess.Popen(
        [*LABR, "sim", str(mission), "--out", str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert select.select([process.stdout], [], [], 60.0)[0], "the simulator said nothing for 60 s"
        ready = json.loads(process.stdout.readline())
        assert ready["event"] == "ready", ready
        reader = PoseSlotReader(f"labr_{process.pid}_pose")
        yield Path(ready["robot"]), reader
        reader.close()
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(timeout=15)
        process.stdout.close()
        process.stderr.close()


def start_flight(mission: Path, folder: Path, *arguments: str, **options) -> subprocess.Popen:
    log = (folder / "fly.log").open("w")
    with log:
        return subprocess.Popen(
            [*LABR, "fly", str(mission), "--out", str(folder), *arguments],
            stdout=log,
            stderr=subprocess.STDOUT,
            **options,
        )


class Truth:
    """Watches the true pose at about 200 Hz."""

    def __init__(self, reader: PoseSlotReader) -> None:
        self._reader = reader
        self._seen: list[tuple[float, np.ndarray]] = []

    def look(self) -> tuple[float, np.ndarray]:
        deadline = time.monotonic() + 10.0
        while (found := self._reader.latest()) is None:  # the slot is there before its first pose
            assert time.monotonic() < deadline, "the simulator published no pose"
            time.sleep(0.005)
        stamp, pose = found
        if not self._seen or stamp > self._seen[-1][0]:
            self._seen.append((stamp, pose.position_m.copy()))
        return self._seen[-1]

    def speed_mps(self, window_s: float = 0.06) -> float:
        """Speed over the last moments."""
        stamp, here = self._seen[-1]
        for then, there in reversed(self._seen):
            if stamp - then >= window_s:
                return float(np.linalg.norm(here - there)) / (stamp - then)
        return 0.0

    def gap_s(self, since_s: float) -> float:
        """Longest time without a new pose: how long the machine did not run the simulator or this test."""
        stamps = [s for s, _ in self._seen if s >= since_s]
        return max((b - a for a, b in pairwise(stamps)), default=0.0)

    def wait(self, condition, timeout_s: float, what: str) -> float:
        """Look until `condition(self)` holds; returns the stamp at which it did."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            stamp, _ = self.look()
            if condition(self):
                return stamp
            time.sleep(0.005)
        raise AssertionError(f"{what} did not happen within {timeout_s:.0f} s")

    @property
    def height_m(self) -> float:
        """Height of the body above its place on the wheels."""
        return float(self._seen[-1][1][2]) - 0.12


def leftovers() -> list[str]:
    """Shared memory of this project that nobody has removed."""
    return sorted(p.name for p in Path("/dev/shm").glob("labr_*"))


def family(pid: int) -> list[int]:
    """Processes whose parent, or parent's parent, is `pid`."""
    parents = {}
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError, IndexError, ValueError):
            fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
            if fields[0] != "Z":
                parents[int(entry.name)] = int(fields[1])
    children = [p for p, parent in parents.items() if parent == pid]
    return children + [p for p, parent in parents.items() if parent in children]


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return "Z" not in Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
