"""The planner's log gets to the disk without planning having to wait for it."""

import math
import os
import threading

import numpy as np
import pytest

from labr_autonomy.config import RobotConfig
from labr_autonomy.planner import recorder
from labr_autonomy.planner.messages import Motion, PlanRequest, PlanResult, Timings
from labr_autonomy.record.mcap_reader import read_raw
from labr_autonomy.types import Mode, Pose, Source

HERE = Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
STANDING = Motion(np.zeros(3), np.zeros(3), np.zeros(3), 0.0, 0.0, 0.0)
REQUEST = PlanRequest(1, 1, HERE, HERE, 0.0, STANDING, Mode.LAND, np.zeros(3), False, 0.0, 1.0)
RESULT = PlanResult(
    1, 99.9, None, None, None, Source.GKPN, math.nan, "", math.inf, False, True, True, Timings()
)  # fmt: skip


@pytest.fixture
def log(tmp_path, monkeypatch):
    monkeypatch.setattr(recorder, "FLUSH_S", -1.0)
    return recorder.PlannerLog(tmp_path / "planner.mcap", RobotConfig())


def test_what_was_flushed_is_put_on_the_disk_and_a_slow_disk_is_not_waited_for(log, tmp_path, monkeypatch):
    asked, answer = threading.Semaphore(0), threading.Event()

    def slow(_):
        asked.release()
        assert answer.wait(10.0)

    monkeypatch.setattr(os, "fdatasync", slow)
    log.cycle(REQUEST, None, RESULT)
    assert asked.acquire(timeout=5.0)
    for _ in range(20):  # would hang if it waited
        log.cycle(REQUEST, None, RESULT)
    assert not asked.acquire(blocking=False)  # nor does one request pile up behind the other
    answer.set()
    log.close()
    results = [topic for topic, _, _ in read_raw(tmp_path / "planner.mcap") if topic == recorder.RESULT]
    assert len(results) == 21


def test_a_disk_that_fails_ends_the_log_and_not_the_planning(log, monkeypatch, caplog):
    def failing(_):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "fdatasync", failing)
    log.cycle(REQUEST, None, RESULT)
    log._syncing.submit(int).result(5.0)  # the failing one is done
    log.cycle(REQUEST, None, RESULT)
    assert "planner.mcap has stopped: Input/output error" in caplog.text
    log.close()
