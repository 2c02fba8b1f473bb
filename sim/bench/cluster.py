"""Flights on a Ray cluster. Optional: `pip install labr-autonomy[cluster]`, on the cluster's machines too."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

from labr_autonomy.errors import BadInput, LinkError
from labr_autonomy.processes import LEAN
from sim.bench.executors import Finished, attempt, failure
from sim.bench.jobs import Job, Work

LOCAL = "local"


class RayExecutor:
    """One Ray task of one CPU for each flight.

    Args:
        work: What to do with a job; importable by name on the cluster.
        address: `ray://host:port`, or `local` for a cluster that begins and ends with this command.
        jobs: How many at once, and the CPUs of a local cluster; by default as many CPUs as the cluster has.

    Raises:
        BadInput: when Ray is not installed or the address is of no known form.
        LinkError: when the cluster does not answer.
    """

    def __init__(self, work: Work, address: str, jobs: int | None = None) -> None:
        if address != LOCAL and not address.startswith("ray://"):
            raise BadInput(
                f"'{address}' is no address of a cluster", "Say --cluster ray://host:port or local"
            )
        if find_spec("ray") is None:
            raise BadInput("Ray is not installed", "Install it by: pip install labr-autonomy[cluster]")
        import ray

        self._ray = ray
        common: dict[str, Any] = {"runtime_env": {"env_vars": LEAN}, "logging_level": "warning"}
        try:
            if address == LOCAL:
                ray.init(num_cpus=jobs, include_dashboard=False, log_to_driver=False, **common)
            else:
                ray.init(address=address, log_to_driver=False, **common)
        except (ConnectionError, RuntimeError, TimeoutError) as error:
            raise LinkError(
                f"the cluster {address} does not answer: {error}",
                "Check the address, and that Ray is the same",
            ) from None
        self._slots = jobs or max(1, int(ray.cluster_resources().get("CPU", 1)))
        self._remote = ray.remote(num_cpus=1, max_retries=0)(attempt)
        self._work = work
        self._running: dict[Any, Job] = {}

    @property
    def free(self) -> int:
        """How many jobs it takes at once now."""
        return self._slots - len(self._running)

    @property
    def busy(self) -> int:
        """How many jobs it works on."""
        return len(self._running)

    def submit(self, job: Job) -> None:
        """Begin a job."""
        self._running[self._remote.remote(self._work, job)] = job

    def next_finished(self) -> Finished:
        """Wait for the next job to end."""
        (reference,), _ = self._ray.wait(list(self._running), num_returns=1)
        job = self._running.pop(reference)
        try:
            finished: Finished = self._ray.get(reference)
        except self._ray.exceptions.RayTaskError as error:  # before `attempt`: the code is not there
            return failure(job, error.cause)
        except self._ray.exceptions.WorkerCrashedError as error:
            return Finished(job, None, "the worker process died", str(error))
        except self._ray.exceptions.RayError as error:  # its machine has gone, or the cluster
            return failure(job, error)
        return finished

    def close(self) -> None:
        """Cancel what still runs and leave the cluster."""
        for reference in self._running:
            self._ray.cancel(reference, force=True)
        self._running.clear()
        self._ray.shutdown()
