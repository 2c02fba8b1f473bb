"""The pilot on its recorded looks: steps, failsafe, modes, transition, guard and set-points, tick by tick."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput
from labr_autonomy.guard.fence import Zone
from labr_autonomy.mission.pilot import Pilot
from labr_autonomy.mission.pilot_io import Look
from labr_autonomy.mission.steps import Step
from labr_autonomy.planner.messages import PlanResult
from labr_autonomy.record.codec import differences, pack, unpack
from labr_autonomy.record.mcap_reader import read_log
from labr_autonomy.replay.plans import read_plans
from labr_autonomy.replay.verdict import Difference
from labr_autonomy.types import Odometry, Pose


def check_decisions(run: Path, most: int) -> tuple[int, list[Difference]]:
    """Let the pilot decide every tick again, with the plans that the recorded flight had.

    Args:
        run: Folder of the run.
        most: Differences to look for before it stops.

    Returns:
        Ticks compared, and the differences in their order.
    """
    plans: dict[int, PlanResult] = {cycle.result.sequence: cycle.result for cycle in read_plans(run)}
    pilot: Pilot | None = None
    began_s = None
    compared, found = 0, []
    for call in _calls(run):
        if call["call"] == "make":
            pilot = _make(call)
            continue
        if pilot is None:
            raise BadInput("the recording begins in the middle of a flight", "Name a whole run")
        if call["call"] == "tick":
            began_s = call["now_s"] if began_s is None else began_s
            compared += 1
        for path, before, after in _make_again(pilot, call, plans):
            at_s = call["now_s"] - (began_s or call["now_s"])
            found.append(Difference("pilot", f"{call['call']} at {at_s:.2f} s", path, before, after))
            if len(found) >= most:
                return compared, found
    return compared, found


def _calls(run: Path) -> Iterator[dict[str, Any]]:
    any_seen = False
    for topic, message in read_log(run / "flight.mcap"):
        if topic == "/recorder" and message.get("dropped"):
            raise BadInput(
                f"the recording lost {message['dropped']} messages to a slow disk",
                "It cannot be decided again",
            )
        if topic == "/pilot":
            any_seen = True
            yield message
    if not any_seen:
        raise BadInput(f"{run} does not hold what the pilot was shown", "Record a new run")


def _make(call: dict[str, Any]) -> Pilot:
    try:
        return Pilot(RobotConfig.model_validate(call["robot"]), duration_s=unpack(float, call["duration_s"]))
    except ValidationError:
        raise BadInput(
            "the recording's robot is not one of this version", "Replay it with the version that recorded it"
        ) from None


def _make_again(
    pilot: Pilot, call: dict[str, Any], plans: dict[int, PlanResult]
) -> Iterator[tuple[str, Any, Any]]:
    """Make one recorded call; yields how its answer differs."""
    now_s = call.get("now_s", 0.0)
    match call["call"]:
        case "tick":
            yield from differences(call["actions"], pack(pilot.tick(unpack(Look, call["look"]), now_s)))
        case "request":
            made = pilot.request(
                call["sequence"],
                call["frame_sequence"],
                unpack(Pose, call["frame_pose"]),
                unpack(Odometry, call["odometry"]),
                now_s,
            )
            yield from differences(call["request"], pack(made))
        case "accept":
            plan = plans.get(call["sequence"])
            if plan is None:  # the planner's log was cut off before
                yield f"plan {call['sequence']}", "accepted", "not recorded"
            else:
                pilot.accept(plan, now_s)
        case "load":
            zones = [unpack(Zone, zone) for zone in call["zones"]]
            pilot.load([unpack(Step, step) for step in call["mission"]], zones)
        case "insert":
            pilot.insert([unpack(Step, step) for step in call["steps"]], now_s, keep=call["keep"])
        case "begin":
            pilot.begin(now_s)
        case "skip":
            pilot.skip(now_s)
        case "fail":
            pilot.fail(call["reason"])
        case other:
            raise BadInput(
                f"nothing is known of a call '{other}'", "Replay it with the version that recorded it"
            )
