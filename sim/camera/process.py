"""The camera process: `python -m sim.camera.process --spec JSON`, or `run(spec)` in a process of its own.

It reads the true pose from the pose slot, renders, spoils the image as the camera would, and writes it
with the pose's stamp into the frame slot, at a steady rate. It ends on SIGTERM, and with its parent.

The spec is one JSON object: {"world": World.spec, "camera": config.Camera, "pose_slot": name,
"frame_slot": name, "seed": 0, "rate_hz": 30, "noise": true, "renderer": "auto", "parent_pid": pid or null,
"movers": [Mover.as_dict(), ...]}.
"""

from __future__ import annotations

import json
import logging
import signal
import sys
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from types import FrameType
from typing import Any

import numpy as np

from labr_autonomy.clock import SystemClock, pause_s
from labr_autonomy.config import Camera
from labr_autonomy.errors import BadInput, LabrError
from labr_autonomy.frames import rotation_matrix
from labr_autonomy.perception.frame_slot import FrameWriter
from labr_autonomy.processes import die_with_parent
from labr_autonomy.types import Array, Image, Pose
from sim.camera.noise import D435i, flawed_depth
from sim.camera.renderer import Renderer, make_renderer
from sim.movers.mover import Mover, Placed
from sim.pose_slot import PoseSlotReader
from sim.worlds.build import rebuild_world

log = logging.getLogger("labr.sim.camera")

_REPORT_S = 10.0
_POSE_WAIT_S = 30.0


@dataclass(frozen=True, slots=True)
class CameraSpec:
    """What the camera process is told."""

    world: dict[str, Any]
    pose_slot: str
    frame_slot: str
    camera: Camera = field(default_factory=Camera)
    seed: int = 0
    rate_hz: float = 30.0
    noise: bool = True
    renderer: str = "auto"
    parent_pid: int | None = None  # who must be alive; None for nobody
    movers: tuple[dict[str, Any], ...] = ()  # Mover.as_dict of each; the pose slot says where they are

    def to_json(self) -> str:
        """One line for the command line."""
        values = {name: getattr(self, name) for name in self.__slots__}
        return json.dumps({**values, "camera": self.camera.model_dump()})

    @staticmethod
    def from_json(text: str) -> CameraSpec:
        """The value that `to_json` wrote."""
        try:
            values = {**json.loads(text)}
            known = {"camera": Camera(**values.get("camera", {})), "movers": tuple(values.get("movers", ()))}
            return CameraSpec(**{**values, **known})
        except (TypeError, ValueError) as error:
            raise BadInput(
                f"the camera's spec cannot be read: {error}", "Give CameraSpec.to_json()."
            ) from error


def camera_pose(pose: Pose, camera: Camera) -> Array:
    """(4, 4) camera-FLU to odom for a pose of the body."""
    T_odom_camera = np.eye(4)
    turn = rotation_matrix(pose.quaternion)
    T_odom_camera[:3, :3] = turn
    T_odom_camera[:3, 3] = pose.position_m + turn @ np.array([camera.x_m, 0.0, camera.z_m])
    return T_odom_camera


class Eye:
    """Body pose to depth image: renderer and flaws together.

    Args:
        renderer: Ideal depth.
        camera: The camera and its place on the body.
        seed: Of the noise; each frame adds its number.
        noise: False for ideal images within the range.
    """

    def __init__(self, renderer: Renderer, camera: Camera, *, seed: int = 0, noise: bool = True) -> None:
        self._renderer, self._camera, self._seed, self._noise = renderer, camera, seed, noise
        self._flaws = D435i(range_min_m=camera.range_min_m, range_max_m=camera.range_max_m)
        self._frames = 0

    def look(self, pose: Pose, movers: Sequence[Placed] = ()) -> Image:
        """Depth image (h, w) [m] from a true pose of the body, with movers where they are; 0 = invalid."""
        depth_m = self._renderer.depth(camera_pose(pose, self._camera), movers)
        self._frames += 1
        if not self._noise:
            near = depth_m < np.float32(self._camera.range_min_m)
            depth_m[near] = 0.0
            return depth_m
        return flawed_depth(depth_m, self._camera.intrinsics, (self._seed << 32) + self._frames, self._flaws)


class _Stop:
    """Set by SIGTERM."""

    def __init__(self) -> None:
        self.asked = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.asked = True


def run(spec: CameraSpec) -> None:
    """Take pictures until SIGTERM; the body of the camera process."""
    if spec.parent_pid is not None:
        die_with_parent(parent_pid=spec.parent_pid)
    stop = _Stop()
    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the executive's; the simulator core ends us
    world = rebuild_world(spec.world)
    movers = [Mover.from_dict(values) for values in spec.movers]
    camera = spec.camera
    renderer = make_renderer(world, camera.intrinsics, camera.range_max_m, kind=spec.renderer)
    log.info("camera: %s, world %s, %d triangles", renderer.kind, world.name, len(world.faces))
    eye = Eye(renderer, camera, seed=spec.seed, noise=spec.noise)
    poses = PoseSlotReader(spec.pose_slot, timeout_s=_POSE_WAIT_S)
    writer = FrameWriter(spec.frame_slot, camera.intrinsics)
    try:
        _loop(stop, eye, poses, movers, writer, 1.0 / spec.rate_hz)
    finally:
        writer.close()
        poses.close()
        renderer.close()


def _loop(
    stop: _Stop,
    eye: Eye,
    poses: PoseSlotReader,
    movers: Sequence[Mover],
    writer: FrameWriter,
    period_s: float,
) -> None:
    """One picture a period: due = start + k * period; periods that were missed are skipped."""
    clock = SystemClock()
    due_s = reported_s = clock.now_s()
    times_s: deque[float] = deque(maxlen=int(_REPORT_S / period_s) + 1)
    skipped = 0
    while not stop.asked:
        begin_s = clock.now_s()
        found = poses.latest_whole()
        if found is not None:
            stamp_s, pose, along_m = found
            placed = [mover.at(along) for mover, along in zip(movers, along_m, strict=True)]
            writer.write(stamp_s, eye.look(pose, placed))
            times_s.append(clock.now_s() - begin_s)
        now_s = clock.now_s()
        if now_s - reported_s >= _REPORT_S and times_s:
            p50, p99 = np.percentile(np.array(times_s), [50, 99]) * 1e3
            log.info("camera: frame p50 %.1f ms, p99 %.1f ms, %d periods missed", p50, p99, skipped)
            reported_s = now_s
        missed = int((now_s - due_s) / period_s)
        skipped += missed
        due_s += (missed + 1) * period_s
        pause_s(due_s - now_s)


def main() -> int:
    """Entry of `python -m sim.camera.process`."""
    import argparse

    parser = argparse.ArgumentParser(prog="sim.camera.process", description="Depth camera of the simulator.")
    parser.add_argument("--spec", required=True, help="CameraSpec as JSON")
    arguments = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(name)s %(levelname)s %(message)s")
    try:
        run(CameraSpec.from_json(arguments.spec))
    except LabrError as error:
        log.error("%s", error)
        return int(error.exit_code)
    return 0


if __name__ == "__main__":
    sys.exit(main())
