"""The lock-step runner held against the full simulator: the same trials over MAVLink, serial and frames."""

from __future__ import annotations

import json
import math
import statistics
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput
from sim.lockstep.run import fly_trial
from sim.lockstep.trial import Task, Trial

AGREE = 0.10  # median relative difference that still counts as the same
SLACK_S = 120.0  # for loading, on top of the trial's own limit


@dataclass(frozen=True, slots=True)
class Pair:
    """One trial both ways; truth of the simulator up to the moment the goal counted as reached."""

    family: str
    seed: int
    in_air: bool
    outcome: tuple[str, str]  # lock-step, full simulator
    path_m: tuple[float, float]
    time_s: tuple[float, float]
    energy_j: tuple[float, float]


def mission_of(task: Task, name: str) -> dict[str, Any]:
    """The trial as a mission file: one goal, in the world as its seed draws it.

    Raises:
        BadInput: for a world that a mission cannot name.
    """
    world = task.world
    if "family" not in world:
        raise BadInput(f"the world of trial {task.seed} is a mesh", "Cross-check a generated family.")
    x, y, z = task.goal_m
    _, _, yaw, floor_m = task.start
    goal: dict[str, float] = {"x": x, "y": y}
    if task.in_air:
        goal["z"] = z - floor_m
    drawn = {k: world[k] for k in ("family", "size_m", "difficulty") if k in world}
    return {
        "version": 1,
        "name": name,
        "items": [{"goto": goal, "timeout_s": math.ceil(task.limit_s)}],
        "sim": {
            "world": {**drawn, "clear": False},
            "seed": task.seed,
            "start": {"x": task.start[0], "y": task.start[1], "z": floor_m, "yaw_deg": math.degrees(yaw)},
        },
    }


def fly_full(task: Task, folder: Path) -> tuple[str, float, float, float]:
    """Fly a trial in the full simulator in real time; outcome, metres, seconds and joules."""
    folder.mkdir(parents=True, exist_ok=True)
    mission = folder / f"trial-{task.seed}.yaml"
    mission.write_text(json.dumps(mission_of(task, f"trial {task.seed}")))  # JSON is YAML
    command = [sys.executable, "-m", "labr_autonomy", "fly", str(mission), "--out", str(folder)]
    command += ["--quiet", "--json"]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=task.limit_s + SLACK_S,
        check=False,
    )
    try:
        summary = json.loads(done.stdout.strip().splitlines()[-1])
    except (IndexError, ValueError):
        return f"refused: {done.stderr.strip()[-200:]}", math.nan, math.nan, math.nan
    if "error" in summary:
        return f"refused: {summary['error']['what']}", math.nan, math.nan, math.nan
    return _until_goal(summary, _newest(folder))


def _newest(folder: Path) -> Path:
    return max((p for p in folder.iterdir() if (p / "truth.npz").is_file()), key=lambda p: p.stat().st_mtime)


def _until_goal(summary: Mapping[str, Any], run: Path) -> tuple[str, float, float, float]:
    """Truth between the start of the mission and the end of its one leg."""
    leg, end_s = summary["legs"][0], summary["leg_ends_mono_s"][0]
    with np.load(run / "truth.npz") as truth:
        stamps, places, used_j = truth["stamp_s"], truth["position_m"], truth["used_j"]
    start_s = end_s - leg["duration_s"]
    inside = (stamps >= start_s) & (stamps <= end_s)
    way_m = float(np.linalg.norm(np.diff(places[inside], axis=0), axis=1).sum())
    spent_j = float(used_j[inside][-1] - used_j[inside][0])
    reached = "reached" if leg["outcome"] == "done" and not summary["contacts"] else summary["reason"]
    return reached, way_m, float(leg["duration_s"]), spent_j


def cross_check(tasks: Iterable[Task], robot: RobotConfig, folder: Path) -> Iterator[Pair]:
    """Fly tasks both ways, one after the other (the full simulator needs the machine for itself).

    A task that is not reached in lock-step is passed over: two failures have no path, time or joules in
    common.
    """
    for task in tasks:
        fast = fly_trial(Trial(task, "two-stage"), robot)
        if fast.outcome != "reached":
            continue
        outcome, way_m, time_s, spent_j = fly_full(task, folder)
        yield Pair(
            str(task.world.get("family", task.world.get("name"))),
            task.seed,
            task.in_air,
            (fast.outcome, outcome),
            (fast.land_m + fast.air_m, way_m),
            (fast.time_s, time_s),
            (fast.energy_j, spent_j),
        )


def agreement(pairs: Iterable[Pair]) -> dict[str, Any]:
    """What the trials that were reached both ways have in common, and whether it is the same.

    A single different turn at a junction doubles a path, so the two are compared trial by trial: they agree
    when the median difference of path, time and joules is at most `AGREE`. The means are given as well.
    """
    both = [p for p in pairs if p.outcome == ("reached", "reached")]
    out: dict[str, Any] = {"trials_reached_both_ways": len(both)}
    for name in ("path_m", "time_s", "energy_j"):
        fast, full = (_mean([getattr(p, name)[i] for p in both]) for i in (0, 1))
        shares = sorted(abs(a / b - 1.0) for a, b in (getattr(p, name) for p in both))
        out[name] = {
            "lockstep": fast,
            "full": full,
            "difference_of_means": abs(fast / full - 1.0) if both else math.nan,
            "median_difference": statistics.median(shares) if both else math.nan,
            "worst_difference": shares[-1] if both else math.nan,
        }
    out["agrees"] = bool(both) and all(
        out[name]["median_difference"] <= AGREE for name in ("path_m", "time_s", "energy_j")
    )
    return out


def _mean(values: list[float]) -> float:
    return sum(values) / len(values) if values else math.nan
