"""A log that was cut off at any place is made whole again and has lost less than a second."""

import json

import pytest
from click.testing import CliRunner
from mcap.reader import make_reader

from labr_autonomy.cli import main
from labr_autonomy.errors import BadInput
from labr_autonomy.record.flight_log import FlightLog
from labr_autonomy.record.mcap_reader import read_log, read_raw
from labr_autonomy.record.mcap_writer import FLUSH_S
from labr_autonomy.record.repair import repair, repair_run


@pytest.fixture
def run(tmp_path, monkeypatch):
    """A flight of 20 s, its chunks closed as often as in flight."""
    log = FlightLog(tmp_path / "flight.mcap", metadata={"mission": "m"})
    writer = log._writer
    written = writer._write
    flushed_s = [1000.0]

    def write(topic, stamp_s, body, also):
        written(topic, stamp_s, body, also)
        if stamp_s - flushed_s[0] >= FLUSH_S:
            writer._writer.flush()
            flushed_s[0] = stamp_s

    monkeypatch.setattr(writer, "_write", write)
    for i in range(1000):
        log.event(1000.0 + i / 50, f"event {i}")
    log.close()
    return tmp_path


def last_stamp_s(path):
    return max(m["stamp_s"] for topic, m in read_log(path) if topic == "/event")


@pytest.mark.parametrize("share", [0.3, 0.5, 0.77, 0.99, 0.9999])
def test_less_than_a_second_is_lost(run, share):
    path = run / "flight.mcap"
    data = path.read_bytes()
    stamps = sorted(m["stamp_s"] for topic, m in read_log(path) if topic == "/event")
    path.write_bytes(data[: int(len(data) * share)])
    readable_until_s = last_stamp_s(path)
    found = repair(path)
    assert not found.whole
    assert found.messages > 0
    assert last_stamp_s(path) == readable_until_s
    with path.open("rb") as stream:  # whole for every reader now, with an index
        summary = make_reader(stream).get_summary()
        assert summary.statistics.message_count == found.messages
        assert summary.chunk_indexes
    assert (run / "flight.mcap.torn").read_bytes() == data[: int(len(data) * share)]
    following = [s for s in stamps if s > readable_until_s]
    chunk_end_s = min([s for s in following if s >= readable_until_s + FLUSH_S], default=stamps[-1])
    assert chunk_end_s - readable_until_s <= 1.0


def test_a_whole_file_is_left_alone(run):
    before = (run / "flight.mcap").read_bytes()
    (found,) = repair_run(run)
    assert found.whole
    assert (run / "flight.mcap").read_bytes() == before
    assert not (run / "flight.mcap.torn").exists()


def test_a_log_that_was_just_opened_does_not_keep_the_others_from_repair(run):
    path = run / "flight.mcap"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    (run / "a-planner.mcap").write_bytes(b"")
    done = CliRunner().invoke(main, ["replay", str(run), "--repair"])
    assert done.exit_code == 0
    assert "flight.mcap: repaired" in done.output
    assert "a-planner.mcap: nothing in it can be read; it is put aside as a-planner.mcap.torn" in done.output
    assert [p.name for p in sorted(run.glob("*planner*"))] == ["a-planner.mcap.torn"]


def test_the_messages_are_the_same_after_repair(run):
    path = run / "flight.mcap"
    before = list(read_raw(path))
    path.write_bytes(path.read_bytes()[:-200])  # only the end is missing
    repair(path)
    assert list(read_raw(path)) == before


def test_the_command_repairs_and_says_what_is_left(run):
    path = run / "flight.mcap"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    done = CliRunner().invoke(main, ["replay", str(run), "--repair", "--json"])
    assert done.exit_code == 0
    (found,) = json.loads(done.stdout)["repaired"]
    assert found["file"] == "flight.mcap"
    assert found["messages"] > 0
    again = CliRunner().invoke(main, ["replay", str(run), "--repair"])
    assert "whole, nothing to repair" in again.output


def test_what_is_no_log_is_refused(tmp_path):
    with pytest.raises(BadInput, match="no MCAP file"):
        repair_run(tmp_path)
    (tmp_path / "a.mcap").write_bytes(b"hello, this is no log")
    with pytest.raises(BadInput, match="not an MCAP file"):
        repair_run(tmp_path)
    assert (tmp_path / "a.mcap").read_bytes() == b"hello, this is no log"
    assert not list(tmp_path.glob("*.part"))
