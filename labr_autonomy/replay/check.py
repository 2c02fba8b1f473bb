"""`labr-mission replay RUN --check`: would today's stack decide as the recorded one did?"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from labr_autonomy.errors import BadInput
from labr_autonomy.replay.decisions import check_decisions
from labr_autonomy.replay.plans import check_plans
from labr_autonomy.replay.verdict import Verdict

MOST = 100  # differences to tell; a changed network differs in every cycle


def check_run(
    run: Path, *, weights: Path | None = None, on_progress: Callable[[int], None] = lambda done: None
) -> Verdict:
    """Plan and decide again on what a run recorded, and compare field by field.

    Planner and pilot are compared each on its own recorded inputs, so that a difference in one does not
    hide behind another.

    Args:
        run: Folder of the run.
        weights: Another network's folder than the recorded flight's.
        on_progress: Called with the number of cycles done.

    Raises:
        BadInput: when the run does not hold what is needed.
    """
    if not (run / "flight.mcap").is_file():
        raise BadInput(f"{run} has no flight.mcap", "Name the folder of a run")
    if weights is not None and not (weights / "manifest.json").is_file():
        raise BadInput(f"{weights} holds no network", "Name a folder that labr-mission train wrote")
    done = 0

    def advance() -> None:
        nonlocal done
        done += 1
        on_progress(done)

    plans, differing = check_plans(run, weights, advance, MOST)
    complete = len(differing) < MOST
    ticks, others = check_decisions(run, MOST)
    return Verdict(plans, ticks, [*differing, *others], complete and len(others) < MOST)
