"""One flight as a unit of work for another process, perhaps on another machine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sim.lockstep.trial import Task, Trial, TrialResult


@dataclass(frozen=True, slots=True)
class Job:
    """Everything that a worker needs to know."""

    place: str  # family, or the name of a mesh world
    spec: dict[str, Any]  # of the world, for `sample_task`
    seed: int
    method: str
    task: Task | None = None  # None: to be sampled first
    robot: dict[str, Any] | None = None  # fields of RobotConfig; None: the standard robot


@dataclass(frozen=True, slots=True)
class Answer:
    """What a worker gives back."""

    task: Task
    result: TrialResult


Work = Callable[[Job], Answer]


def fly_job(job: Job) -> Answer:
    """Sample the task where it is not known, and fly it."""
    from labr_autonomy.config import RobotConfig
    from sim.lockstep.run import fly_trial

    robot = RobotConfig() if job.robot is None else RobotConfig(**job.robot)
    task = job.task
    if task is None:
        from sim.bench.tasks import sample_task

        task = sample_task(job.spec, job.seed, robot)
    return Answer(task, fly_trial(Trial(task, job.method), robot))
