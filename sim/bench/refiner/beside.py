"""How long the planner process refines beside a flight in real time, from what the flight recorded."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from labr_autonomy.errors import BadInput, ExitCode, Refused
from labr_autonomy.record.mcap_reader import read_log
from sim.bench.links.rows import load_now

LOG = "flight.mcap"


def fly(mission: Path, folder: Path, *, quiet: bool) -> tuple[Path, dict[str, Any]]:
    """Fly a mission on the embedded simulator in real time.

    Args:
        mission: The mission's file.
        folder: Where its run folder goes.
        quiet: Without the flight's progress on stderr.

    Returns:
        Run folder, and the load: of the machine before and after (getloadavg(3), the last minute's mean), of
        which simulator, executive and planner of the flight itself are a part afterwards.

    Raises:
        BadInput, Refused: when the flight left no record; why is on stderr, in the flight's own words.
    """
    before = load_now()
    command = [sys.executable, "-m", "labr_autonomy", "fly", str(mission), "--out", str(folder)]
    command += ["--quiet"] if quiet else []
    done = subprocess.run(command, stdout=subprocess.DEVNULL, check=False)
    runs = [path.parent for path in folder.glob(f"*/{LOG}")]
    if not runs:
        refusal = BadInput if done.returncode == ExitCode.BAD_INPUT else Refused
        raise refusal(
            f"the flight of {mission} ended with {done.returncode} and left no record",
            f"Fly it by itself: labr-mission fly {mission}",
        )
    load = {"cores": os.cpu_count() or 1, "before": before, "after": load_now(), "fly_exit": done.returncode}
    return max(runs, key=lambda run: (run / LOG).stat().st_mtime), load


def rows(run: Path) -> list[dict[str, Any]]:
    """Percentiles of the refiner's wall time by mode; cycles that asked nothing of it are left out.

    Args:
        run: A run folder.

    Raises:
        BadInput: when the folder has no record of a flight, or one without plans.
    """
    if not (run / LOG).is_file():
        raise BadInput(f"{run} has no {LOG}", "Name a mission, or the folder of a run")
    took_ms: dict[str, list[float]] = {}
    for topic, plan in read_log(run / LOG):
        if topic == "/plan" and plan["followed"] is not None and "refine" in plan["timings_s"]:
            took_ms.setdefault(plan["mode"], []).append(1e3 * plan["timings_s"]["refine"])
    if not took_ms:
        raise BadInput(f"{run / LOG} holds no plan", "Name a flight that has got as far as planning")
    return [
        {
            "mode": mode,
            "plans": len(times),
            "time_ms": {
                name: round(float(np.percentile(times, share)), 2)
                for name, share in (("p50", 50), ("p99", 99), ("max", 100))
            },
        }
        for mode, times in sorted(took_ms.items(), reverse=True)  # land first
    ]
