"""Real-time scheduling is asked for, given back, and not needed."""

import os
import subprocess
import sys
import threading

import pytest

from labr_autonomy.processes import keep_cores, on_time


def test_it_is_given_back_and_not_inherited():
    before = os.sched_getscheduler(0)
    with on_time() as granted:
        if not granted:
            pytest.skip("this user may not use SCHED_RR")
        assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_RR
        ask = [sys.executable, "-c", "import os; print(os.sched_getscheduler(0))"]
        child = subprocess.run(ask, capture_output=True, text=True, check=True)
        assert int(child.stdout) == os.SCHED_OTHER
    assert os.sched_getscheduler(0) == before


def test_without_permission_it_goes_on(monkeypatch):
    def denied(*_):
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", denied)
    with on_time() as granted:
        assert not granted


def test_the_other_threads_keep_their_cores_and_yield_to_the_set_points():
    found, asked = [], threading.Event()

    def run():
        asked.wait(10)
        policy = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
        found.append((policy, os.sched_getparam(0).sched_priority))

    thread = threading.Thread(target=run)
    thread.start()
    with on_time() as granted:
        count = keep_cores()
        own = os.sched_getparam(0).sched_priority
        asked.set()
        thread.join()
    if not granted:
        assert count == 0
        pytest.skip("this user may not use SCHED_RR")
    assert count >= 1
    assert found == [(os.SCHED_RR, own - 1)]
