"""Real-time scheduling is asked for, given back, and not needed."""

import os
import subprocess
import sys
import threading

import pytest

from labr_autonomy.processes import keep_core, on_time


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


def test_a_thread_beside_the_set_points_keeps_its_core_and_yields_to_them():
    found = []

    def run():
        keep_core()
        found.append(
            (os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK, os.sched_getparam(0).sched_priority)
        )

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    with on_time() as granted:
        if not granted:
            pytest.skip("this user may not use SCHED_RR")
        assert found == [(os.SCHED_RR, os.sched_getparam(0).sched_priority - 1)]
