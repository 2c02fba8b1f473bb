"""The camera sees movers, in OpenGL and in Embree, and its process learns where they are."""

import numpy as np
import pytest
from movers_rig import BOX, CONFIG, mover

from labr_autonomy.config import Camera
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.types import Pose
from sim.camera import gl
from sim.camera.gl import GlUnavailable
from sim.camera.process import CameraSpec, Eye, camera_pose
from sim.camera.renderer import make_renderer
from sim.movers.draw import PERSON
from sim.movers.mover import Mover, Placed
from sim.pose_slot import PoseSlotReader, PoseSlotWriter
from sim.worlds.build import build_world


def egl():
    try:
        return gl._context() is not None
    except GlUnavailable:
        return False


KINDS = [pytest.param("gl", marks=pytest.mark.skipif(not egl(), reason="no EGL on this machine")), "rays"]
LENS = CONFIG.camera.intrinsics
CAMERA = Camera(x_m=0.0, z_m=0.0)


@pytest.fixture(scope="module")
def hall():
    return build_world({"family": "hall", "size_m": [14, 10]}, seed=1, clear_m=[(0, 0, 0.1), (4, 0, 0.1)])


def looking(x=0.0, y=0.0, z=0.8, yaw=0.0):
    return camera_pose(Pose(np.array([x, y, z]), quaternion_from_rpy(0.0, 0.0, yaw)), CAMERA)


@pytest.mark.parametrize("kind", KINDS)
def test_a_person_ahead_is_seen_where_it_stands_and_as_large_as_it_is(hall, kind):
    renderer = make_renderer(hall, LENS, 10.0, kind=kind)
    bare = renderer.depth(looking())
    seen = renderer.depth(looking(), [Placed(PERSON, 2.0, 0.3, 0.0, 0.0)])
    nearer = seen != bare
    rows, columns = np.nonzero(nearer)
    middle = LENS.cx - LENS.fx * 0.3 / 2.0
    half = LENS.fx * 0.25 / 2.0
    assert columns.min() == pytest.approx(middle - half, abs=2.5)
    assert columns.max() == pytest.approx(middle + half, abs=2.5)
    assert rows.min() == pytest.approx(LENS.cy - LENS.fy * (1.75 - 0.8) / 1.75, abs=1.5)
    assert seen[round(LENS.cy), round(middle)] == pytest.approx(1.75, abs=0.01)
    assert renderer.depth(looking()).tobytes() == bare.tobytes()  # and it leaves nothing behind
    renderer.close()


@pytest.mark.parametrize("kind", KINDS)
def test_a_wall_hides_a_mover_and_one_behind_the_lens_is_not_seen(hall, kind):
    renderer = make_renderer(hall, LENS, 10.0, kind=kind)
    bare = renderer.depth(looking())
    unseen = [Placed(PERSON, -2.0, 0.0, 0.0, 0.0), Placed(BOX, 9.0, 0.0, 0.0, 0.0)]
    assert renderer.depth(looking(), unseen).tobytes() == bare.tobytes()
    renderer.close()


@pytest.mark.skipif(not egl(), reason="no EGL on this machine")
def test_both_renderers_see_the_same_movers(hall):
    renderers = [make_renderer(hall, LENS, 10.0, kind=kind) for kind in ("gl", "rays")]
    rng = np.random.default_rng(3)
    for _ in range(8):
        movers = [Placed(s, *rng.uniform(-3, 3, 2), 0.0, rng.uniform(-3, 3)) for s in (PERSON, BOX, PERSON)]
        view = looking(yaw=rng.uniform(-3, 3))
        movers = [m for m in movers if np.hypot(m.x_m, m.y_m) > 0.8]
        a, b = (renderer.depth(view, movers) for renderer in renderers)
        assert (np.abs(a - b) < 0.02).mean() > 0.99
    for renderer in renderers:
        renderer.close()


def test_the_slot_carries_the_truth_of_one_instant():
    writer = PoseSlotWriter("labr_test_movers", 2)
    reader = PoseSlotReader("labr_test_movers")
    writer.write(1.0, Pose(np.zeros(3), np.array([1.0, 0, 0, 0])), [0.5, 2.5])
    stamp_s, pose, along_m = reader.latest_whole()
    assert (stamp_s, pose.position_m.tolist(), along_m) == (1.0, [0.0, 0.0, 0.0], [0.5, 2.5])
    assert reader.latest()[0] == 1.0
    reader.close()
    writer.close()


def test_the_camera_process_is_told_of_them_in_its_spec():
    who = mover(BOX)
    spec = CameraSpec(world={}, pose_slot="a", frame_slot="b", movers=(who.as_dict(),))
    again = CameraSpec.from_json(spec.to_json())
    assert [Mover.from_dict(values) for values in again.movers] == [who]


def test_an_eye_shows_them_with_the_cameras_flaws(hall):
    renderer = make_renderer(hall, LENS, 10.0, kind="rays")
    eye = Eye(renderer, CAMERA, seed=1)
    pose = Pose(np.array([0.0, 0.0, 0.8]), quaternion_from_rpy(0.0, 0.0, 0.0))
    image = eye.look(pose, [Placed(PERSON, 2.0, 0.0, 0.0, 0.0)])
    ahead = image[100:140, 205:220]
    assert np.median(ahead[ahead > 0.0]) == pytest.approx(1.75, abs=0.06)
    renderer.close()
