"""What viewers know by itself: Foxglove's well-known messages, as protobuf. Pure builders, one per topic.

Foxglove, Lichtblick and PlotJuggler show these without being told anything: poses, point cloud, pictures,
key points and trajectory in 3D, log lines. Frames: `odom` (ENU) and `base_link` (FLU), `camera_depth`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose as PoseMessage
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.descriptor import FileDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import Message
from numpy.typing import NDArray

from labr_autonomy.config import Camera
from labr_autonomy.types import Array, DepthFrame, Image, Intrinsics, KeyPoints, Pose, Trajectory

ODOM, BODY, CAMERA = "odom", "base_link", "camera_depth"
_OPTICAL = Quaternion(x=-0.5, y=0.5, z=-0.5, w=0.5)  # x right, y down, z ahead, seen from FLU
_LAND, _AIR = Color(r=0.85, g=0.45, b=0.05, a=1.0), Color(r=0.09, g=0.41, b=0.78, a=1.0)
_PATH = Color(r=0.05, g=0.52, b=0.46, a=1.0)
_LEVELS = {"info": Log.INFO, "warning": Log.WARNING, "error": Log.ERROR}

TOPICS: dict[str, type[Message]] = {
    "/tf": FrameTransforms,
    "/pose": PoseInFrame,
    "/map": PointCloud,
    "/depth/image": CompressedImage,
    "/depth/calibration": CameraCalibration,
    "/plan/scene": SceneUpdate,
    "/log": Log,
}


DEPTH: type[Message] = RawImage  # of `raw_depth`


def schema(kind: type[Message]) -> bytes:
    """The message's definition with all that it is made of, as MCAP wants it."""
    found = FileDescriptorSet()
    done: set[str] = set()

    def add(file: FileDescriptor) -> None:
        if file.name in done:
            return
        done.add(file.name)
        for needed in file.dependencies:
            add(needed)
        file.CopyToProto(found.file.add())

    add(kind.DESCRIPTOR.file)
    return bytes(found.SerializeToString())


def transforms(stamp_utc_s: float, pose: Pose) -> bytes:
    """Body in odom, and the camera on the body are told apart by `camera_mount`."""
    message = FrameTransforms()
    frame = message.transforms.add(parent_frame_id=ODOM, child_frame_id=BODY)
    _stamp(frame, stamp_utc_s)
    frame.translation.CopyFrom(_vector(pose.position_m))
    frame.rotation.CopyFrom(_quaternion(pose.quaternion))
    return bytes(message.SerializeToString())


def camera_mount(stamp_utc_s: float, camera: Camera) -> bytes:
    """Where the camera sits on the body."""
    frame = FrameTransform(parent_frame_id=BODY, child_frame_id=CAMERA, rotation=_OPTICAL)
    _stamp(frame, stamp_utc_s)
    frame.translation.CopyFrom(Vector3(x=camera.x_m, y=0.0, z=camera.z_m))
    return bytes(FrameTransforms(transforms=[frame]).SerializeToString())


def pose_in_odom(stamp_utc_s: float, pose: Pose) -> bytes:
    """The body's pose."""
    message = PoseInFrame(frame_id=ODOM)
    _stamp(message, stamp_utc_s)
    message.pose.CopyFrom(_pose(pose.position_m, pose.quaternion))
    return bytes(message.SerializeToString())


def cloud(stamp_utc_s: float, cells_xy_m: NDArray[Any], floor_z_m: float) -> bytes:
    """Obstacle cells (n, 2) odom, drawn on the floor."""
    points = np.column_stack([cells_xy_m, np.full(len(cells_xy_m), floor_z_m)]).astype(np.float32)
    message = PointCloud(frame_id=ODOM, point_stride=12, data=points.tobytes())
    _stamp(message, stamp_utc_s)
    message.pose.orientation.w = 1.0
    for i, name in enumerate("xyz"):
        message.fields.add(name=name, offset=4 * i, type=PackedElementField.FLOAT32)
    return bytes(message.SerializeToString())


def cells_of(data: bytes) -> Array:
    """Back from `cloud`: (n, 2) odom."""
    points = np.frombuffer(PointCloud.FromString(data).data, np.float32).reshape(-1, 3)
    out: Array = points[:, :2].astype(np.float64)
    return out


def picture(stamp_utc_s: float, jpeg: bytes) -> bytes:
    """A picture of the depth image."""
    message = CompressedImage(frame_id=CAMERA, format="jpeg", data=jpeg)
    _stamp(message, stamp_utc_s)
    return bytes(message.SerializeToString())


def raw_depth(stamp_utc_s: float, frame: DepthFrame) -> bytes:
    """A depth image in millimetres, as the camera gave it."""
    millimetres = np.rint(frame.depth_m * 1000.0).astype("<u2")
    height, width = millimetres.shape
    message = RawImage(frame_id=CAMERA, width=width, height=height, encoding="16UC1", step=2 * width)
    message.data = millimetres.tobytes()
    _stamp(message, stamp_utc_s)
    return bytes(message.SerializeToString())


def depth_of(data: bytes) -> Image:
    """Back from `raw_depth`: (h, w) float32 [m], exactly as the frame slot gives it."""
    message = RawImage.FromString(data)
    millimetres = np.frombuffer(message.data, "<u2").reshape(message.height, message.width)
    depth_m: Image = np.divide(millimetres, np.float32(1000.0), dtype=np.float32)
    return depth_m


def calibration(stamp_utc_s: float, k: Intrinsics) -> bytes:
    """The pinhole model."""
    message = CameraCalibration(frame_id=CAMERA, width=k.width, height=k.height)
    _stamp(message, stamp_utc_s)
    message.K.extend([k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0])
    message.R.extend([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    message.P.extend([k.fx, 0.0, k.cx, 0.0, 0.0, k.fy, k.cy, 0.0, 0.0, 0.0, 1.0, 0.0])
    return bytes(message.SerializeToString())


def scene(stamp_utc_s: float, points: KeyPoints | None, trajectory: Trajectory | None) -> bytes:
    """Key points, orange where driven to and blue where flown to, and the trajectory."""
    update = SceneUpdate()
    entity: SceneEntity = update.entities.add(id="plan", frame_id=ODOM)
    _stamp(entity, stamp_utc_s)
    if points is not None and np.isfinite(points.points_m).all():
        for place, air in zip(points.points_m, points.air, strict=True):
            entity.spheres.append(
                SpherePrimitive(
                    pose=_pose(place), size=Vector3(x=0.15, y=0.15, z=0.15), color=_AIR if air else _LAND
                )
            )
    if trajectory is not None:
        strip, here = LinePrimitive.LINE_STRIP, _pose((0, 0, 0))
        line = LinePrimitive(type=strip, thickness=0.05, color=_PATH, pose=here)
        line.points.extend(Point3(x=x, y=y, z=z) for x, y, z in trajectory.position_m)
        entity.lines.append(line)
    return bytes(update.SerializeToString())


def line_of_log(stamp_utc_s: float, text: str, level: str) -> bytes:
    """An event."""
    message = Log(level=_LEVELS.get(level, Log.INFO), message=text, name="labr")
    _stamp(message, stamp_utc_s)
    return bytes(message.SerializeToString())


def register(add: Callable[[str, str, str, bytes], None], topics: Iterable[str] = TOPICS) -> None:
    """Tell a file about the topics: (topic, schema's name, encoding, schema)."""
    for topic in topics:
        kind = TOPICS[topic]
        add(topic, kind.DESCRIPTOR.full_name, "protobuf", schema(kind))


def _stamp(message: Any, stamp_utc_s: float) -> None:
    whole = math.floor(stamp_utc_s)
    message.timestamp.seconds = max(0, whole)
    message.timestamp.nanos = min(999_999_999, max(0, int((stamp_utc_s - whole) * 1e9)))


def _vector(v: Any) -> Vector3:
    return Vector3(x=float(v[0]), y=float(v[1]), z=float(v[2]))


def _quaternion(q: Any) -> Quaternion:
    return Quaternion(w=float(q[0]), x=float(q[1]), y=float(q[2]), z=float(q[3]))


def _pose(position: Any, quaternion: Any = (1.0, 0.0, 0.0, 0.0)) -> PoseMessage:
    return PoseMessage(position=_vector(position), orientation=_quaternion(quaternion))
