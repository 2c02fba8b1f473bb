import json
import math
import shutil
import subprocess
import sys

import numpy as np
import pytest

from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.gkpn.spline import path_points
from labr_autonomy.planner.messages import Motion, PlanRequest
from labr_autonomy.types import DepthFrame, Mode, Pose, Source
from sim.bench.iplanner.planner import AFRAID, BEARING_MAX_RAD, IPlannerPlanner, shown
from sim.bench.iplanner.weights import IPlannerOnnx, packaged_dir

ROBOT = RobotConfig()
CAMERA = ROBOT.camera.intrinsics


@pytest.fixture(scope="module")
def network():
    return IPlannerOnnx()


class Told:
    """A network that says what it is told, and remembers what it was shown."""

    def __init__(self, keys, mu=0.0):
        self.keys, self.mu, self.goals = np.asarray(keys, float), mu, []

    def predict(self, depth_m, intrinsics, goal_level_m):
        self.goals.append(goal_level_m)
        return self.keys, self.mu, 0.0


def ahead(metres):
    return np.linspace(0.2, 1.0, 5)[:, None] * [metres, 0.0, 0.0]


def floor_view():
    below = (np.arange(CAMERA.height) + 0.5 - CAMERA.cy) / CAMERA.fy
    depth = np.where(below > 0, 0.18 / np.maximum(below, 1e-6), 0.0)
    depth[depth > 10.0] = 0.0
    return np.repeat(depth[:, None], CAMERA.width, axis=1).astype(np.float32)


def wall_view(metres):
    depth = floor_view()
    depth[(depth > metres) | (depth == 0.0)] = metres
    return depth


def request(goal, sequence=0, x=0.0, y=0.0, yaw=0.0, mode=Mode.LAND, speed=0.0):
    at = np.array([x, y, 0.12])
    pose = Pose(at, quaternion_from_rpy(0.0, 0.0, yaw))
    velocity = speed * np.array([math.cos(yaw), math.sin(yaw), 0.0])
    return PlanRequest(
        sequence=sequence,
        frame_sequence=sequence,
        frame_pose=pose,
        body_pose=pose,
        start_s=10.0,
        motion=Motion(at, velocity, np.zeros(3), yaw, 0.0, speed),
        mode=mode,
        goal_m=np.array(goal, float),
        goal_in_air=False,
        floor_z_m=0.0,
        lift_to_m=1.0,
    )


def frame(depth, sequence=0):
    return DepthFrame(sequence, 9.9, depth, CAMERA)


def test_path_is_placed_by_the_pose_of_the_image_and_driven_to_its_end():
    planner = IPlannerPlanner(ROBOT, Told(ahead(4.0)))
    result = planner.cycle(request([2.0, 7.0, 0.0], x=2.0, y=3.0, yaw=math.pi / 2), frame(floor_view()))
    np.testing.assert_allclose(result.network.points_m[-1], [2.0, 7.0, 0.12], atol=1e-9)
    assert result.source is Source.GKPN
    assert result.trajectory.start_s == 10.0
    assert result.trajectory.mode is Mode.LAND
    np.testing.assert_allclose(result.trajectory.position_m[0], [2.0, 3.0, 0.12])
    assert math.dist(result.trajectory.position_m[-1, :2], (2.0, 7.0)) < 0.25
    assert not result.network.air.any()


def test_goal_is_shown_on_the_floor_and_within_the_training_bearings():
    told = Told(ahead(4.0))
    IPlannerPlanner(ROBOT, told).cycle(request([20.0, 0.0, 1.5]), frame(floor_view()))
    np.testing.assert_allclose(told.goals[0], [20.0, 0.0, 0.0], atol=1e-9)  # the network draws it in itself
    np.testing.assert_allclose(
        shown(np.array([-3.0, 0.1, 0.0])),
        [math.hypot(3.0, 0.1) * math.cos(BEARING_MAX_RAD), 3.0 * math.sin(BEARING_MAX_RAD), 0.0],
        atol=0.01,
    )
    inside = np.array([3.0, -2.0, -0.01])
    np.testing.assert_allclose(shown(inside), inside, atol=1e-12)


def test_a_goal_behind_makes_the_robot_turn_until_it_sees_it():
    """The network's path towards the edge of its view is followed; each cycle the goal is less far round."""
    yaw = 0.0
    for sequence in range(12):
        told = Told(ahead(1.0))
        told.predict = lambda d, i, goal: (np.linspace(0.2, 1.0, 5)[:, None] * goal, 0.0, 0.0)
        plan = IPlannerPlanner(ROBOT, told).cycle(
            request([-4.0, 0.5, 0.0], sequence, yaw=yaw), frame(floor_view(), sequence)
        )
        yaw = plan.trajectory.sample(10.5).yaw_rad
    bearing = math.atan2(0.5, -4.0)
    assert abs((yaw - bearing + math.pi) % (2 * math.pi) - math.pi) < 0.3


def test_four_frames_of_fear_stop_the_robot_and_good_ones_let_it_go():
    told = Told(ahead(4.0), mu=0.9)
    planner = IPlannerPlanner(ROBOT, told)
    goal = [4.0, 0.0, 0.0]
    results = [planner.cycle(request(goal, k, speed=0.5), frame(floor_view(), k)) for k in range(4)]
    assert [r.source for r in results] == [Source.GKPN] * 3 + [Source.BRAKE]
    assert results[3].reason == AFRAID
    assert results[3].followed is None
    assert results[3].trajectory.position_m[-1, 0] == pytest.approx(0.125, abs=0.03)
    told.mu = 0.1
    results = [planner.cycle(request(goal, k), frame(floor_view(), k)) for k in range(4, 8)]
    assert [r.source for r in results] == [Source.BRAKE] * 3 + [Source.GKPN]
    told.mu = 0.9
    for k in range(8, 12):
        planner.cycle(request(goal, k), frame(floor_view(), k))
    fresh = planner.cycle(request([3.0, 1.0, 0.0], 12), frame(floor_view(), 12))
    assert fresh.source is Source.GKPN  # a new goal starts anew


def test_the_same_frame_is_looked_at_once_and_without_one_the_last_path_is_followed():
    told = Told(ahead(4.0), mu=0.9)
    planner = IPlannerPlanner(ROBOT, told)
    before = planner.cycle(request([4.0, 0.0, 0.0]), None)
    assert before.source is Source.BRAKE
    assert np.abs(before.trajectory.speed_mps).max() == 0.0
    for _ in range(6):
        result = planner.cycle(request([4.0, 0.0, 0.0]), frame(floor_view()))
    assert len(told.goals) == 1
    assert result.source is Source.GKPN
    on = planner.cycle(request([4.0, 0.0, 0.0], x=1.0, speed=0.5), None)
    assert math.isnan(on.frame_stamp_s)
    assert on.trajectory.position_m[-1, 0] == pytest.approx(3.8, abs=0.1)
    assert (np.diff(on.trajectory.position_m[:, 0]) > -1e-9).all()  # it does not go back to the path's start


def test_it_does_not_fly():
    result = IPlannerPlanner(ROBOT, Told(ahead(4.0))).cycle(
        request([4.0, 0.0, 0.0], mode=Mode.AIR), frame(floor_view())
    )
    assert result.trajectory is None
    assert result.reason == "iPlanner only drives"
    assert not result.take_off_clear
    assert math.isinf(result.lift_off_m)


def test_shipped_network_drives_over_an_open_floor_and_not_through_a_wall(network):
    keys, mu = {}, {}
    for name, view in (("wall", wall_view(0.8)), ("open", floor_view())):
        keys[name], mu[name], _ = network.predict(view, CAMERA, np.array([5.0, 0.0, 0.0]))
    assert mu["wall"] > 5.0 * mu["open"]
    assert math.dist(keys["open"][-1, :2], (5.0, 0.0)) < 0.5
    assert np.abs(keys["open"][:, 1]).max() < 0.5
    assert path_points(keys["wall"])[:, 0].max() < 0.8 + ROBOT.camera.x_m - 0.2


def test_planner_repeats_itself(network):
    plans = [IPlannerPlanner(ROBOT, network) for _ in range(2)]
    a, b = (p.cycle(request([3.0, 1.0, 0.0]), frame(wall_view(2.0))) for p in plans)
    np.testing.assert_array_equal(a.trajectory.position_m, b.trajectory.position_m)
    assert a.network.mu == b.network.mu


# ---------------------------------------------------------------- weights
def test_damaged_weights_are_refused_in_one_sentence(tmp_path):
    for file in packaged_dir().iterdir():
        shutil.copyfile(file, tmp_path / file.name)
    content = bytearray((tmp_path / "iplanner.onnx").read_bytes())
    content[len(content) // 2] ^= 1
    (tmp_path / "iplanner.onnx").write_bytes(content)
    with pytest.raises(BadInput, match=r"iplanner\.onnx are damaged: sha256 \w{12}, not \w{12}") as refused:
        IPlannerOnnx(tmp_path)
    assert "Restore the folder" in refused.value.do
    with pytest.raises(BadInput, match=r"manifest\.json cannot be read"):
        IPlannerOnnx(tmp_path / "elsewhere")


def test_manifest_tells_the_training_and_figures_better_than_the_straight_line():
    manifest = json.loads((packaged_dir() / "manifest.json").read_text())
    assert set(manifest["files"]) == {"iplanner.onnx"}
    assert manifest["files"]["iplanner.onnx"]["bytes"] < 6_500_000
    training = manifest["training"]
    assert not set(training["data"]["seeds"]) & set(training["validation"]["seeds"])
    network, line = manifest["metrics"]["network"], manifest["metrics"]["straight_line"]
    assert network["collision_free"] > line["collision_free"]
    assert network["collision_free_first_2m"] > line["collision_free_first_2m"]
    assert network["fear_auc_first_2m"] > 0.8


def test_planner_does_not_import_torch():
    code = "import sys, sim.bench.iplanner.planner; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=15, check=False).returncode == 0
