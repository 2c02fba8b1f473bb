"""Shards from recordings in iPlanner's own layout, so that its data can train our network as well.

Goals are later poses of the same recording, as it takes them; all on land, for it knows nothing of the air.
Its floor is flat at z = 0, and it drives at the height of its poses.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from labr_autonomy.config import Body, Camera, RobotConfig
from labr_autonomy.errors import BadInput
from labr_autonomy.frames import odom_to_level, quaternion_from_rpy
from labr_autonomy.gkpn.local_map import local_map
from labr_autonomy.gkpn.resample import network_image
from labr_autonomy.gkpn.shards import FAR_CM, LAND_CELL_M, LAND_SIDE, NO_FLOOR, Shard
from labr_autonomy.perception.rolling_map import RollingMap
from labr_autonomy.types import Array, DepthFrame, Image, Pose
from sim.training_data.build import SceneConfig
from sim.training_data.fields import centimetres
from sim.training_data.goals import LAND_BLOCKED_M, STEP_M
from sim.training_data.iplanner_recording import Recording, find_recordings, poses_in, read_recording

AHEAD, AHEAD_STEP = 1, 5  # a goal lies this many poses later, and each further one so many more
GOAL_MIN_M = 0.3  # nearer poses are no goal
FLOOR_Z_M = 0.0


@dataclass(frozen=True, slots=True)
class RecordingJob:
    """A stretch of one recording."""

    folder: Path
    first: int
    config: SceneConfig

    @property
    def file(self) -> str:
        """Its name in the folder of shards."""
        return f"{self.folder.name}-{self.first:06d}.npz"

    def make(self) -> Shard:
        """Make it; `BadInput` where the recording cannot be used or the robot stood still."""
        return convert(read_recording(self.folder), self.first, self.config)


def recording_jobs(folder: Path, config: SceneConfig) -> tuple[list[RecordingJob], dict[str, Any]]:
    """All stretches of the recordings of a folder, and the settings for its manifest."""
    jobs = []
    for path in find_recordings(folder.resolve()):
        jobs += [RecordingJob(path, i, config) for i in range(0, len(poses_in(path)) - 1, config.views)]
    if not jobs:
        raise BadInput(f"the recordings in {folder} have less than two poses", "Record a drive.")
    names = sorted({job.folder.name for job in jobs})
    return jobs, {"kind": "iplanner", "recordings": names, **asdict(config)}


def convert(recording: Recording, first: int, config: SceneConfig) -> Shard:
    """The shard of the pictures from `first` on.

    Args:
        recording: It.
        first: Number of the first picture.
        config: How many pictures and goals, and the network's image.

    Raises:
        BadInput: when no pose of it is far enough from the others.
    """
    robot = RobotConfig(camera=Camera(x_m=0.0, z_m=0.0))  # the map is told where the camera itself is
    rolling = RollingMap(robot)
    images: list[Image] = []
    maps, poses, goals, hard, land, floors, corners = [], [], [], [], [], [], []
    for number in range(first, min(first + config.views, len(recording) - 1)):
        depth_m, intrinsics = recording.picture(number)
        body, rpy = _body(recording, number)
        rolling.update(DepthFrame(number, 0.0, depth_m, intrinsics), _camera(recording, number), FLOOR_Z_M)
        rolling.clear_robot(body)
        goals_m = _goals(recording, number, body, config.goals)
        if goals_m is None:
            continue
        distance_cm, floor_cm, corner_m = _land(recording, body)
        images.append(network_image(depth_m, intrinsics, config.width, config.height))
        maps.append(np.packbits(local_map(rolling, body, FLOOR_Z_M).reshape(-1, 64 * 64), axis=1))
        poses.append([*body.position_m, rpy[2], *rpy[:2]])
        goals.append(odom_to_level(goals_m, body))
        hard.append([_blocked(recording, body.position_m, goal, robot.body) for goal in goals_m])
        land.append(distance_cm)
        floors.append(floor_cm)
        corners.append(corner_m)
    if not images:
        raise BadInput(
            f"the robot of {recording.folder} stood still from picture {first} on", "Leave it out."
        )
    return Shard(
        images_mm=np.array([np.round(1000.0 * image) for image in images], np.uint16),
        maps=np.array(maps, np.uint8),
        poses=np.array(poses, np.float32),
        floor_m=np.zeros(len(images), np.float32),
        goals_m=np.array(goals, np.float32),
        in_air=np.zeros((len(images), config.goals), np.bool_),
        hard=np.array(hard, np.bool_),
        land_cm=np.array(land, np.int8),
        floors_cm=np.array(floors, np.int16),
        land_corner_m=np.array(corners, np.float32),
        air_cm=np.full((2, 2, 2), FAR_CM, np.int8),  # of the air nothing is known
        air_origin_m=np.zeros(3, np.float32),
        air_cell_m=1.0,
        family=f"iplanner-{recording.name}",
        seed=first,
    )


def _body(recording: Recording, number: int) -> tuple[Pose, tuple[float, float, float]]:
    turn = recording.rotation[number]
    rpy = (
        math.atan2(turn[2, 1], turn[2, 2]),
        math.asin(max(-1.0, min(1.0, -turn[2, 0]))),
        math.atan2(turn[1, 0], turn[0, 0]),
    )
    return Pose(recording.position_m[number], quaternion_from_rpy(*rpy)), rpy


def _camera(recording: Recording, number: int) -> Pose:
    turn = recording.rotation[number]
    eye = recording.position_m[number] + turn @ recording.T_body_camera[:3, 3]
    look = turn @ recording.T_body_camera[:3, :3]
    vector, _ = cv2.Rodrigues(look)
    angle = float(np.linalg.norm(vector))
    axis = vector.ravel() / max(angle, 1e-12)
    return Pose(eye, np.array([math.cos(0.5 * angle), *(math.sin(0.5 * angle) * axis)]))


def _goals(recording: Recording, number: int, body: Pose, count: int) -> Array | None:
    """Later poses (count, 3) odom; some twice where there are too few, None where there is none."""
    later = np.minimum(number + AHEAD + AHEAD_STEP * np.arange(count), len(recording) - 1)
    goals = recording.position_m[later]
    goals = goals[np.hypot(*(goals - body.position_m)[:, :2].T) >= GOAL_MIN_M]
    return goals[np.arange(count) % len(goals)] if len(goals) else None


def _blocked(recording: Recording, here_m: Array, goal_m: Array, outline: Body) -> bool:
    length = float(np.linalg.norm(goal_m - here_m))
    t = np.linspace(0.0, 1.0, math.ceil(length / STEP_M) + 1)[1:, None]
    free_m = recording.land.lookup((here_m + t * (goal_m - here_m))[:, :2])
    return bool(free_m.min() < outline.radius_m - LAND_BLOCKED_M)


def _land(recording: Recording, body: Pose) -> tuple[NDArray[np.int8], NDArray[np.int16], Array]:
    """Distances and floors around a pose, and the corner (2,) of their cell (0, 0)."""
    corner: Array = (np.floor(body.position_m[:2] / LAND_CELL_M) - LAND_SIDE // 2) * LAND_CELL_M
    index = np.stack(np.meshgrid(np.arange(LAND_SIDE), np.arange(LAND_SIDE), indexing="ij"), axis=-1)
    middles = corner + (index.reshape(-1, 2) + 0.5) * LAND_CELL_M
    shape = (LAND_SIDE, LAND_SIDE)
    floors = np.where(recording.land.contains(middles), 0, NO_FLOOR).astype(np.int16)
    return centimetres(recording.land.lookup(middles)).reshape(shape), floors.reshape(shape), corner
