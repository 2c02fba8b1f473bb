"""From single flights to the rows of the table.

Shares count every flight of a method that counts. Seconds, metres, joules and clearances are means over the
flights that reached their goal; energy over the oracle is the mean of the ratio over the tasks that both
reached. A task that the oracle does not reach counts for the oracle alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from labr_autonomy.record.summary import percentiles
from sim.bench import air_goals, statistics
from sim.bench.methods import ORACLE, find_method
from sim.bench.records import Record
from sim.lockstep.trial import Task, TrialResult

WORST = 5  # seeds named in a row
_OUTCOMES = ("reached", "contact", "timeout", "stopped")
_MEANS = (
    "time_s",
    "land_m",
    "air_m",
    "energy_j",
    "energy_land_j",
    "energy_air_j",
    "energy_transition_j",
    "min_clearance_m",
)

Tasks = Mapping[tuple[str, int], Task]
Records = Mapping[tuple[str, int, str], Record]


@dataclass(frozen=True, slots=True)
class Flight:
    """One flight that has a result, beside the oracle's of the same task."""

    task: Task
    result: TrialResult
    oracle: TrialResult | None

    @property
    def reached(self) -> bool:
        """Whether the goal was reached."""
        return self.result.outcome == "reached"

    @property
    def over_oracle(self) -> float:
        """Its energy over the oracle's; nan unless both reached the goal."""
        if not self.reached or self.oracle is None or self.oracle.outcome != "reached":
            return math.nan
        return self.result.energy_j / self.oracle.energy_j


def valid(records: Records, place: str, seed: int) -> bool:
    """Whether the oracle reached the goal."""
    oracle = records.get((place, seed, ORACLE))
    return oracle is not None and oracle.result is not None and oracle.result.outcome == "reached"


def flights(place: str, method: str, tasks: Tasks, records: Records, *, gated: bool = True) -> list[Flight]:
    """Flights of a method in a place that count, by seed.

    Args:
        place: Family or mesh world.
        method: Its name.
        tasks: All tasks.
        records: All records.
        gated: Tasks that the oracle did not reach count for the oracle alone.
    """
    found = []
    for record in sorted(records.values(), key=lambda r: r.seed):
        if (record.place, record.method) != (place, method) or record.result is None:
            continue
        if gated and method != ORACLE and not valid(records, place, record.seed):
            continue
        oracle = records.get((place, record.seed, ORACLE))
        task = tasks[place, record.seed]
        found.append(Flight(task, record.result, None if oracle is None else oracle.result))
    return found


def invalid_trials(tasks: Tasks, records: Records) -> list[dict[str, Any]]:
    """Tasks that the oracle flew and did not reach."""
    return [
        {
            "family": r.place,
            "seed": r.seed,
            "in_air": tasks[r.place, r.seed].in_air,
            "outcome": r.result.outcome,
            "reason": r.result.reason,
        }
        for r in sorted(records.values(), key=lambda r: r.key)
        if r.method == ORACLE and r.result is not None and r.result.outcome != "reached"
    ]


def error_list(records: Records) -> list[dict[str, Any]]:
    """Flights in which the program failed."""
    return [
        {"kind": "error", "family": r.place, "seed": r.seed, "method": r.method, "error": r.error}
        for r in sorted(records.values(), key=lambda r: r.key)
        if r.result is None
    ]


def make_rows(
    places: Sequence[str],
    methods: Sequence[str],
    tasks: Tasks,
    records: Records,
    seed: int,
    *,
    gated: bool = True,
) -> list[dict[str, Any]]:
    """Every row, by place and method; the oracle has one always when it decides what counts.

    Args:
        places: Names.
        methods: Names.
        tasks: All tasks.
        records: All records.
        seed: Of the intervals.
        gated: See `flights`.
    """
    named = list(methods)
    if gated and ORACLE not in named:
        named.append(ORACLE)
    rows = []
    for place in places:
        invalid = sum(entry["family"] == place for entry in invalid_trials(tasks, records)) if gated else 0
        for method in named:
            counted = flights(place, method, tasks, records, gated=gated)
            own = [r for r in records.values() if (r.place, r.method) == (place, method)]
            head = {"family": place, "method": method, "land_only": find_method(method).land_only}
            errors = sum(r.result is None for r in own)
            rows.append({**head, **_figures(counted, seed), "invalid": invalid, "errors": errors})
    return rows


def _figures(counted: Sequence[Flight], seed: int) -> dict[str, Any]:
    outcomes = np.array([f.result.outcome for f in counted], dtype=object)
    row: dict[str, Any] = {
        "trials": len(counted),
        "trials_land": sum(not f.task.in_air for f in counted),
        "trials_air": sum(f.task.in_air for f in counted),
        "movers": statistics.mean([float(f.result.movers) for f in counted]),
        "unseen_contact_pct": statistics.share_pct([f.result.unseen > 0 for f in counted]),
        "struck": sum(f.result.struck for f in counted),
    }
    for outcome in _OUTCOMES:
        flags = outcomes == outcome
        row[f"{outcome}_pct"] = statistics.share_pct(flags)
        row[f"{outcome}_pct_ci95"] = statistics.share_interval_pct(flags, seed)
    for kind, in_air in (("land", False), ("air", True)):
        reached = [f.reached for f in counted if f.task.in_air is in_air]
        row[f"reached_{kind}_pct"] = statistics.share_pct(reached)
        row[f"reached_{kind}_pct_ci95"] = statistics.share_interval_pct(reached, seed)
        ratios = [f.over_oracle for f in counted if f.task.in_air is in_air]
        _put(row, f"energy_over_oracle_{kind}", [r for r in ratios if math.isfinite(r)], seed)
    for key in _MEANS:
        _put(row, key, [float(getattr(f.result, key)) for f in counted if f.reached], seed)
    ratios = [f.over_oracle for f in counted]
    _put(row, "energy_over_oracle", [r for r in ratios if math.isfinite(r)], seed)
    _put(row, "spl", spl_of(counted), seed)
    flown = [f for f in counted if f.task.in_air and f.reached]
    row |= air_goals.figures([f.result for f in flown], [np.array(f.task.goal_m) for f in flown])
    row["min_clearance_worst_m"] = min((f.result.min_clearance_m for f in counted), default=None)
    row["plans"] = sum(f.result.plans for f in counted)
    row["plan_cycle_ms"] = percentiles(ms for f in counted for ms in f.result.plan_cycle_ms)
    row["real_time_factor"] = statistics.mean([f.result.real_time_factor for f in counted])
    row["worst_seeds"] = [f.task.seed for f in worst(counted)]
    return row


def spl_of(counted: Sequence[Flight]) -> list[float]:
    """Success weighted by path length of each flight."""
    values = statistics.path_efficiency(
        [f.reached for f in counted],
        [f.task.shortest_m for f in counted],
        [f.result.land_m + f.result.air_m for f in counted],
    )
    return [float(v) for v in values]


def worst(counted: Sequence[Flight], most: int = WORST) -> list[Flight]:
    """The flights to look at first: contacts, other failures, then the dearest against the oracle."""
    severity = {"contact": 0, "stopped": 1, "timeout": 2, "reached": 3}

    def key(flight: Flight) -> tuple[int, float, int]:
        ratio = flight.over_oracle
        return severity[flight.result.outcome], -ratio if math.isfinite(ratio) else 0.0, flight.task.seed

    return sorted(counted, key=key)[:most]


def _put(row: dict[str, Any], key: str, values: list[float], seed: int) -> None:
    row[key] = statistics.mean(values)
    row[f"{key}_ci95"] = statistics.bootstrap_mean(values, seed)
