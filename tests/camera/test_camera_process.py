from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from labr_autonomy.clock import SystemClock, pause_s
from labr_autonomy.config import Camera
from labr_autonomy.perception.frame_slot import FrameReader
from labr_autonomy.types import Pose
from sim.camera.process import CameraSpec
from sim.pose_slot import PoseSlotWriter

CAMERA = Camera(width=106, height=60, fx=53.0, fy=53.0, cx=53.0, cy=30.0)
COMMAND = [sys.executable, "-m", "sim.camera.process", "--spec"]
PARENT = """
import os, subprocess, sys
from dataclasses import replace
from labr_autonomy.clock import pause_s
from sim.camera.process import CameraSpec
spec = replace(CameraSpec.from_json(sys.argv[1]), parent_pid=os.getpid())
child = subprocess.Popen([sys.executable, "-m", "sim.camera.process", "--spec", spec.to_json()])
print(child.pid, flush=True)
while True:
    pause_s(0.1)
"""
QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


def until(condition, timeout_s=15.0):
    deadline = SystemClock().now_s() + timeout_s
    while not condition():
        assert SystemClock().now_s() < deadline
        pause_s(0.01)


def pose(x):
    return Pose(np.array([x, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0]))


def gone(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except FileNotFoundError:
        return True


@pytest.fixture
def spec(tmp_path):
    """A wall at x = 5, and names of this test's own; nothing of them may stay."""
    corners = np.array([[5, -50, -50], [5, 50, -50], [5, 50, 50], [5, -50, 50]], np.float32)
    np.savez(tmp_path / "wall.npz", V=corners, F=np.array([[0, 1, 2], [0, 2, 3]]))
    run = f"labr_test_{os.getpid()}_{tmp_path.name}"
    world = {"mesh": "wall.npz", "worlds_dir": str(tmp_path)}
    yield CameraSpec(world, f"{run}_pose", f"{run}_depth", CAMERA, noise=False)
    assert not list(Path("/dev/shm").glob(f"{run}_*"))


@pytest.mark.sitl
def test_frames_follow_the_pose_at_thirty_hertz_and_sigterm_ends_it_cleanly(spec):
    clock = SystemClock()
    poses = PoseSlotWriter(spec.pose_slot)
    poses.write(1.0, pose(0.0))
    child = subprocess.Popen([*COMMAND, spec.to_json()], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    reader = FrameReader(spec.frame_slot, timeout_s=15.0)
    until(lambda: reader.latest() is not None)
    frame = reader.latest()
    assert frame.stamp_s == 1.0
    assert np.abs(frame.depth_m - (5.0 - CAMERA.x_m)).max() < 0.002
    poses.write(2.5, pose(1.0))
    until(lambda: reader.latest().stamp_s == 2.5)
    assert np.abs(reader.latest().depth_m - (4.0 - CAMERA.x_m)).max() < 0.002
    first, begin_s = reader.newest_header()[0], clock.now_s()
    until(lambda: reader.newest_header()[0] >= first + 60)
    assert 1.8 < clock.now_s() - begin_s < 6.0  # 60 frames are 2 s; slower on a loaded machine, never faster
    child.terminate()
    said = child.communicate(timeout=10)[1].decode()
    assert child.returncode == 0
    assert "2 triangles" in said
    assert "resource_tracker" not in said
    reader.close()
    poses.close()


@pytest.mark.slow
def test_it_dies_with_its_parent_and_leaves_nothing(spec):
    poses = PoseSlotWriter(spec.pose_slot)
    poses.write(1.0, pose(0.0))
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT, spec.to_json()], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    with parent.stdout as said:
        child = int(said.readline())
    reader = FrameReader(spec.frame_slot, timeout_s=15.0)
    until(lambda: reader.latest() is not None)
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    until(lambda: gone(child), 5.0)
    until(lambda: not Path("/dev/shm", spec.frame_slot).exists(), 5.0)
    reader.close()
    poses.close()


@pytest.mark.slow
def test_a_parent_that_is_gone_already_ends_it_at_once(spec):
    orphan = CameraSpec.from_json(spec.to_json().replace('"parent_pid": null', '"parent_pid": 999999999'))
    assert subprocess.run([*COMMAND, orphan.to_json()], timeout=15, check=False, **QUIET).returncode == 0


@pytest.mark.slow
def test_a_world_that_is_absent_is_one_sentence_and_exit_code_2(spec, tmp_path):
    (tmp_path / "wall.npz").unlink()
    done = subprocess.run([*COMMAND, spec.to_json()], capture_output=True, text=True, timeout=15, check=False)
    assert done.returncode == 2
    assert "the world mesh 'wall.npz' is not in" in done.stderr
    assert "Traceback" not in done.stderr
