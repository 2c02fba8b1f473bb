import os
from pathlib import Path

import numpy as np
import pytest

from labr_autonomy.console import names
from labr_autonomy.console.map_slot import CELLS_MAX, MapReader, MapWriter
from labr_autonomy.console.slot import JsonReader, JsonWriter
from labr_autonomy.errors import BadInput, LinkError
from labr_autonomy.perception import shared_ring


@pytest.fixture
def name(request):
    return f"labr_test_{os.getpid()}_{abs(hash(request.node.name)) % 10_000}"


def test_the_newest_state_is_seen_and_a_slow_reader_misses_the_rest(name):
    writer = JsonWriter(name, {"mission": "m"}, 1000, 4)
    try:
        reader = JsonReader(name)
        assert reader.meta == {"mission": "m"}
        assert reader.newest() is None
        for i in range(100):
            writer.write({"i": i})
        assert reader.newest()[1] == {"i": 99}
        reader.close()
    finally:
        writer.close()


def test_requests_come_once_each_and_in_order(name):
    writer = JsonWriter(name, {}, 1000, 8)
    try:
        writer.write({"i": 0})
        reader = JsonReader(name)
        assert reader.since() == [{"i": 0}]
        assert reader.since() == []
        for i in range(1, 6):
            writer.write({"i": i})
        assert [m["i"] for m in reader.since()] == [1, 2, 3, 4, 5]
        for i in range(20):
            writer.write({"i": i})
        assert [m["i"] for m in reader.since()] == list(range(12, 20))  # what the ring still held
        reader.close()
    finally:
        writer.close()


def test_a_message_that_does_not_fit_is_an_error_and_not_a_torn_one(name):
    writer = JsonWriter(name, {}, 20, 4)
    try:
        with pytest.raises(BadInput, match="slot of 20"):
            writer.write({"text": "x" * 50})
    finally:
        writer.close()


def test_a_slot_of_another_user_is_not_obeyed(name, monkeypatch):
    writer = JsonWriter(name, {}, 100, 4)
    try:
        monkeypatch.setattr(os, "getuid", lambda: 12345)
        with pytest.raises(LinkError, match="belongs to user"):
            JsonReader(name)
    finally:
        writer.close()


def test_a_slot_that_another_user_puts_in_place_of_ours_is_not_obeyed(name, monkeypatch):
    writer = JsonWriter(name, {}, 100, 4)
    writer.write({"i": 1})
    reader = JsonReader(name)
    assert reader.since() == [{"i": 1}]
    writer.close()  # the console ends; its name is free
    theirs = JsonWriter(name, {}, 100, 4)
    for _ in range(2):  # numbers go on from the clock's milliseconds, and these slots may be of one
        theirs.write({"i": 2})
    monkeypatch.setattr(shared_ring, "_STALE_S", -1.0)
    monkeypatch.setattr(os, "getuid", lambda: 12345)
    assert reader.since() == []
    monkeypatch.undo()
    monkeypatch.setattr(shared_ring, "_STALE_S", -1.0)
    assert reader.since()[-1] == {"i": 2}  # a console of ours that was started anew
    reader.close()
    theirs.close()


def test_a_slot_in_place_of_ours_that_cannot_be_opened_is_no_news_and_no_error(name, monkeypatch):
    writer = JsonWriter(name, {}, 100, 4)
    writer.write({"i": 1})
    reader = JsonReader(name)
    reader.since()
    writer.close()
    file = Path("/dev/shm") / name
    file.mkdir()  # opening it fails, also for root
    monkeypatch.setattr(shared_ring, "_STALE_S", -1.0)
    try:
        assert reader.since() == []
    finally:
        file.rmdir()
        reader.close()


def test_a_second_console_of_one_flight_is_refused(name):
    writer = JsonWriter(name, {}, 100, 4)
    try:
        with pytest.raises(LinkError, match="being written by process"):
            JsonWriter(name, {}, 100, 4)
    finally:
        writer.close()


def test_the_map_comes_across_and_a_large_one_is_thinned(name):
    writer = MapWriter(name)
    try:
        cells = np.random.default_rng(1).normal(size=(500, 2)).astype(np.float32)
        trail = np.array([[0, 0, 0.1, 0], [1, 0, 1.2, 1]], np.float32)
        writer.write(cells, trail)
        reader = MapReader(name)
        view = reader.newer(0)
        assert np.array_equal(view.cells_m, cells)
        assert np.array_equal(view.trail_m, trail)
        assert reader.newer(view.number) is None
        writer.write(np.zeros((3 * CELLS_MAX, 2), np.float32), trail)
        assert len(reader.newer(view.number).cells_m) == CELLS_MAX
        reader.close()
    finally:
        writer.close()


def test_a_flight_that_ends_while_it_is_looked_for_is_none(tmp_path, monkeypatch):
    (tmp_path / names.state_slot(os.getpid())).symlink_to(tmp_path / "gone")
    monkeypatch.setattr(names, "_FOLDER", tmp_path)
    assert names.running() == []


def test_only_flights_that_run_are_found():
    writer = JsonWriter(names.state_slot(os.getpid()), {}, 100, 4)
    try:
        assert os.getpid() in names.running()
    finally:
        writer.close()
    assert os.getpid() not in names.running()
