"""From the records of a flight, and the truth where it is known, to `summary.json`."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from labr_autonomy.mission.logbook import LegRecord, Logbook
from labr_autonomy.mission.schema import Mission
from labr_autonomy.mission.steps import Kind, goal_distance_m
from labr_autonomy.record.summary import Leg, Outcome, Summary, percentiles, versions
from labr_autonomy.types import Array


def flown(
    name: str,
    record: Logbook,
    outcome: Outcome,
    reason: str,
    seed: int | None,
    start_m: Array,
    planner_versions: dict[str, str],
) -> Summary:
    """Summary of a flight from the robot's own estimate."""
    meter = record.meter
    legs = [_leg(leg, record.started_s) for leg in record.legs]
    return Summary(
        outcome=outcome,
        reason=reason,
        duration_s=round(record.ended_s - record.started_s, 3),
        land_m=round(meter.land_m, 3),
        air_m=round(meter.air_m, 3),
        energy_land_j=round(meter.energy_land_j, 1),
        energy_air_j=round(meter.energy_air_j, 1),
        energy_transition_j=round(meter.energy_transition_j, 1),
        contacts=None,
        min_clearance_m=None,
        goal_errors_m=[leg.goal_error_m for leg in legs if leg.goal_error_m is not None],
        tick_late_ms=percentiles(v * 1e3 for v in record.tick_late_s),
        plan_cycle_ms=percentiles(v * 1e3 for v in record.plan_cycle_s),
        setpoint_age_ms=percentiles(v * 1e3 for v in record.setpoint_age_s),
        seed=seed,
        versions={**versions(), **planner_versions},
        mission=name,
        legs=legs,
        start_m=tuple(round(float(v), 3) for v in start_m),
        extra={
            "ticks": len(record.tick_late_s),
            "ticks_missed": record.ticks_missed,
            "plans": len(record.plan_cycle_s),
            "leg_ends_mono_s": [leg.end_s for leg in record.legs],
        },
    )


def _leg(leg: LegRecord, started_s: float) -> Leg:
    step = leg.step
    goal = None
    error = None
    if step.kind is Kind.GOTO and step.goal_m is not None:
        goal = tuple(round(float(v), 3) for v in (step.goal_m if step.in_air else step.goal_m[:2]))
        error = round(goal_distance_m(step, leg.position_m), 3)
    return Leg(
        index=leg.index,
        label=step.label,
        outcome=leg.outcome,
        start_s=round(leg.start_s - started_s, 2),
        duration_s=round(leg.end_s - leg.start_s, 2),
        goal_m=goal,
        land_m=round(leg.land_m, 3),
        air_m=round(leg.air_m, 3),
        energy_j=round(leg.energy_j, 1),
        goal_error_m=error,
    )


def unmoved(name: str, outcome: Outcome, reason: str, seed: int | None) -> Summary:
    """Summary of a mission that never moved."""
    none = percentiles([])
    return Summary(
        outcome=outcome,
        reason=reason,
        duration_s=0.0,
        land_m=0.0,
        air_m=0.0,
        energy_land_j=0.0,
        energy_air_j=0.0,
        energy_transition_j=0.0,
        contacts=None,
        min_clearance_m=None,
        goal_errors_m=[],
        tick_late_ms=none,
        plan_cycle_ms=none,
        setpoint_age_ms=none,
        seed=seed,
        mission=name,
    )


def with_truth(summary: Summary, run_dir: Path) -> Summary:
    """The summary with what the simulator's referee saw; unchanged where there is no referee."""
    account_path, track_path = run_dir / "referee.json", run_dir / "truth.npz"
    if not account_path.is_file() or not track_path.is_file():
        return summary
    account = json.loads(account_path.read_text())
    with np.load(track_path) as track:
        stamps, positions = track["stamp_s"], track["position_m"]
    legs = []
    for leg, end_s in zip(summary.legs, summary.extra["leg_ends_mono_s"], strict=True):
        if leg.goal_m is None or not len(stamps):
            legs.append(leg)
            continue
        there = positions[min(int(np.searchsorted(stamps, end_s)), len(stamps) - 1)]
        goal = np.array(leg.goal_m)
        error = float(np.linalg.norm(there[: len(goal)] - goal))
        legs.append(replace(leg, goal_error_m=round(error, 3)))
    return replace(
        summary,
        legs=legs,
        contacts=account["contacts"],
        min_clearance_m=account["min_clearance_m"],
        goal_errors_m=[leg.goal_error_m for leg in legs if leg.goal_error_m is not None],
        extra={**summary.extra, "truth": account},
    )


def missed_expectations(summary: Summary, mission: Mission, *, judged: bool) -> Summary:
    """The summary with a sentence for every expectation of the mission that it does not meet.

    Args:
        summary: How it went.
        mission: With its `expect` block.
        judged: The truth should be known (a simulated run); without it, contacts cannot be counted.
    """
    expect = mission.expect
    if expect is None:
        return summary
    missed = []
    if summary.outcome != expect.outcome:
        missed.append(f"outcome {summary.outcome}, expected {expect.outcome}")
    if expect.contacts is not None and summary.contacts is None and judged:
        missed.append("nobody counted contacts")
    elif expect.contacts is not None and (summary.contacts or 0) > expect.contacts:
        missed.append(f"{summary.contacts} contacts, expected at most {expect.contacts}")
    if expect.min_land_m is not None and summary.land_m < expect.min_land_m:
        missed.append(f"{summary.land_m:.1f} m on land, expected at least {expect.min_land_m:g} m")
    if expect.min_air_m is not None and summary.air_m < expect.min_air_m:
        missed.append(f"{summary.air_m:.1f} m in the air, expected at least {expect.min_air_m:g} m")
    worst = max(summary.goal_errors_m, default=0.0)
    if expect.max_goal_error_m is not None and worst > expect.max_goal_error_m:
        missed.append(f"{worst:.2f} m off a goal, expected at most {expect.max_goal_error_m:g} m")
    return replace(summary, expect_missed=missed)
