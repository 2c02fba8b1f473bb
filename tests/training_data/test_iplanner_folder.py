"""A recording in iPlanner's layout, made here from a corridor that is known, becomes shards."""

import json
import math

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from scipy import ndimage
from training_worlds import cell_middles

from labr_autonomy.cli import main
from labr_autonomy.errors import BadInput
from labr_autonomy.gkpn.local_map import BEHIND_M, CELL_M, CHANNELS, SIDE
from labr_autonomy.gkpn.shards import NO_FLOOR, read_folder, read_shard
from sim.training_data.build import SceneConfig
from sim.training_data.iplanner_folder import convert, recording_jobs
from sim.training_data.iplanner_recording import read_recording

VOXEL_M, START_M = 0.05, (-2.0, -3.0)
COUNT, STEP_M, HEIGHT_M = 41, 0.2, 0.5
W, H, F = 320, 180, 102.5  # a 115 degree camera, as its simulator's
AHEAD_M = 0.3  # of the camera before the body
WALL_Y_M, END_X_M = 1.5, 10.93
# a way along x, then round a pillar's side: the robot drives at y = 0 and swerves to y = 0.8 about x = 3
POST = (2.6, -0.3, 3.4, 0.3)


def way(n):
    x = STEP_M * n
    return x, 0.85 * math.exp(-(((x - 3.0) / 1.2) ** 2))


def free_at(x, y):
    in_post = (x > POST[0]) & (x < POST[2]) & (y > POST[1]) & (y < POST[3])
    return (np.abs(y) < WALL_Y_M) & (x > -1.0) & (x < END_X_M) & ~in_post


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings") / "corridor"
    for name in ("depth", "maps/data", "maps/params"):
        (folder / name).mkdir(parents=True)
    lines = []
    for n in range(COUNT):
        x, y = way(n)
        lines.append(str([x, y, HEIGHT_M, 0.0, 0.0, 0.0, 1.0]))
        # what stands at the corridor's far end and its floor: depth along the axis
        v = (np.arange(H) - 0.5 * H)[:, None]
        floor = np.where(v > 0, HEIGHT_M * F / np.maximum(v, 1e-6), np.inf)
        depth = np.minimum(np.broadcast_to(floor, (H, W)), END_X_M - x - AHEAD_M)
        cv2.imwrite(str(folder / "depth" / f"{n}.png"), np.round(1000.0 * depth).astype(np.uint16))
    (folder / "odom_ground_truth.txt").write_text("\n".join(lines) + "\n")
    projection = [F, 0.0, 0.5 * W, 0.0, 0.0, F, 0.5 * H, 0.0, 0.0, 0.0, 1.0, 0.0]
    (folder / "depth_intrinsic.txt").write_text(f"{projection}\n")
    (folder / "camera_extrinsic.txt").write_text(f"{[-0.5, 0.5, -0.5, 0.5, AHEAD_M, 0.0, 0.0]}\n")
    i, j = np.meshgrid(np.arange(320), np.arange(120), indexing="ij")
    solid = ~free_at(START_M[0] + VOXEL_M * i, START_M[1] + VOXEL_M * j)
    depth_cells = ndimage.gaussian_filter(ndimage.distance_transform_edt(solid), 2.5)
    np.savetxt(folder / "maps/data/tsdf1_map.txt", np.log(depth_cells + 1.00001))
    (folder / "maps/params/tsdf1_param.txt").write_text(f"{VOXEL_M}\n{START_M[0]}\n{START_M[1]}\n1.0\n")
    return folder


@pytest.fixture(scope="module")
def shard(recording):
    return convert(read_recording(recording), 0, SceneConfig(views=COUNT, goals=5))


def test_views_are_its_pictures_and_goals_its_later_poses(shard):
    assert shard.family == "iplanner-corridor"
    np.testing.assert_allclose(shard.poses[:, :2], [way(n) for n in range(len(shard.poses))], atol=1e-5)
    first = [np.subtract(way(n), way(0)) for n in (6, 11, 16, 21)]  # the next pose is too near
    np.testing.assert_allclose(shard.goals_m[0, :4, :2], first, atol=1e-5)
    np.testing.assert_allclose(shard.goals_m[0, 4], shard.goals_m[0, 0])
    assert not shard.in_air.any()
    assert (shard.floor_m == 0.0).all()
    assert (shard.air_cm == 127).all()
    assert np.hypot(*shard.goals_m[..., :2].reshape(-1, 2).T).min() > 0.29


def test_the_cost_map_becomes_a_signed_distance_to_walls_and_post(shard):
    xy = cell_middles(shard.land_corner_m[10].astype(float))
    x, y = xy[..., 0], xy[..., 1]
    cm = shard.land_cm[10]
    to_wall = WALL_Y_M - np.abs(y)
    plain = (x > 5.0) & (x < 8.0) & (np.abs(y) < 1.45)
    assert np.abs(0.01 * cm[plain] - np.minimum(to_wall[plain], 1.27)).max() < 0.16
    assert (cm[plain] > -10).all()
    post = (np.abs(x - 3.0) < 0.25) & (np.abs(y) < 0.15)
    assert (cm[post] < 0).all()
    behind = (x > 5.0) & (x < 8.0) & (np.abs(y) > 1.9) & (np.abs(y) < 2.9)
    assert (cm[behind] < -20).all()
    assert (shard.floors_cm[10][plain] == 0).all()
    assert (shard.floors_cm[10][np.abs(y) > 3.2] == NO_FLOOR).all()


def test_the_straight_line_through_the_post_is_hard(shard):
    x = shard.poses[:, 0]
    through = (x < 1.5)[:, None] & (x[:, None] + shard.goals_m[..., 0] > 4.2)
    along = (x > 4.6)[:, None] & np.ones_like(shard.hard)
    assert shard.hard[through].all()
    assert not shard.hard[along].any()
    assert through.sum() > 3


def test_image_and_map_come_from_the_camera_where_it_is(shard):
    middle = shard.images_mm[0, 40, 80]  # straight ahead is out of the network's range at first
    assert middle == 0
    late = shard.images_mm[-1, 40, 80] / 1000.0
    assert late == pytest.approx(END_X_M - shard.poses[-1, 0] - AHEAD_M, abs=0.01)
    maps = np.unpackbits(shard.maps, axis=2).reshape(-1, CHANNELS, SIDE, SIDE)
    wall_row = int((END_X_M - shard.poses[-1, 0] + BEHIND_M) / CELL_M)
    solid = maps[-1, 0:6:2].max(axis=0)
    assert solid[wall_row - 1 : wall_row + 2, 28:36].any()
    assert not solid[: wall_row - 2, 28:36].any()


def test_the_command_converts_every_recording_of_a_folder(recording, tmp_path):
    words = ["dataset", str(tmp_path / "out"), "--from-iplanner", str(recording.parent), "--json"]
    done = CliRunner().invoke(main, [*words, "--views", "12", "--goals", "3", "--jobs", "1"])
    assert done.exit_code == 0
    assert json.loads(done.stdout)["counts"]["scenes"] == 4
    shards = [read_shard(path) for path in read_folder(tmp_path / "out")]
    assert [shard.seed for shard in shards] == [0, 12, 24, 36]
    refused = CliRunner().invoke(main, [*words, "--family", "rooms"])
    assert refused.exit_code == 2
    assert "given with other worlds" in refused.stdout


@pytest.mark.parametrize(
    ("file", "text", "words"),
    [
        ("odom_ground_truth.txt", "[1, 2, 3]", "7 numbers a line"),
        ("depth_intrinsic.txt", "[1, 2, 3]", "12 or 16 numbers"),
        ("camera_extrinsic.txt", "[0, 0, 0, 1, 0, 0, 0]", "does not look ahead"),
        ("camera_extrinsic.txt", "[a]", "cannot be read"),
        ("maps/params/tsdf1_param.txt", "0.05", "no voxel and start"),
        ("maps/data/tsdf1_map.txt", "x", "cost map"),
    ],
)
def test_files_that_cannot_be_understood_are_refused(recording, file, text, words):
    path = recording / file
    before = path.read_bytes()
    path.write_text(text)
    try:
        with pytest.raises(BadInput, match=words):
            read_recording(recording)
    finally:
        path.write_bytes(before)


def test_a_missing_picture_and_a_folder_without_recordings_are_refused(recording, tmp_path):
    picture = recording / "depth" / "3.png"
    before = picture.read_bytes()
    picture.unlink()
    try:
        with pytest.raises(BadInput, match=r"3\.png is no 16-bit depth image"):
            convert(read_recording(recording), 0, SceneConfig(views=8, goals=2))
    finally:
        picture.write_bytes(before)
    with pytest.raises(BadInput, match="no recording of iPlanner"):
        recording_jobs(tmp_path, SceneConfig())
