"""`summary.json`: how a run went, in figures."""

from __future__ import annotations

import json
import math
import platform
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any, Literal

import numpy as np

from labr_autonomy import __version__
from labr_autonomy.errors import BadInput

Outcome = Literal["success", "refused", "aborted", "failsafe", "failed"]
Percentiles = dict[str, float | None]

PACKAGES = ("mavsdk", "pymavlink", "casadi", "onnxruntime", "numpy", "jsbsim")


def percentiles(values: Iterable[float]) -> Percentiles:
    """`{p50, p99, max}` of the finite values; nulls when there are none."""
    finite = np.array([v for v in values if math.isfinite(v)], dtype=np.float64)
    if finite.size == 0:
        return {"p50": None, "p99": None, "max": None}
    p50, p99 = np.percentile(finite, [50.0, 99.0])
    return {"p50": round(float(p50), 3), "p99": round(float(p99), 3), "max": round(float(finite.max()), 3)}


def versions() -> dict[str, str]:
    """Versions of this project and of what it stands on."""
    found = {"labr_autonomy": __version__, "python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue  # optional in some installations
    return found


@dataclass(frozen=True, slots=True)
class Leg:
    """One item of the mission as it went."""

    index: int  # into the mission's items
    label: str  # "goto far_corner"
    outcome: str  # "done", "skipped", "failed", "not reached"
    start_s: float  # since the run began
    duration_s: float
    goal_m: tuple[float, ...] | None = None  # (x, y) on the floor or (x, y, z) in the air, odom
    land_m: float = 0.0
    air_m: float = 0.0
    energy_j: float = 0.0
    goal_error_m: float | None = None  # of the true pose where it is known, else of the estimate


@dataclass(frozen=True, slots=True)
class Summary:
    """The whole file; None where a figure is not known."""

    outcome: Outcome
    reason: str  # one sentence
    duration_s: float
    land_m: float
    air_m: float
    energy_land_j: float
    energy_air_j: float
    energy_transition_j: float
    contacts: int | None
    min_clearance_m: float | None
    goal_errors_m: list[float]
    tick_late_ms: Percentiles
    plan_cycle_ms: Percentiles
    setpoint_age_ms: Percentiles  # depth frame to the set-point that follows from it
    seed: int | None
    versions: dict[str, str] = field(default_factory=versions)
    mission: str = ""
    legs: list[Leg] = field(default_factory=list)
    start_m: tuple[float, ...] | None = None  # odom
    expect_missed: list[str] = field(default_factory=list)  # sentences
    extra: dict[str, Any] = field(default_factory=dict)  # further figures, by name

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready: `extra` beside the rest, no NaN."""
        values = asdict(self)
        extra = values.pop("extra")
        merged: dict[str, Any] = _plain({**extra, **values})
        return merged


def write_summary(summary: Summary, run_dir: Path) -> Path:
    """Write `summary.json` whole or not at all; returns its path."""
    path = run_dir / "summary.json"
    draft = path.with_suffix(".json.part")
    draft.write_text(json.dumps(summary.as_dict(), indent=2, allow_nan=False) + "\n", encoding="utf-8")
    draft.replace(path)
    return path


def read_summary(run_dir: Path) -> dict[str, Any]:
    """The figures of a run.

    Raises:
        BadInput: when there are none.
    """
    path = run_dir / "summary.json"
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"{path} cannot be read: {error.strerror}", "Name the folder of a run") from None
    except ValueError:
        raise BadInput(f"{path} is not JSON", "Name the folder of a run that ended") from None
    if not isinstance(values, dict):
        raise BadInput(f"{path} holds no figures", "Name the folder of a run that ended")
    return values


def _plain(value: Any) -> Any:
    """Numpy and non-finite numbers as JSON knows them."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
