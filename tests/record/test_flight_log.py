from __future__ import annotations

import io
import math
import os
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest
from mcap.reader import make_reader

from labr_autonomy.config import Camera
from labr_autonomy.errors import BadInput
from labr_autonomy.record import foxglove, mcap_writer
from labr_autonomy.record.depth_png import decode_depth, encode_depth
from labr_autonomy.record.flight_log import FlightLog
from labr_autonomy.record.mcap_reader import read_log
from labr_autonomy.record.mcap_writer import McapWriter
from labr_autonomy.record.topics import TOPICS
from labr_autonomy.types import DepthFrame, Intrinsics, Pose

POSE = Pose(np.zeros(3), np.array([1.0, 0, 0, 0]))


def texts(path):
    return [m["text"] for topic, m in read_log(path) if topic == "/event"]


def test_every_topic_comes_back_and_fits_its_schema(whole_run):
    seen = {}
    for topic, message in read_log(whole_run / "flight.mcap"):
        seen[topic] = seen.get(topic, 0) + 1
        schema = TOPICS[topic]
        assert schema.get("additionalProperties") or set(message) <= set(schema["properties"]), topic
        assert set(schema["required"]) <= set(message)
    assert set(seen) == set(TOPICS) - {"/recorder"}
    assert seen["/odometry"] == 600


def test_other_readers_find_an_index_and_schemas(whole_run):
    with (whole_run / "flight.mcap").open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert {c.topic for c in summary.channels.values()} == set(TOPICS) | set(foxglove.TOPICS)
        assert {s.encoding for s in summary.schemas.values()} == {"jsonschema", "protobuf"}
        assert sum(1 for _ in reader.iter_messages(topics=["/setpoint"])) == 600


def test_log_time_is_utc_and_the_stamp_stays_monotonic(tmp_path, monkeypatch):
    class Clock:
        def now_s(self):
            return 50.0

    monkeypatch.setattr(mcap_writer, "utc_s", lambda: 1_000_050.0)
    with FlightLog(tmp_path / "a.mcap", clock=Clock()) as log:
        log.event(51.5, "x")
    with (tmp_path / "a.mcap").open("rb") as stream:
        (_, _, message) = next(iter(make_reader(stream).iter_messages()))
    assert message.log_time == 1_000_051_500_000_000
    assert b'"stamp_s":51.5' in message.data


def test_a_torn_file_is_read_up_to_the_tear(whole_run, tmp_path):
    raw = (whole_run / "flight.mcap").read_bytes()
    whole = sum(1 for _ in read_log(whole_run / "flight.mcap"))
    counts = []
    for share in (0.999, 0.8, 0.5, 0.3):
        torn = tmp_path / "torn.mcap"
        torn.write_bytes(raw[: int(len(raw) * share)])
        counts.append(sum(1 for _ in read_log(torn)))
    assert counts[0] == whole  # only the index is gone
    assert counts == sorted(counts, reverse=True)


@pytest.mark.parametrize("raw", [b"", b"not a log", b"\x89MCAP0\r\n"[:5]])
def test_what_is_no_log_is_bad_input(tmp_path, raw):
    path = tmp_path / "x.mcap"
    path.write_bytes(raw)
    with pytest.raises(BadInput, match="not an MCAP file"):
        list(read_log(path))


def test_an_absent_log_is_bad_input(tmp_path):
    with pytest.raises(BadInput, match="cannot be read"):
        list(read_log(tmp_path / "absent.mcap"))


KILLED = """
import sys
from labr_autonomy.clock import SystemClock, pause_s
from labr_autonomy.record.flight_log import FlightLog
from pathlib import Path
clock = SystemClock()
log = FlightLog(Path(sys.argv[1]))
begin_s = clock.now_s()
while True:
    age_s = clock.now_s() - begin_s
    log.event(clock.now_s(), f"{age_s:.3f}")
    print(f"{age_s:.3f}", flush=True)
    pause_s(0.02)
"""


@pytest.mark.slow
def test_a_kill_loses_less_than_a_second(tmp_path):
    path = tmp_path / "killed.mcap"
    process = subprocess.Popen([sys.executable, "-c", KILLED, str(path)], stdout=subprocess.PIPE, text=True)
    last_s = 0.0
    while last_s < 2.0:
        last_s = float(process.stdout.readline())
    os.kill(process.pid, signal.SIGKILL)
    last_s = max([last_s, *(float(line) for line in process.stdout.read().split("\n") if len(line) >= 5)])
    process.wait()
    process.stdout.close()
    kept = texts(path)
    assert float(kept[-1]) > last_s - 1.0
    assert len(kept) > 40


def test_a_full_queue_drops_the_oldest_counts_them_and_never_waits(tmp_path, monkeypatch):
    gate = threading.Event()
    real = McapWriter._write

    def held(self, *entry):
        gate.wait(10)
        real(self, *entry)

    monkeypatch.setattr(McapWriter, "_write", held)
    log = FlightLog(tmp_path / "a.mcap", queue_max=10)
    for i in range(100):
        log.event(float(i), str(i))
    gate.set()
    log.close()
    kept = texts(tmp_path / "a.mcap")
    assert kept[-10:] == [str(i) for i in range(90, 100)]
    assert log.dropped == 100 - len(kept)
    assert [m["dropped"] for topic, m in read_log(tmp_path / "a.mcap") if topic == "/recorder"][
        -1
    ] == log.dropped


def test_after_closing_entries_are_counted_as_lost_and_close_may_be_repeated(tmp_path):
    log = FlightLog(tmp_path / "a.mcap")
    log.close()
    log.event(1.0, "late")
    log.close()
    assert log.dropped == 1
    assert texts(tmp_path / "a.mcap") == []


def test_a_full_disk_ends_the_log_not_the_flight(tmp_path):
    log = FlightLog(tmp_path / "a.mcap")

    class Full(io.BytesIO):
        def write(self, _):
            raise OSError(28, "No space left on device")

    log._writer._writer._Writer__stream = Full()
    log.event(1.0, "x")
    log.close()
    assert "No space left" in log.fault


def test_a_folder_that_is_not_there_is_bad_input(tmp_path):
    with pytest.raises(BadInput, match="cannot be written"):
        FlightLog(tmp_path / "absent" / "a.mcap")


def test_unknown_figures_are_null_not_nan(tmp_path):
    with FlightLog(tmp_path / "a.mcap") as log:
        log.link_ages(1.0, {"air": math.inf, "ground": np.float64(0.5)})
        log.event(1.0, "x", metres=math.nan)
    messages = dict(read_log(tmp_path / "a.mcap"))
    assert messages["/link_ages"]["ages_s"] == {"air": None, "ground": 0.5}
    assert messages["/event"]["figures"] == {"metres": None}


def test_depth_survives_to_the_millimetre_and_is_thinned_in_time(tmp_path):
    depth = np.linspace(0, 9, 24, dtype=np.float32).reshape(4, 6)
    depth[0, 0], depth[0, 1] = np.nan, np.inf
    with FlightLog(tmp_path / "a.mcap", depth_period_s=0.5) as log:
        taken = [
            log.depth(DepthFrame(i, i * 0.2, depth, Intrinsics(6, 4, 5, 5, 3, 2)), POSE, Camera())
            for i in range(6)
        ]
    assert taken == [True, False, False, True, False, False]
    messages = [m for topic, m in read_log(tmp_path / "a.mcap") if topic == "/depth"]
    assert [m["sequence"] for m in messages] == [0, 3]
    back = decode_depth(messages[0])
    assert back[0, 0] == back[0, 1] == 0.0
    np.testing.assert_allclose(back[1:], depth[1:], atol=6e-4)


def test_depth_beyond_sixteen_bits_is_clipped():
    assert encode_depth(np.full((2, 2), 500.0, np.float32))[:4] == b"\x89PNG"


def test_what_was_flushed_is_on_the_disk(tmp_path, monkeypatch):
    path = tmp_path / "a.mcap"
    synced = threading.Event()
    real = os.fdatasync

    def noticed(number):
        real(number)
        if texts(path) == ["first"]:  # readable by others at the moment it is asked for
            synced.set()

    monkeypatch.setattr(os, "fdatasync", noticed)
    monkeypatch.setattr(mcap_writer, "FLUSH_S", 0.05)
    with FlightLog(path) as log:
        log.event(1.0, "first")
        assert synced.wait(10)
