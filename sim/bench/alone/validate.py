"""How a network does in the loop, to choose between the states of one training.

Each trial is one of the benchmark's tasks, with a seed that the benchmark does not use, flown by the network
alone. The oracle does not fly: a task has a verified way, and what it cannot fly costs all states the same.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput, Refused
from sim.bench import statistics
from sim.bench.alone.names import manifest_of, method_of
from sim.bench.executors import Executor, ProcessExecutor
from sim.bench.jobs import Answer, Job, fly_job
from sim.bench.tasks import sample_task
from sim.lockstep.trial import Outcome, TrialResult
from sim.worlds.families.draw import DIFFICULTY, SIZES

SEED = 500_000  # of the first trial: far from those of benchmarks and of training scenes
_COUNTED: dict[str, Outcome] = {
    "reached": "reached",
    "contacts": "contact",
    "timeouts": "timeout",
    "stopped": "stopped",
}


def fly_on_land(job: Job) -> Answer:
    """The trial of a seed, or of the first one after it in steps of `job.spec["stride"]` with a land goal."""
    spec = {key: value for key, value in job.spec.items() if key != "stride"}
    seed, task = job.seed, sample_task(spec, job.seed, RobotConfig())
    while task.in_air:
        seed += job.spec["stride"]
        task = sample_task(spec, seed, RobotConfig())
    return fly_job(Job(job.place, spec, seed, job.method, task))


def closed_loop(
    network_dir: Path,
    families: Sequence[str],
    trials: int,
    first_seed: int = SEED,
    jobs: int = 1,
    *,
    on_flight: Callable[[], None] = lambda: None,
    begin_executor: Callable[[Path], Executor] | None = None,
) -> dict[str, Any]:
    """Fly a network alone through trials that follow from their seeds.

    A network that was trained on land alone is given goals on the floor only.

    Args:
        network_dir: Weights' folder.
        families: World families.
        trials: In each of them.
        first_seed: Of the first; the others follow.
        jobs: Flights at once.
        on_flight: Called after each flight.
        begin_executor: Makes what computes the flights in a scratch folder; processes by default.

    Returns:
        JSON-ready: `families`, by name `reached`, `contacts`, `timeouts`, `stopped` and `n`; `reached_pct`,
        the share reached over all trials, `reached_pct_ci95`, and what was asked.

    Raises:
        BadInput: for an unknown family, no trials, or weights that cannot be used.
        Refused: when the program fails in a flight.
    """
    unknown = [name for name in families if name not in SIZES]
    if unknown or not families:
        what = f"there is no world family '{unknown[0]}'" if unknown else "no world family is named"
        raise BadInput(what, f"Take some of {', '.join(SIZES)}")
    if trials < 1:
        raise BadInput(f"{trials} trials tell nothing", "Fly at least one")
    method = method_of(network_dir)
    land_only = bool(manifest_of(method).get("land_only", False))
    spec: dict[str, Any] = {"difficulty": DIFFICULTY} | ({"stride": trials} if land_only else {})
    todo = [
        Job(family, {"family": family, **spec}, first_seed + k, method)
        for family in families
        for k in range(trials)
    ]
    with tempfile.TemporaryDirectory() as scratch:
        begin = begin_executor or (
            lambda folder: ProcessExecutor(
                fly_on_land if land_only else fly_job, jobs, folder / "workers.log"
            )
        )
        results = _flown(todo, begin(Path(scratch)), on_flight)
    counts = {}
    for family in families:
        own = [results[family, first_seed + k].outcome for k in range(trials)]
        counts[family] = {key: own.count(outcome) for key, outcome in _COUNTED.items()} | {"n": trials}
    reached = [results[job.place, job.seed].outcome == "reached" for job in todo]
    return {
        "network": str(network_dir),
        "first_seed": first_seed,
        "land_only": land_only,
        "families": counts,
        "reached_pct": statistics.share_pct(reached),
        "reached_pct_ci95": statistics.share_interval_pct(reached, first_seed),
    }


def _flown(
    todo: Sequence[Job], executor: Executor, on_flight: Callable[[], None]
) -> dict[tuple[str, int], TrialResult]:
    """Every result by family and seed."""
    waiting, results = list(reversed(todo)), {}
    try:
        while waiting or executor.busy:
            while waiting and executor.free:
                executor.submit(waiting.pop())
            finished = executor.next_finished()
            job = finished.job
            if finished.answer is None:
                raise Refused(
                    f"the program failed in {job.place} seed {job.seed}: {finished.error.rstrip('.')}",
                    "Fly it again by labr-mission sim to see where",
                )
            results[job.place, job.seed] = finished.answer.result
            on_flight()
    finally:
        executor.close()
    return results
