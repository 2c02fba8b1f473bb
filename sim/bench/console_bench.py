"""What the operator's console costs the flight, and how fresh a page is: measured in one simulated flight.

The mission waits for start, with set-points at 50 Hz, planning and logs as in motion, while more or fewer
tabs of a headless Chromium look at it, in turns. Then one tab is stopped by a signal, as a tablet that has
gone to sleep would be, and memory is watched.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from labr_autonomy.clock import SystemClock, pause_s
from labr_autonomy.errors import LinkError, Refused
from labr_autonomy.record.mcap_reader import read_log
from labr_autonomy.types import Array

MISSION = """\
version: 1
name: console bench
items: [{goto: {x: 4, y: 0}}]
limits: {duration_s: 3600}
fence: [{polygon: [[-7, -5], [7, -5], [7, 5], [-7, 5]], keep: in}]
sim: {world: {family: hall, size_m: [14, 10]}, seed: 1, start: {x: -5, y: 0}}
"""
TABS = (0, 1, 3)
ROUNDS = 2
SETTLE_S = 2.0  # after tabs were opened or closed
READY_S = 180.0
PAINTS = 3
FLAGS = ("--no-sandbox", "--enable-unsafe-swiftshader")  # WebGL without a graphics card

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Stretch:
    """A stretch of time with so many tabs open."""

    tabs: int
    begin_s: float
    end_s: float


def find_chromium() -> str:
    """Path of a Chromium.

    Raises:
        Refused: when there is none.
    """
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None:
        raise Refused(
            "this benchmark looks at the page with Chromium, which is not installed", "apt install chromium"
        )
    return found


def measure(folder: Path, stretch_s: float, stalled_s: float, say: Say) -> dict[str, Any]:
    """The whole benchmark.

    Args:
        folder: Where the flight's run folder is made.
        stretch_s: Length of each stretch; there are two with 0, 1 and 3 tabs each.
        stalled_s: How long a stopped tab is watched.
        say: Told how far it is.

    Returns:
        `rows` by number of tabs, `first_paint_ms`, `first_state_ms`, `stalled`.
    """
    from playwright.sync_api import sync_playwright

    chromium, clock = find_chromium(), SystemClock()
    stretches: list[Stretch] = []
    ages: dict[int, list[float]] = {tabs: [] for tabs in TABS}
    with _flight(folder, say) as (process, url, console_pid), sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=list(FLAGS))
        paints = [_first_paint(browser, url) for _ in range(PAINTS)]
        for tabs in TABS * ROUNDS:
            pages = [_open(browser, url) for _ in range(tabs)]
            pause_s(SETTLE_S)
            begin_s = clock.now_s()
            for page in pages:
                page.evaluate("labr.timings.length = 0")
            pause_s(stretch_s)
            stretches.append(Stretch(tabs, begin_s, clock.now_s()))
            for page in pages:
                ages[tabs] += page.evaluate("labr.timings")
                page.context.close()
            say(f"{tabs} tabs: {stretch_s:.0f} s")
        stalled = _stall(browser, url, process.pid, console_pid, stalled_s)
        say(f"one stopped tab: {stalled_s:.0f} s")
        browser.close()
    run = next(path for path in folder.iterdir() if (path / "latencies.npz").is_file())
    ticks = _ticks(run)
    return {
        "rows": [_row(tabs, stretches, ticks, ages[tabs]) for tabs in TABS],
        "first_paint_ms": round(float(np.median([p for p, _ in paints])), 0),
        "first_state_ms": round(float(np.median([s for _, s in paints])), 0),
        "stalled": stalled,
    }


@contextlib.contextmanager
def _flight(folder: Path, say: Say) -> Iterator[tuple[subprocess.Popen[bytes], str, int]]:
    mission, log = folder / "mission.yaml", folder / "fly.log"
    mission.write_text(MISSION)
    with log.open("wb") as stream:
        command = [sys.executable, "-m", "labr_autonomy", "fly", str(mission), "--out", str(folder)]
        process = subprocess.Popen(
            [*command, "--console", "--port", "0"], stdout=stream, stderr=subprocess.STDOUT
        )
    try:
        clock = SystemClock()
        deadline_s = clock.now_s() + READY_S
        while "waiting for start" not in log.read_text():
            if process.poll() is not None or clock.now_s() > deadline_s:
                raise LinkError("the flight to be measured did not begin", f"Its reason is in {log}")
            pause_s(0.2)
        found = re.search(r"with control: (\S+)", log.read_text())
        assert found is not None, "the flight waits for start, so it has said where"
        say("the flight waits for start")
        yield process, found[1], _child(process.pid, b"labr_autonomy.console.server")
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(timeout=60.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _open(browser: Any, url: str) -> Any:
    page = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
    page.goto(url)
    page.wait_for_selector(".cockpit.is-live", timeout=60_000)
    return page


def _first_paint(browser: Any, url: str) -> tuple[float, float]:
    """First contentful paint, and the first state on the page, both from the beginning of the load [ms]."""
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    page = context.new_page()
    page.goto(url)
    page.wait_for_selector(".cockpit.is-live", timeout=60_000)
    state_ms = page.evaluate("performance.now()")
    paint_ms = page.evaluate(
        "performance.getEntriesByType('paint').find(e => e.name === 'first-contentful-paint').startTime"
    )
    context.close()
    return float(paint_ms), float(state_ms)


def _stall(browser: Any, url: str, flight_pid: int, console_pid: int, stalled_s: float) -> dict[str, Any]:
    """Memory of executive and console while all of Chromium is stopped."""
    page = _open(browser, url)
    pause_s(SETTLE_S)
    chromium = _browser_processes()
    before = _resident_mb(flight_pid), _resident_mb(console_pid)
    for pid in chromium:
        os.kill(pid, signal.SIGSTOP)
    try:
        pause_s(stalled_s)
        after = _resident_mb(flight_pid), _resident_mb(console_pid)
    finally:
        for pid in chromium:
            os.kill(pid, signal.SIGCONT)
    page.context.close()
    return {
        "seconds": stalled_s,
        "executive_growth_mb": round(after[0] - before[0], 2),
        "console_growth_mb": round(after[1] - before[1], 2),
    }


def _row(tabs: int, stretches: list[Stretch], ticks: Array, ages: list[float]) -> dict[str, Any]:
    inside = np.zeros(len(ticks), dtype=bool)
    for stretch in stretches:
        if stretch.tabs == tabs:
            inside |= (ticks[:, 0] >= stretch.begin_s) & (ticks[:, 0] < stretch.end_s)
    late_ms = ticks[inside, 1] * 1e3
    p50, p99 = np.percentile(late_ms, [50, 99])
    row = {
        "tabs": tabs,
        "ticks": len(late_ms),
        "tick_late_p50_ms": round(float(p50), 2),
        "tick_late_p99_ms": round(float(p99), 2),
        "tick_late_max_ms": round(float(late_ms.max()), 2),
    }
    if ages:
        row |= {f"state_age_p{q}_ms": round(float(np.percentile(ages, q)) * 1e3, 0) for q in (50, 95)}
    return row


def _ticks(run: Path) -> Array:
    """When each tick was, and how late (n, 2) [s]."""
    at_s = [
        message["now_s"]
        for topic, message in read_log(run / "flight.mcap")
        if topic == "/pilot" and message["call"] == "tick"
    ]
    with np.load(run / "latencies.npz") as file:
        late_s = file["tick_late_s"]
    count = min(len(at_s), len(late_s))
    return np.column_stack([at_s[:count], late_s[:count]]).astype(np.float64)


def _browser_processes() -> list[int]:
    """The Chromium that this process started, and its children."""
    parents = {pid: parent for pid, parent, _ in _processes()}

    def ours(pid: int) -> bool:
        while pid in parents and pid != os.getpid():
            pid = parents[pid]
        return pid == os.getpid()

    return [
        pid
        for pid, _, command in _processes()
        if b"--user-data-dir" in command or b"--type=" in command
        if ours(pid)
    ]


def _child(parent: int, word: bytes) -> int:
    found = [pid for pid, its_parent, command in _processes() if its_parent == parent and word in command]
    if not found:
        raise LinkError("the console's process is not there", "Look at console.log of the run")
    return found[0]


def _processes() -> list[tuple[int, int, bytes]]:
    """Process id, parent and command line of all."""
    rows = []
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError, IndexError, ValueError):
            fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
            rows.append((int(entry.name), int(fields[1]), (entry / "cmdline").read_bytes()))
    return rows


def _resident_mb(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
