"""The planner on its recorded requests and depth images: network, map and refiner, cycle by cycle."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput
from labr_autonomy.planner.messages import PlanRequest, PlanResult
from labr_autonomy.planner.recorder import FRAME, REQUEST, RESULT, START
from labr_autonomy.record import foxglove
from labr_autonomy.record.codec import differences, pack, unpack
from labr_autonomy.record.mcap_reader import read_raw
from labr_autonomy.replay.verdict import Difference
from labr_autonomy.types import DepthFrame, Intrinsics

CAUSES = ("network", "followed", "source", "reason")
NOT_COMPARED = ("timings",)  # how long it took is no decision


@dataclass(slots=True)
class Recorded:
    """One cycle as it was."""

    robot: RobotConfig
    begins: bool  # of a planner process: nothing of what came before is known to it
    request: PlanRequest
    frame: DepthFrame | None
    result: PlanResult


def planner_logs(run: Path) -> list[Path]:
    """The logs of a run's planner processes, in their order."""
    first = run / "planner.mcap"
    later = sorted(run.glob("planner-*.mcap"), key=lambda p: int(p.stem.rpartition("-")[2]))
    return [path for path in (first, *later) if path.exists()]


def read_plans(run: Path) -> Iterator[Recorded]:
    """The cycles of a run, in order.

    Raises:
        BadInput: when the run holds none, or they were recorded by another version.
    """
    logs = planner_logs(run)
    if not logs:
        raise BadInput(f"{run} has no planner.mcap, so there is nothing to plan again", "Record a new run")
    for path in logs:
        robot: RobotConfig | None = None
        begins, depth, asked = True, None, None
        for topic, _, data in read_raw(path):
            if topic == FRAME:
                depth = foxglove.depth_of(data)
                continue
            message = json.loads(data)
            if topic == START:
                robot = _robot(message)
            elif topic == REQUEST:
                asked = message
            elif topic == RESULT and asked is not None and robot is not None:
                request = unpack(PlanRequest, asked["request"])
                frame = _frame(asked["frame"], depth)
                yield Recorded(robot, begins, request, frame, unpack(PlanResult, message["result"]))
                begins = False


def check_plans(
    run: Path, weights: Path | None, on_cycle: Callable[[], None], most: int
) -> tuple[int, list[Difference]]:
    """Plan every cycle again.

    Args:
        run: Folder of the run.
        weights: Another network's folder, or None for the recorded flight's.
        on_cycle: Called after each.
        most: Differences to look for before it stops.

    Returns:
        Cycles compared, and the differences in their order.
    """
    from labr_autonomy.planner.pipeline import Pipeline  # heavy

    pipeline: Pipeline | None = None
    compared, found = 0, []
    for cycle in read_plans(run):
        if cycle.begins:
            robot = cycle.robot
            if weights is not None:
                network = robot.network.model_copy(update={"weights": weights})
                robot = robot.model_copy(update={"network": network})
            pipeline = Pipeline(robot)
        assert pipeline is not None, "each log begins a planner"
        now = pipeline.cycle(cycle.request, cycle.frame)
        compared += 1
        where = f"plan {cycle.request.sequence}"
        was, again = _decided(cycle.result), _decided(now)
        for path, before, after in differences(was, again):
            found.append(Difference("planner", where, path, before, after))
            if len(found) >= most:
                return compared, found
        on_cycle()
    return compared, found


def count_plans(run: Path) -> int:
    """How many cycles were recorded."""
    return sum(1 for path in planner_logs(run) for topic, _, _ in read_raw(path) if topic == RESULT)


def _decided(result: PlanResult) -> dict[str, Any]:
    """What is compared, causes first: a network that differs is named before the trajectory it led to."""
    packed: dict[str, Any] = pack(result)
    rest = (name for name in packed if name not in CAUSES and name not in NOT_COMPARED)
    return {name: packed[name] for name in (*CAUSES, *rest)}


def _frame(shown: dict[str, Any] | None, depth: Any) -> DepthFrame | None:
    if shown is None or depth is None:
        return None
    return DepthFrame(shown["sequence"], shown["stamp_s"], depth, unpack(Intrinsics, shown["k"]))


def _robot(message: dict[str, Any]) -> RobotConfig:
    try:
        return RobotConfig.model_validate(message["robot"])
    except (KeyError, ValidationError):
        raise BadInput(
            "the recording's robot is not one of this version", "Replay it with the version that recorded it"
        ) from None
