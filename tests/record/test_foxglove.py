"""What viewers get: their own well-known messages, decodable by the schemas in the file itself."""

import numpy as np
import pytest
from conftest import T0_S, frame, position
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader

from labr_autonomy.frames import quaternion_from_rpy, rotation_matrix
from labr_autonomy.record import foxglove
from labr_autonomy.types import KeyPoints, Pose, Source


@pytest.fixture(scope="module")
def messages(whole_run):
    """Decoded with nothing but what the file says of itself."""
    found = {}
    with (whole_run / "flight.mcap").open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            if channel.message_encoding != "protobuf":
                continue
            pool = descriptor_pool.DescriptorPool()
            for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
                pool.Add(file)
            kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
            found.setdefault(channel.topic, (schema.name, []))[1].append(kind.FromString(message.data))
    return found


def test_the_names_are_the_well_known_ones(messages):
    assert {topic: name for topic, (name, _) in messages.items()} == {
        "/tf": "foxglove.FrameTransforms",
        "/pose": "foxglove.PoseInFrame",
        "/map": "foxglove.PointCloud",
        "/depth/image": "foxglove.CompressedImage",
        "/depth/calibration": "foxglove.CameraCalibration",
        "/plan/scene": "foxglove.SceneUpdate",
        "/log": "foxglove.Log",
    }


def test_poses_are_where_the_robot_was(messages):
    poses = messages["/pose"][1]
    assert len(poses) == 600
    p = poses[100].pose.position
    assert np.allclose([p.x, p.y, p.z], position(10.0) + 0.03)
    assert poses[100].frame_id == "odom"
    stamps = [m.timestamp.seconds + m.timestamp.nanos * 1e-9 for m in poses]
    assert np.allclose(np.diff(stamps), 0.1, atol=1e-6)


def test_the_frames_form_one_tree(messages):
    edges = {(t.parent_frame_id, t.child_frame_id) for m in messages["/tf"][1] for t in m.transforms}
    assert edges == {("odom", "base_link"), ("base_link", "camera_depth")}


def test_the_camera_looks_ahead(messages):
    (mount,) = {
        (t.rotation.w, t.rotation.x, t.rotation.y, t.rotation.z)
        for m in messages["/tf"][1]
        for t in m.transforms
        if t.child_frame_id == "camera_depth"
    }
    turn = rotation_matrix(np.array(mount))
    assert np.allclose(turn @ [0, 0, 1], [1, 0, 0])  # optical z is ahead
    assert np.allclose(turn @ [1, 0, 0], [0, -1, 0])  # and x to the right


def test_pictures_are_jpegs_and_the_map_comes_back(messages):
    assert all(m.data.startswith(b"\xff\xd8") for m in messages["/depth/image"][1])
    cloud = messages["/map"][1][0]
    assert cloud.point_stride * 1 == len(cloud.data)
    assert [f.name for f in cloud.fields] == ["x", "y", "z"]
    data = foxglove.cloud(1.0, np.array([[1.5, -2.0], [3.0, 4.0]]), 0.1)
    assert foxglove.cells_of(data).tolist() == [[1.5, -2.0], [3.0, 4.0]]


def test_raw_depth_comes_back_to_the_bit():
    shown = frame(1, T0_S)
    millimetres = np.rint(shown.depth_m * 1000).astype(np.uint16)
    again = foxglove.depth_of(foxglove.raw_depth(1.0, shown))
    assert np.array_equal(again, np.divide(millimetres, np.float32(1000.0), dtype=np.float32))


def test_a_path_that_is_none_draws_nothing():
    broken = KeyPoints(np.full((2, 3), np.nan), np.array([True, False]), 0.9, Source.GKPN)
    update = foxglove.TOPICS["/plan/scene"].FromString(foxglove.scene(1.0, broken, None))
    assert len(update.entities) == 1
    assert not update.entities[0].spheres
    pose = Pose(np.zeros(3), quaternion_from_rpy(0, 0, 0))
    assert foxglove.pose_in_odom(-1.0, pose)  # a stamp that is not known is the epoch
