from __future__ import annotations

import os
from pathlib import Path

import bench_fakes as fakes
import pytest

from labr_autonomy.errors import BadInput
from sim.bench import cluster
from sim.bench.jobs import Job

HERE = str(Path(__file__).parent)


def test_without_ray_the_sentence_says_how_to_get_it(monkeypatch):
    monkeypatch.setattr(cluster, "find_spec", lambda _: None)
    with pytest.raises(BadInput, match=r"Ray is not installed.*pip install labr-autonomy\[cluster\]"):
        cluster.RayExecutor(fakes.fly, "local")


def test_an_address_of_another_form_is_bad_input():
    with pytest.raises(BadInput, match=r"'10\.0\.0\.1' is no address of a cluster"):
        cluster.RayExecutor(fakes.fly, "10.0.0.1")


@pytest.mark.slow
@pytest.mark.timeout(120)
@pytest.mark.filterwarnings("ignore")  # Ray's own, in what it imports
def test_a_local_cluster_flies_and_survives_a_worker(monkeypatch):
    pytest.importorskip("ray", reason="the extra [cluster] is optional; without it there is nothing to test")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([*os.environ.get("PYTHONPATH", "").split(), HERE]))
    executor = cluster.RayExecutor(fakes.fly, "local", jobs=1)
    try:
        done = {}
        for seed, method in (
            (0, "oracle"),
            (fakes.RAISES, "mapping"),
            (fakes.CRASHES, "mapping"),
            (1, "oracle"),
        ):
            assert executor.free
            executor.submit(Job("indoor", {}, seed, method))
            done[seed] = executor.next_finished()
    finally:
        executor.close()
    assert done[0].answer == fakes.fly(Job("indoor", {}, 0, "oracle"))
    assert done[1].answer is not None
    assert done[fakes.RAISES].error == "ValueError: the planner is at a loss"
    assert done[fakes.CRASHES].answer is None
    assert "died" in done[fakes.CRASHES].error
