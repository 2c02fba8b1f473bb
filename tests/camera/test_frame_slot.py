from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from labr_autonomy.clock import SystemClock, pause_s
from labr_autonomy.errors import BadInput, LinkError
from labr_autonomy.perception import shared_ring
from labr_autonomy.perception.frame_slot import SLOTS, FrameReader, FrameWriter
from labr_autonomy.types import Intrinsics, Pose
from sim.pose_slot import PoseSlotReader, PoseSlotWriter

CAMERA = Intrinsics(12, 8, 6.0, 6.5, 5.5, 3.5)
WRITER = """
import sys, numpy as np
from labr_autonomy.clock import pause_s
from labr_autonomy.perception.frame_slot import FrameWriter
from labr_autonomy.types import Intrinsics
writer = FrameWriter(sys.argv[1], Intrinsics(12, 8, 6.0, 6.5, 5.5, 3.5))
writer.write(1.0, np.full((8, 12), float(sys.argv[2]), np.float32))
print("ready", flush=True)
while True:
    pause_s(0.05)
"""
READER = """
import sys
from labr_autonomy.perception.frame_slot import FrameReader
print(FrameReader(sys.argv[1]).latest().depth_m[0, 0])
"""


@pytest.fixture
def name(request):
    name = f"labr_test_{os.getpid()}_{abs(hash(request.node.name)) % 10**8}"
    yield name
    assert not Path("/dev/shm", name).exists()


def image(value):
    return np.full((8, 12), value, np.float32)


def until(condition, timeout_s=10.0):
    deadline = SystemClock().now_s() + timeout_s
    while not condition():
        assert SystemClock().now_s() < deadline
        pause_s(0.01)


def start_writer(name, value):
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, name, str(value)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    assert writer.stdout.readline() == b"ready\n"
    return writer


def test_a_frame_arrives_to_the_millimetre_with_stamp_and_camera(name):
    writer, reader = FrameWriter(name, CAMERA), FrameReader(name)
    assert reader.latest() is None
    assert reader.newest_header() is None
    depth = np.linspace(0.3, 9.9, 96, dtype=np.float32).reshape(8, 12)
    sequence = writer.write(12.25, depth)
    frame = reader.latest()
    assert (frame.sequence, frame.stamp_s, frame.intrinsics) == (sequence, 12.25, CAMERA)
    assert frame.depth_m.dtype == np.float32
    assert np.abs(frame.depth_m - depth).max() < 0.00051
    assert reader.newest_header() == (sequence, 12.25)
    reader.close()
    writer.close()


def test_what_is_no_distance_arrives_as_invalid(name):
    writer, reader = FrameWriter(name, CAMERA), FrameReader(name)
    depth = image(1.0)
    depth[0, :5] = [np.nan, np.inf, -1.0, 66.0, 0.0]
    writer.write(0.0, depth)
    got = reader.latest().depth_m
    assert (got[0, :5] == 0.0).all()
    assert (got.ravel()[5:] == 1.0).all()
    reader.close()
    writer.close()


def test_the_ring_keeps_the_last_frames_only(name):
    writer, reader = FrameWriter(name, CAMERA), FrameReader(name)
    sequences = [writer.write(float(i), image(i + 1)) for i in range(SLOTS + 2)]
    assert [reader.get(s) is None for s in sequences] == [True, True] + [False] * SLOTS
    for i, s in enumerate(sequences[2:], start=2):
        frame = reader.get(s)
        assert (frame.sequence, frame.stamp_s, frame.depth_m[0, 0]) == (s, float(i), i + 1)
    assert reader.get(sequences[-1] + 1) is None
    assert reader.get(0) is None
    assert reader.get(-3) is None
    reader.close()
    writer.close()


def test_a_slot_being_overwritten_is_not_returned(name, monkeypatch):
    writer, reader = FrameWriter(name, CAMERA), FrameReader(name)
    first = writer.write(0.0, image(1.0))
    inner = reader._ring._map

    class Racing:
        """A mapping on which the writer laps the reader while it copies."""

        def __getitem__(self, at):
            copied = inner[at]
            for i in range(SLOTS):
                writer.write(float(i), image(2.0))
            return copied

    monkeypatch.setattr(reader._ring, "_map", Racing())
    assert reader.get(first) is None
    assert reader.latest() is None  # three tries, all lapped: no waiting
    monkeypatch.setattr(reader._ring, "_map", inner)
    assert reader.latest().depth_m[0, 0] == 2.0
    reader.close()
    writer.close()


def test_a_death_in_the_middle_of_a_frame_leaves_the_frame_before(name):
    writer, reader = FrameWriter(name, CAMERA), FrameReader(name)
    sequence = writer.write(3.0, image(1.0))
    with pytest.raises(TypeError):
        writer._ring.write(b"half a frame", "dead")
    assert reader.latest().sequence == sequence
    assert reader.get(sequence + 1) is None
    reader.close()
    writer.close()


def test_wrong_shape_and_wrong_name_are_said(name):
    writer = FrameWriter(name, CAMERA)
    with pytest.raises(BadInput, match=r"\(3, 3\)"):
        writer.write(0.0, np.ones((3, 3), np.float32))
    writer.close()
    for bad in ("", "a/b", "../x", ".hidden", "x" * 201):
        with pytest.raises(BadInput, match="cannot name"):
            FrameWriter(bad, CAMERA)


def test_a_reader_without_writer_gives_up_at_its_deadline(name):
    begin_s = SystemClock().now_s()
    with pytest.raises(LinkError, match="no depth frames"):
        FrameReader(name, timeout_s=0.05)
    assert 0.05 <= SystemClock().now_s() - begin_s < 2.0


@pytest.mark.slow
def test_a_reader_that_comes_early_waits(name):
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, name, "2"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    reader = FrameReader(name, timeout_s=15.0)
    until(lambda: reader.latest() is not None)
    assert reader.latest().depth_m[0, 0] == 2.0
    reader.close()
    writer.kill()
    writer.wait()
    until(lambda: not Path("/dev/shm", name).exists())


def test_a_living_writer_is_not_pushed_aside(name):
    writer = FrameWriter(name, CAMERA)
    with pytest.raises(LinkError, match=str(os.getpid())):
        FrameWriter(name, CAMERA)
    writer.close()
    with pytest.raises(LinkError, match="closed"):
        writer.write(0.0, image(1.0))
    writer.close()


@pytest.mark.slow
def test_a_killed_writer_leaves_nothing_and_its_successor_takes_over(name, monkeypatch):
    monkeypatch.setattr(shared_ring, "_STALE_S", 0.05)
    first = start_writer(name, 1)
    reader = FrameReader(name)
    before = reader.latest()
    first.send_signal(signal.SIGKILL)
    first.wait()
    first.stdout.close()
    assert reader.latest().sequence == before.sequence  # nothing new, nothing broken
    until(lambda: not Path("/dev/shm", name).exists())
    second = FrameWriter(name, CAMERA)
    second.write(2.0, image(5.0))
    until(lambda: reader.latest().depth_m[0, 0] == 5.0)
    assert reader.latest().sequence > before.sequence
    reader.close()
    second.close()


def test_the_block_of_a_dead_writer_is_replaced(name):
    Path("/dev/shm", name).write_bytes(b"left behind")
    writer = FrameWriter(name, CAMERA)
    writer.write(0.0, image(1.0))
    assert FrameReader(name).latest().depth_m[0, 0] == 1.0
    writer.close()


@pytest.mark.slow
def test_a_reader_that_ends_takes_nothing_with_it(name):
    writer = FrameWriter(name, CAMERA)
    writer.write(0.0, image(4.0))
    done = subprocess.run([sys.executable, "-c", READER, name], capture_output=True, text=True, check=True)
    assert (done.stdout.strip(), done.stderr) == ("4.0", "")
    assert Path("/dev/shm", name).exists()
    writer.close()


def test_the_pose_slot_gives_the_newest_pose(name):
    writer, reader = PoseSlotWriter(name), PoseSlotReader(name)
    assert reader.latest() is None
    for i in range(20):
        writer.write(float(i), Pose(np.array([i, 2.0, 3.0]), np.array([0.5, 0.5, -0.5, 0.5])))
    stamp_s, pose = reader.latest()
    assert stamp_s == 19.0
    assert pose.position_m.tolist() == [19.0, 2.0, 3.0]
    assert pose.quaternion.tolist() == [0.5, 0.5, -0.5, 0.5]
    reader.close()
    with pytest.raises(LinkError, match="closed"):
        reader.latest()
    writer.close()
