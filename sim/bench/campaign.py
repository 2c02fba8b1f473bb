"""Every flight of a benchmark, once: what is missing is flown, what has ended is kept at once."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from labr_autonomy.errors import ExitCode, LabrError
from sim.bench.executors import Executor, Finished
from sim.bench.jobs import Job
from sim.bench.journal import Journal
from sim.bench.methods import ORACLE, find_method
from sim.bench.records import Record, read_json, task_from_dict, task_to_dict, write_whole
from sim.bench.rows import valid
from sim.bench.settings import Place, Settings
from sim.lockstep.trial import Task


class Stopped(LabrError):
    """The operator has ended the benchmark before it was done."""

    exit_code = ExitCode.ABORTED


@dataclass(slots=True)
class Progress:
    """How far it is."""

    total: int  # flights, as far as is known
    done: int = 0
    reached: int = 0
    errors: int = 0


OnProgress = Callable[[Progress], None]


@dataclass(slots=True)
class Campaign:
    """A benchmark at work.

    The oracle is flown first on each task: a task that it does not reach is given to nobody else. Where
    `fixed` holds the tasks, nothing is sampled and every method is flown.
    """

    settings: Settings
    folder: Path
    journal: Journal
    executor: Executor
    on_progress: OnProgress
    fixed: dict[tuple[str, int], Task] | None = None
    tasks: dict[tuple[str, int], Task] = field(default_factory=dict)
    _settled: set[tuple[str, int, str]] = field(default_factory=set)  # flights that need not be flown
    _waiting: int = 0  # flights still to come, as far as is known

    def run(self) -> None:
        """Fly what is missing.

        Raises:
            Stopped: on Ctrl-C; what has ended is kept.
        """
        try:
            self._run()
        except KeyboardInterrupt:
            done = sum(r.result is not None for r in self.journal.records.values())
            raise Stopped(
                f"stopped by the operator after {done} flights, which are kept in {self.folder}",
                f"Continue by the same command with --out {self.folder}",
            ) from None
        finally:
            self.executor.close()

    def _run(self) -> None:
        self.tasks = dict(self.fixed) if self.fixed is not None else self._cached_tasks()
        self._settled = {
            key  # what failed in an earlier run is tried once more
            for key, record in self.journal.records.items()
            if record.result is not None and key[:2] in self.tasks
        }
        places = {place.name: place for place in self.settings.places}
        queue: deque[Job] = deque()
        for place in self.settings.places:
            for seed in self.settings.seeds:
                queue.extend(self._missing(place, seed))
        self._waiting = sum(self._weight(job) for job in queue)
        self._report()
        while queue or self.executor.busy:
            while queue and self.executor.free:
                self.executor.submit(queue.popleft())
            finished = self.executor.next_finished()
            self._keep(finished)
            job = finished.job
            self._waiting -= self._weight(job)
            if self._gates(job):
                following = list(self._missing(places[job.place], job.seed))
                queue.extendleft(reversed(following))
                self._waiting += len(following)
            self._report()

    def _missing(self, place: Place, seed: int) -> Iterator[Job]:
        """Flights of one task that can begin now."""
        methods = [find_method(name) for name in self.settings.methods]
        task = self.tasks.get((place.name, seed))
        if self.fixed is None:
            if (place.name, seed, ORACLE) not in self._settled:
                yield self._job(place, seed, ORACLE, task)
                return
            if not valid(self.journal.records, place.name, seed):
                return
        assert task is not None  # it is fixed, or was kept before the oracle's flight
        for method in methods:
            if method.suits(task.in_air) and (place.name, seed, method.name) not in self._settled:
                yield self._job(place, seed, method.name, task)

    def _gates(self, job: Job) -> bool:
        """Whether other flights wait for this one."""
        return self.fixed is None and job.method == ORACLE

    def _weight(self, job: Job) -> int:
        """Flights that this job stands for: its own, and those that wait for it."""
        return 1 + (sum(m != ORACLE for m in self.settings.methods) if self._gates(job) else 0)

    def _job(self, place: Place, seed: int, method: str, task: Task | None) -> Job:
        return Job(place.name, place.spec, seed, method, task, self.settings.robot)

    def _keep(self, finished: Finished) -> None:
        job, answer = finished.job, finished.answer
        if answer is not None and (job.place, job.seed) not in self.tasks:
            self.tasks[job.place, job.seed] = answer.task
            write_whole(self._task_path(job.place, job.seed), json.dumps(task_to_dict(answer.task)) + "\n")
        result = None if answer is None else answer.result
        record = Record(job.place, job.seed, job.method, result, finished.error, finished.details)
        self.journal.add(record)
        self._settled.add(record.key)

    def _report(self) -> None:
        records = self.journal.records
        ended = [records[key] for key in self._settled]
        self.on_progress(
            Progress(
                total=len(ended) + self._waiting,
                done=len(ended),
                reached=sum(r.result is not None and r.result.outcome == "reached" for r in ended),
                errors=sum(r.result is None for r in ended),
            )
        )

    def _task_path(self, place: str, seed: int) -> Path:
        return self.folder / "tasks" / f"{place}-{seed}.json"

    def _cached_tasks(self) -> dict[tuple[str, int], Task]:
        (self.folder / "tasks").mkdir(exist_ok=True)
        paths = {
            (place.name, seed): self._task_path(place.name, seed)
            for place in self.settings.places
            for seed in self.settings.seeds
        }
        return {key: task_from_dict(read_json(path)) for key, path in paths.items() if path.is_file()}
