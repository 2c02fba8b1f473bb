"""Tasks and results as JSON values and back. What is not finite is null in the files."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from labr_autonomy.errors import BadInput
from sim.lockstep.trial import Task, TrialResult

_RESULT_NUMBERS = frozenset(f.name for f in fields(TrialResult) if f.type == "float")


def plain(value: Any) -> Any:
    """The same value with null for numbers that JSON cannot hold."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


def task_to_dict(task: Task) -> dict[str, Any]:
    """JSON-ready."""
    return {key: plain(value) for key, value in asdict(task).items()}


def task_from_dict(values: Mapping[str, Any]) -> Task:
    """Back again."""
    x_m, y_m, yaw_rad, floor_m = values["start"]
    gx_m, gy_m, gz_m = values["goal_m"]
    known = {"start": (x_m, y_m, yaw_rad, floor_m), "goal_m": (gx_m, gy_m, gz_m)}
    return Task(**{**values, **known, "movers": tuple(values.get("movers", ()))})


def result_from_dict(values: Mapping[str, Any]) -> TrialResult:
    """A result as the journal keeps it."""
    known: dict[str, Any] = {
        k: math.nan if v is None and k in _RESULT_NUMBERS else v for k, v in values.items()
    }
    known["track"] = [tuple(point) for point in values["track"]]
    known["events"] = [tuple(event) for event in values["events"]]
    return TrialResult(**known)


@dataclass(frozen=True, slots=True)
class Record:
    """What the journal keeps of one flight: its result, or why there is none."""

    place: str  # family, or the name of a mesh world
    seed: int
    method: str
    result: TrialResult | None
    error: str = ""  # a sentence, when the program failed in this trial
    details: str = ""  # its traceback

    @property
    def key(self) -> tuple[str, int, str]:
        """What identifies the flight."""
        return self.place, self.seed, self.method

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready; `kind` is "flown" or "error"."""
        head = {"place": self.place, "seed": self.seed, "method": self.method}
        if self.result is None:
            return {"kind": "error", **head, "error": self.error, "details": self.details}
        return {"kind": "flown", **head, "result": plain(self.result.as_dict())}

    @staticmethod
    def from_dict(values: Mapping[str, Any]) -> Record:
        """Back again."""
        flown = values["kind"] == "flown"
        return Record(
            place=str(values["place"]),
            seed=int(values["seed"]),
            method=str(values["method"]),
            result=result_from_dict(values["result"]) if flown else None,
            error=str(values.get("error", "")),
            details=str(values.get("details", "")),
        )


def write_whole(path: Path, text: str) -> None:
    """Write a file so that whoever looks finds the old one or the whole new one."""
    beside = path.with_name(f".{path.name}.new")
    with beside.open("w", encoding="utf-8") as stream:
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())
    beside.replace(path)


def read_json(path: Path) -> Any:
    """A JSON file of a run folder.

    Raises:
        BadInput: when it cannot be read.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise BadInput(f"{path} cannot be read: {error}", "Choose another --out DIR") from None
