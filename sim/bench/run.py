"""A whole benchmark: from the question to the files in its run folder."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim.bench.campaign import Campaign, OnProgress
from sim.bench.executors import Executor
from sim.bench.jobs import Work, fly_job
from sim.bench.journal import Journal
from sim.bench.records import Record, plain, write_whole
from sim.bench.rows import error_list, invalid_trials, make_rows
from sim.bench.settings import Settings
from sim.lockstep.trial import Task


@dataclass(frozen=True, slots=True)
class Findings:
    """What a benchmark has found."""

    settings: Settings
    folder: Path
    tasks: Mapping[tuple[str, int], Task]
    records: Mapping[tuple[str, int, str], Record]
    gated: bool  # whether the oracle's flight decides if a task counts

    def results(self) -> dict[str, Any]:
        """`results.json`."""
        settings, kept = self.settings, self.settings.as_dict()
        places = [place.name for place in settings.places]
        return {
            "command": settings.command,
            "seed": settings.seed,
            "versions": kept.pop("versions"),
            "rows": plain(
                make_rows(places, settings.methods, self.tasks, self.records, settings.seed, gated=self.gated)
            ),
            "invalid": invalid_trials(self.tasks, self.records) if self.gated else [],
            "errors": error_list(self.records),
            "settings": kept,
        }


def make_executor(
    jobs: int, cluster: str | None, folder: Path, *, capped: bool, work: Work = fly_job
) -> Executor:
    """Where the flights are computed.

    Args:
        jobs: Processes of this machine.
        cluster: Address of a Ray cluster, to be used instead.
        folder: The run folder, for the workers' log.
        capped: `jobs` was asked for, so that a cluster computes no more at once either.
        work: What to do with a job.
    """
    if cluster is not None:
        from sim.bench.cluster import RayExecutor

        return RayExecutor(work, cluster, jobs if capped else None)
    from sim.bench.executors import ProcessExecutor

    return ProcessExecutor(work, jobs, folder / "workers.log")


def run_bench(
    settings: Settings,
    folder: Path,
    begin_executor: Callable[[], Executor],
    on_progress: OnProgress,
    fixed: Mapping[tuple[str, int], Task] | None = None,
) -> Findings:
    """Fly what is missing in a run folder.

    Args:
        settings: The question.
        folder: From `open_folder`.
        begin_executor: Called once the folder is known to be ours alone.
        on_progress: Called after each flight.
        fixed: The tasks, where they are not sampled; the oracle's flight then is one like any other.

    Raises:
        Stopped: on Ctrl-C.
    """
    with Journal(folder / "trials.jsonl") as journal:
        campaign = Campaign(
            settings,
            folder,
            journal,
            begin_executor(),
            on_progress,
            fixed=None if fixed is None else dict(fixed),
        )
        campaign.run()
        asked = {(p.name, s) for p in settings.places for s in settings.seeds}
        records = {key: record for key, record in journal.records.items() if key[:2] in asked}
        return Findings(settings, folder, campaign.tasks, records, gated=fixed is None)


def write_results(folder: Path, results: Mapping[str, Any], page: str) -> None:
    """Write results.json and results.md.

    Args:
        folder: The run folder.
        results: As `Findings.results` gives them.
        page: The same for a person, in Markdown.
    """
    write_whole(folder / "results.json", json.dumps(results, indent=1, allow_nan=False) + "\n")
    write_whole(folder / "results.md", page)
