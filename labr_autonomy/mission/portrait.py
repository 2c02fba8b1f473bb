"""The flight as its operator sees it: one JSON object, built from what the executive knows anyway. Pure.

Keys are read by `console/page/*.js` and kept in the flight log for replay. Stamps are CLOCK_MONOTONIC
seconds, places odom ENU metres, angles radians; a figure that is unknown is null.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.console.admission import State as Lease
from labr_autonomy.frames import yaw_of
from labr_autonomy.guard.failsafe import Reaction
from labr_autonomy.guard.fence import Zone
from labr_autonomy.mission.operator import LINK_LATE_S, OTHER_LATE_S, Stage, stale
from labr_autonomy.mission.pilot import Pilot
from labr_autonomy.mission.pilot_io import Actions
from labr_autonomy.mission.preflight import Check
from labr_autonomy.mission.steps import Status, Step
from labr_autonomy.modes.transition import Phase
from labr_autonomy.planner.messages import PlanResult
from labr_autonomy.types import Array, KeyPoints, Odometry, Trajectory

Body = dict[str, Any]

PATH_POINTS = 24
STEPS_SHOWN = 60  # a mission may have hundreds; these are around the present one
STEPS_BEFORE = 10
SENTENCE_MAX = 300  # characters of an event
MU_LIMIT = 0.5  # a path whose probability to collide is above this is not followed


@dataclass(frozen=True, slots=True)
class Joules:
    """The energy account [J]."""

    used: float
    left: float  # in the pack, above the reserve; nan while the autopilot does not report its charge
    needed: float  # to the mission's end, at least
    voltage_v: float
    power_w: float


def mode_word(actions: Actions, stage: Stage) -> str:
    """LAND, AIR, TRANSITION or HOLD."""
    if actions.phase not in (Phase.DRIVING, Phase.FLYING):
        return "TRANSITION"
    if actions.reaction is Reaction.HOLD or stage in (Stage.WAITING, Stage.PAUSED):
        return "HOLD"
    return "LAND" if actions.phase is Phase.DRIVING else "AIR"


def why(actions: Actions, pilot: Pilot, stage: Stage, note: str) -> str:
    """The reason for what it does, as a sentence; a reaction's first cause goes before all else."""
    if actions.reaction is not Reaction.NONE:
        return f"{actions.reaction.name.lower()}: {pilot.failsafe.sentence}"
    if pilot.failure:
        return pilot.failure
    match stage:
        case Stage.WAITING:
            return "waiting for start"
        case Stage.PAUSED:
            return "paused by the operator"
        case Stage.ENDING:
            return "the operator ended the mission; coming down"
        case Stage.RUNNING:
            pass
    if actions.phase not in (Phase.DRIVING, Phase.FLYING):
        same = not note or note.startswith(actions.phase.value)
        return note or actions.phase.value if same else f"{actions.phase.value}; {note}"
    if pilot.steps.status is Status.HOLDING:
        return "the step has failed, and its on_fail says hold"
    if actions.step is None:
        return "mission complete"
    return actions.step.label


def portrait(
    *,
    stamp_s: float,
    started_s: float,
    actions: Actions,
    pilot: Pilot,
    stage: Stage,
    lease: Lease,
    note: str,
    estimate: Odometry | None,
    ages_s: Mapping[str, float],
    joules: Joules,
    steps: Sequence[Step],
    plan: PlanResult | None,
    events: Iterable[tuple[int, float, str]],
    checks: Sequence[Check],
    tick_late_ms: float,
    outcome: str = "",
) -> Body:
    """Everything that changes, at one instant.

    Args:
        stamp_s: The present.
        started_s: When the mission began.
        actions: What left in the last tick.
        pilot: Its mode, steps and first cause.
        stage: What the operator may do now.
        lease: Who has control, and what was answered.
        note: What the robot last said.
        estimate: Where it is.
        ages_s: Age of each link's last datum.
        joules: The energy account.
        steps: The whole mission, with what the operator put in.
        plan: The newest plan.
        events: (number, stamp, sentence), the oldest first.
        checks: Pre-flight checks.
        tick_late_ms: How late the last set-point tick was, p99 of the last seconds.
        outcome: How the mission ended, once it has.
    """
    goal = None if actions.step is None or actions.step.goal_m is None else actions.step
    first = max(0, min(pilot.steps.index - STEPS_BEFORE, len(steps) - STEPS_SHOWN))
    shown = list(enumerate(steps))[first : first + STEPS_SHOWN]
    return {
        "stamp_s": stamp_s,
        "time_s": round(max(0.0, stamp_s - started_s), 2) if stage is not Stage.WAITING else 0.0,
        "mode": mode_word(actions, stage),
        "why": outcome or why(actions, pilot, stage, note),
        "phase": actions.phase.value,
        "stage": stage.value,
        "reaction": actions.reaction.name.lower(),
        "locked": stale(ages_s),
        "links": {
            name: {"age_s": number(age_s), "limit_s": LINK_LATE_S.get(name, OTHER_LATE_S)}
            for name, age_s in ages_s.items()
        },
        "goal": None
        if goal is None
        else {
            "label": goal.label,
            "distance_m": number(actions.distance_m, 2),
            "place_m": row(goal.goal_m),
            "air": goal.in_air,
        },
        "leg": pilot.steps.index,
        "steps": [_step(s, i, pilot.steps.index, pilot.steps.status) for i, s in shown],
        "steps_first": first,
        "steps_total": len(steps),
        "energy": {
            "used_j": number(joules.used, 0),
            "left_j": number(joules.left, 0),
            "needed_j": number(joules.needed, 0),
            "voltage_v": number(joules.voltage_v, 2),
            "power_w": number(joules.power_w, 0),
        },
        "pose": None
        if estimate is None
        else {
            "position_m": row(estimate.pose.position_m),
            "quaternion": row(estimate.pose.quaternion, 4),
            "yaw_rad": round(yaw_of(estimate.pose.quaternion), 3),
            "speed_mps": number(float(np.linalg.norm(estimate.velocity_mps)), 2),
            "height_m": number(float(estimate.pose.position_m[2]) - pilot.floor_z_m, 2),
        },
        "plan": None if plan is None else _plan(plan),
        "events": [[n, round(s - started_s, 2), text[:SENTENCE_MAX]] for n, s, text in events],
        "checks": [[c.name, c.passed, c.figure, c.fix] for c in checks],
        "outcome": outcome,
        "control": {
            "holder": lease.holder,
            "answers": [[a.page, a.sequence, a.kind.value, a.verdict, a.reason] for a in lease.answers],
        },
        "tick_late_ms": number(tick_late_ms, 1),
    }


def facts_of(
    robot: RobotConfig,
    mission: str,
    run: str,
    zones: Sequence[Zone],
    home_m: Array,
    floor_z_m: float,
    pid: int,
) -> Body:
    """Everything that holds for the whole flight.

    Args:
        robot: Outline, camera, ceiling.
        mission: Its name.
        run: Name of the run folder.
        zones: Fences.
        home_m: (3,) body at the start, odom.
        floor_z_m: Floor at the start, odom.
        pid: Of the executive.
    """
    c = robot.camera
    return {
        "pid": pid,
        "mission": mission,
        "run": run,
        "depth_slot": robot.links.depth,
        "camera": {"fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy, "x_m": c.x_m, "z_m": c.z_m},
        "radius_m": robot.body.radius_m,
        "below_m": robot.body.below_m,
        "above_m": robot.body.above_m,
        "height_max_m": robot.air.height_max_m,
        "home_m": row(home_m),
        "floor_z_m": number(floor_z_m),
        "fences": [
            {
                "outline_m": [[number(x), number(y)] for x, y in zone.outline],
                "keep_in": zone.keep_in,
                "radius_m": zone.radius_m,
            }
            for zone in zones
        ],
    }


def _step(step: Step, index: int, current: int, status: Status) -> Body:
    if index < current or status is Status.DONE:
        word = "done"
    elif index == current:
        word = {Status.FAILED: "failed", Status.HOLDING: "failed"}.get(status, "now")
    else:
        word = "next"
    place = None if step.goal_m is None else row(step.goal_m)
    return {"label": step.label, "state": word, "place_m": place, "air": step.in_air, "kind": step.kind.value}


def _plan(plan: PlanResult) -> Body:
    return {
        "source": plan.source.value,
        "reason": plan.reason,
        "clearance_m": number(plan.clearance_m, 2),
        "mu": number(plan.network.mu, 3),
        "mu_limit": MU_LIMIT,
        "network": _points(plan.network),
        "followed": _points(plan.followed),
        "path_m": _path(plan.trajectory),
        "path_air": plan.trajectory is not None and plan.trajectory.mode.value == "air",
        "cycle_ms": number(plan.timings.total_s * 1e3, 0),
    }


def _points(points: KeyPoints | None) -> list[list[float | None]] | None:
    """Rows x, y, z, and 1 where the point is flown to."""
    if points is None:
        return None
    flags = zip(points.points_m, points.air, strict=True)
    return [[*row(p), int(a)] for p, a in flags]


def _path(trajectory: Trajectory | None) -> list[list[float | None]]:
    if trajectory is None:
        return []
    last = len(trajectory.position_m) - 1
    kept = np.unique(np.linspace(0, last, PATH_POINTS).astype(int))
    return [row(trajectory.position_m[i]) for i in kept]


def number(value: float, digits: int = 3) -> float | None:
    """Rounded; null for what JSON does not know."""
    value = float(value)
    return round(value, digits) if math.isfinite(value) else None


def row(values: Iterable[Any] | None, digits: int = 3) -> list[float | None]:
    """A vector, rounded."""
    return [] if values is None else [number(v, digits) for v in values]
