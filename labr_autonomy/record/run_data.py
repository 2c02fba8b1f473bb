"""What the report draws, read from one run folder. A file that is missing leaves its part empty."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.errors import BadInput
from labr_autonomy.record.mcap_reader import read_log
from labr_autonomy.record.summary import read_summary
from labr_autonomy.types import Array

MODE_AIR = "air"
LATENCIES = ("tick_late_s", "plan_cycle_s", "setpoint_age_s")  # of latencies.npz, one value for each time


@dataclass(frozen=True, slots=True)
class Track:
    """A pose over time."""

    stamp_s: Array  # (n,)
    position_m: Array  # (n, 3) odom
    air: NDArray[np.bool_]  # (n,)

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.stamp_s)


@dataclass(slots=True)
class RunData:
    """Everything known of a run."""

    name: str
    summary: dict[str, Any]
    t0_s: float = 0.0  # stamp of the first message
    estimate: Track | None = None
    truth: Track | None = None
    plans: list[dict[str, Any]] = field(default_factory=list)
    depths: list[dict[str, Any]] = field(default_factory=list)
    events: list[dict[str, Any]] = field(default_factory=list)
    modes: list[dict[str, Any]] = field(default_factory=list)
    battery: list[dict[str, Any]] = field(default_factory=list)
    occupied_xy_m: Array | None = None  # (n, 2) odom
    latencies_s: dict[str, Array] = field(default_factory=dict)  # by the names in LATENCIES
    notes: list[str] = field(default_factory=list)  # what could not be read

    @property
    def track(self) -> Track | None:
        """The true track where it is known, else the estimate."""
        return self.truth if self.truth is not None else self.estimate


def read_run(run_dir: Path) -> RunData:
    """Read a run folder.

    Raises:
        BadInput: when it is no run folder: neither a summary nor a log.
    """
    log, figures = run_dir / "flight.mcap", run_dir / "summary.json"
    if not log.exists() and not figures.exists():
        raise BadInput(
            f"{run_dir} is no run folder: it has no flight.mcap and no summary.json", "Name another folder"
        )
    data = RunData(run_dir.resolve().name, {})
    try:
        data.summary = read_summary(run_dir)
    except BadInput as error:
        data.notes.append(error.what.replace(f"{run_dir}/", ""))
    if log.exists():
        try:
            _read_messages(data, log)
        except BadInput as error:
            data.notes.append(error.what.replace(f"{run_dir}/", ""))
    elif data.summary.get("outcome") != "refused":
        data.notes.append("flight.mcap is missing")
    data.truth = _read_truth(run_dir / "truth.npz", data)
    data.occupied_xy_m = _read_map(run_dir / "map.npz", data)
    data.latencies_s = _read_latencies(run_dir / "latencies.npz", data)
    return data


def _read_messages(data: RunData, path: Path) -> None:
    odometry: list[tuple[float, list[float]]] = []
    kept = {"/plan": data.plans, "/depth": data.depths, "/event": data.events}
    kept |= {"/mode": data.modes, "/battery": data.battery}
    first_s: float | None = None
    for topic, message in read_log(path):
        stamp_s = message.get("stamp_s")
        if not isinstance(stamp_s, (int, float)):
            continue
        first_s = stamp_s if first_s is None else min(first_s, stamp_s)
        if topic == "/odometry":
            odometry.append((stamp_s, message["position_m"]))
        elif topic in kept:
            kept[topic].append(message)
    data.t0_s = first_s or 0.0
    if odometry:
        stamps = np.array([s for s, _ in odometry], dtype=np.float64)
        positions = np.array([p for _, p in odometry], dtype=np.float64)
        data.estimate = Track(stamps, positions, _air_at(stamps, data.modes))


def _air_at(stamps_s: Array, modes: list[dict[str, Any]]) -> NDArray[np.bool_]:
    """Whether the robot was in the air at each stamp, from the mode messages."""
    if not modes:
        return np.zeros(len(stamps_s), dtype=bool)
    changes = sorted((float(m["stamp_s"]), m.get("mode") == MODE_AIR) for m in modes)
    index = np.searchsorted([s for s, _ in changes], stamps_s, side="right") - 1
    flags = np.array([False, *(air for _, air in changes)])
    out: NDArray[np.bool_] = flags[index + 1]
    return out


def _load(path: Path, data: RunData, *names: str) -> Mapping[str, NDArray[Any]] | None:
    if not path.exists():
        return None
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in names if name in file}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile):
        data.notes.append(f"{path.name} cannot be read")
        return None


def _read_truth(path: Path, data: RunData) -> Track | None:
    arrays = _load(path, data, "stamp_s", "position_m", "mode")
    if not arrays or "stamp_s" not in arrays or "position_m" not in arrays:
        return None
    stamps = np.asarray(arrays["stamp_s"], dtype=np.float64)
    positions = np.asarray(arrays["position_m"], dtype=np.float64)
    if stamps.ndim != 1 or len(stamps) == 0 or positions.shape != (len(stamps), 3):
        return None
    if "mode" in arrays and arrays["mode"].shape == stamps.shape:
        mode = arrays["mode"]
        air = mode == MODE_AIR if mode.dtype.kind in "US" else mode.astype(bool)
    else:
        air = _air_at(stamps, data.modes)
    return Track(stamps, positions, np.asarray(air, dtype=bool))


def _read_map(path: Path, data: RunData) -> Array | None:
    arrays = _load(path, data, "occupied_xy")
    if not arrays or "occupied_xy" not in arrays:
        return None
    cells = np.asarray(arrays["occupied_xy"], dtype=np.float64)
    return cells if cells.ndim == 2 and cells.shape[1] == 2 and len(cells) else None


def _read_latencies(path: Path, data: RunData) -> dict[str, Array]:
    arrays = _load(path, data, *LATENCIES) or {}
    found = {name: np.asarray(values, dtype=np.float64) for name, values in arrays.items()}
    return {name: values[np.isfinite(values)] for name, values in found.items() if values.ndim == 1}
