"""Flights that cost nothing: what a trial gives follows from its seed alone. Workers can import them."""

from __future__ import annotations

import dataclasses
import os
import signal
from pathlib import Path

from sim.bench.executors import attempt
from sim.bench.jobs import Answer
from sim.bench.settings import Place, Settings
from sim.lockstep.trial import Task, TrialResult

CRASHES, RAISES, UNREACHABLE, FAILS = 3, 4, 5, 6  # seeds


def make_task(seed, *, in_air=None, **changes):
    values = dict(
        world={"family": "hall", "size_m": [12.0, 8.0], "seed": seed, "clear_m": []},
        seed=seed,
        start=(-4.0, 0.0, 0.0, 0.0),
        goal_m=(4.0, 1.0, 1.5 if seed % 2 else 0.12),
        in_air=bool(seed % 2) if in_air is None else in_air,
        in_sight=False,
        distance_m=8.1,
        shortest_m=9.0,
        bound_j=1000.0,
        bound_s=15.0,
    )
    return Task(**{**values, **changes})


def make_result(**changes):
    values = dict(
        outcome="reached",
        reason="",
        goal_error_m=0.2,
        time_s=20.0,
        land_m=10.0,
        air_m=0.0,
        energy_land_j=1500.0,
        energy_air_j=0.0,
        energy_transition_j=0.0,
        min_clearance_m=0.1,
        touchdown_mps=0.0,
        plans=3,
        sources={"gkpn": 2, "search": 1},
        plan_cycle_ms=[10.0, 20.0, 30.0],
        real_time_factor=5.0,
        track=[(0.0, -4.0, 0.0, 0.12, 0), (10.0, 0.0, 0.5, 0.12, 0), (20.0, 4.0, 1.0, 1.5, 1)],
        events=[(0.0, "begins"), (20.0, "ends")],
    )
    return TrialResult(**{**values, **changes})


def fly(job):
    """Seed by seed: some crash, raise, cannot be reached, or fail; all others reach."""
    task = job.task or make_task(job.seed)
    if job.seed == UNREACHABLE and job.method == "oracle":
        return Answer(task, make_result(outcome="timeout", reason="no way", goal_error_m=3.0))
    if job.seed == CRASHES and job.method == "mapping":
        os.kill(os.getpid(), signal.SIGSEGV)
    if job.seed == RAISES and job.method == "mapping":
        raise ValueError("the planner is at a loss\nsecond line")
    if job.seed == FAILS and job.method != "oracle":
        return Answer(task, make_result(outcome="contact", reason="hit a wall", min_clearance_m=-0.01))
    energy_j = 1000.0 if job.method == "oracle" else 1500.0
    return Answer(task, make_result(energy_land_j=energy_j))


def fly_well(job):
    """Every flight reaches."""
    return Answer(job.task or make_task(job.seed), make_result())


def fly_slowly_and_tell(job):
    """Leaves a mark beside the run when it begins, then takes for ever from the third seed on."""
    Path(job.spec["marks"], f"{job.seed}-{job.method}").touch()
    if job.seed >= 2:
        signal.pause()
    return fly_well(job)


def settings(**changes):
    values = dict(
        bench="navigation",
        places=(Place("indoor", {"family": "indoor", "difficulty": 0.5}),),
        methods=("two-stage", "iplanner", "mapping", "oracle"),
        trials=4,
        seed=0,
        arguments=("--family", "indoor"),
    )
    return Settings(**{**values, **changes})


@dataclasses.dataclass
class Inline:
    """An executor without processes; `before` is called with each job and may raise."""

    work: object = fly_well
    before: object = None
    waiting: list = dataclasses.field(default_factory=list)
    flown: list = dataclasses.field(default_factory=list)
    closed: bool = False

    @property
    def free(self):
        return 2 - len(self.waiting)

    @property
    def busy(self):
        return len(self.waiting)

    def submit(self, job):
        self.waiting.append(job)

    def next_finished(self):
        job = self.waiting.pop(0)
        if self.before is not None:
            self.before(job)
        self.flown.append((job.place, job.seed, job.method))
        return attempt(self.work, job)

    def close(self):
        self.closed = True
