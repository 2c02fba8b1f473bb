from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from labr_autonomy.config import Camera
from labr_autonomy.errors import BadInput
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.types import Intrinsics, Pose
from sim.camera import gl
from sim.camera.gl import GlRenderer, GlUnavailable
from sim.camera.process import CameraSpec, Eye, camera_pose
from sim.camera.rays import RayRenderer
from sim.camera.renderer import make_renderer
from sim.worlds.build import build_world
from sim.worlds.world import make_world

SHARED = Path(os.environ.get("LABR_SHARED") or Path(__file__).resolve().parents[2].parent / "shared")
HOUSE = SHARED / "data" / "worlds" / "aws_small_house" / "small_house.npz"
SMALL = Intrinsics(54, 30, 27.0, 26.0, 26.0, 15.5)


def egl():
    try:
        return gl._context() is not None
    except GlUnavailable:
        return False


KINDS = [
    pytest.param("gl", marks=pytest.mark.skipif(not egl(), reason="no EGL on this machine")),
    "rays",
]


def wall(x, y0, y1, z0, z1):
    """Upright sheet across the view at depth x."""
    return np.array([[x, y0, z0], [x, y1, z0], [x, y1, z1], [x, y0, z1]], float)


def sheets(*quads):
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * i for i in range(len(quads))])
    return make_world("sheets", np.concatenate(quads), faces, {})


def pose(x=0.0, y=0.0, z=0.0, roll=0.0, pitch=0.0, yaw=0.0):
    return Pose(np.array([x, y, z]), quaternion_from_rpy(roll, pitch, yaw))


def bare(value):
    """Camera-FLU to odom with the camera in the body's origin."""
    return camera_pose(value, Camera(x_m=0.0, z_m=0.0))


@pytest.mark.parametrize("kind", KINDS)
def test_left_is_left_up_is_up_and_depth_lies_along_the_axis(kind):
    world = sheets(wall(5, -50, 50, -50, 50), wall(2, 0.5, 60, -60, 60), wall(3, -60, 60, 0.6, 60))
    renderer = make_renderer(world, SMALL, kind=kind)
    depth = renderer.depth(bare(pose()))
    assert depth.shape == (30, 54)
    assert depth.dtype == np.float32
    # The sheet on the left (y >= 0.5 at 2 m) covers u <= cx - fx*0.25, the one above v <= cy - fy*0.2.
    u, v = np.meshgrid(np.arange(54), np.arange(30))
    expected = np.where(v < SMALL.cy - 26.0 * 0.2, 3.0, 5.0)
    expected[u < SMALL.cx - 27.0 * 0.25] = 2.0
    assert np.abs(depth - expected).max() < 1e-4
    renderer.close()


@pytest.mark.parametrize("kind", KINDS)
def test_pixels_are_rays_through_their_centres(kind):
    """A floor: depth of row v is f h / (v - cy), whatever the column."""
    floor = np.array([[-99, -99, -1.2], [99, -99, -1.2], [99, 99, -1.2], [-99, 99, -1.2]], float)
    renderer = make_renderer(sheets(floor), SMALL, kind=kind)
    for yaw in (0.0, 2.0):
        depth = renderer.depth(bare(pose(yaw=yaw)))
        rows = np.arange(30)
        expected = np.array([26.0 * 1.2 / (v - 15.5) if v > 15.5 else 0.0 for v in rows])
        expected[expected > 10.0] = 0.0
        assert np.abs(depth - expected[:, None]).max() < 2e-3
    renderer.close()


@pytest.mark.parametrize("kind", KINDS)
def test_turning_left_moves_the_picture_right_and_nose_down_moves_it_up(kind):
    world = sheets(wall(4, -0.2, 0.2, -0.2, 0.2))
    renderer = make_renderer(world, SMALL, kind=kind)

    def centre(value):
        v, u = np.nonzero(renderer.depth(bare(value)))
        return u.mean() - SMALL.cx, v.mean() - SMALL.cy

    assert centre(pose(yaw=0.3))[0] > 5.0
    assert centre(pose(pitch=0.2))[1] < -3.0
    u, v = centre(pose(y=1.0, z=1.0))  # moved to the left and up: it appears at the right and below
    assert u > 5.0
    assert v > 5.0
    renderer.close()


@pytest.mark.parametrize("kind", KINDS)
def test_beyond_the_range_is_nothing_and_back_sides_are_seen(kind):
    world = sheets(wall(3, 0, 9, -9, 9), wall(6, -9, 9, -9, 9)[::-1])
    renderer = make_renderer(world, SMALL, 5.0, kind=kind)
    depth = renderer.depth(bare(pose()))
    assert set(np.unique(depth.round(3))) == {0.0, np.float32(3.0)}
    turned = renderer.depth(bare(pose(x=4.0, yaw=np.pi)))
    assert turned.max() == pytest.approx(1.0, abs=1e-3)
    renderer.close()


def compare(world, poses, camera):
    """Differences [m] of the two renderers away from edges."""
    gl_renderer, rays = GlRenderer(world, camera, 10.0), RayRenderer(world, camera, 10.0)
    differences = []
    for p in poses:
        a, b = gl_renderer.depth(bare(p)), rays.depth(bare(p))
        steps = [np.abs(np.diff(b, axis=k, append=np.take(b, [-1], axis=k))) for k in (0, 1)]
        edge = np.maximum(*steps) > 0.1
        for k in (0, 1):
            edge |= np.roll(edge, 1, axis=k) | np.roll(edge, -1, axis=k)
        differences.append(np.abs(a - b)[~edge])
    gl_renderer.close()
    return np.concatenate(differences)


@pytest.mark.slow
@pytest.mark.skipif(not egl(), reason="no EGL on this machine")
def test_both_renderers_agree_in_a_generated_hall():
    world = build_world({"family": "hall", "size_m": [10, 8]}, seed=2, clear_m=[(-3, 0, 0), (3, 0, 0)])
    poses = [pose(x, 0, 0.3, 0.05, -0.1, yaw) for x in (-3, 3) for yaw in (0.3, 2.0, 4.0)]
    difference = compare(world, poses, Camera().intrinsics)
    assert len(difference) > 200_000
    assert np.percentile(difference, 99) <= 0.01


@pytest.mark.slow
@pytest.mark.skipif(not egl(), reason="no EGL on this machine")
@pytest.mark.skipif(not HOUSE.exists(), reason="the small house is not beside the checkout")
def test_both_renderers_agree_in_the_small_house():
    world = build_world({"mesh": "aws_small_house/small_house.npz"}, seed=0, worlds_dir=HOUSE.parents[1])
    poses = [
        pose(x, y, z, 0.05, 0.1, yaw) for x, y, z in ((2, 0.6, 0.3), (-4.4, -3.8, 1.4)) for yaw in (0, 2, 4)
    ]
    assert np.percentile(compare(world, poses, Camera().intrinsics), 99) <= 0.01


def test_rays_are_taken_with_their_reason_where_gl_does_not_work(monkeypatch):
    def broken():
        raise GlUnavailable("OpenGL on EGL does not work here: no libEGL", "Install it.")

    monkeypatch.setattr(gl, "_context", broken)
    world = sheets(wall(3, -9, 9, -9, 9))
    renderer = make_renderer(world, SMALL)
    assert isinstance(renderer, RayRenderer)
    assert "no libEGL" in renderer.kind
    assert renderer.depth(bare(pose()))[5, 5] == pytest.approx(3.0)
    with pytest.raises(GlUnavailable):
        make_renderer(world, SMALL, kind="gl")
    with pytest.raises(BadInput, match="no renderer 'x'"):
        make_renderer(world, SMALL, kind="x")


def test_the_camera_sits_where_the_body_carries_it():
    camera = Camera(x_m=0.2, z_m=0.1)
    T = camera_pose(pose(1, 2, 3, yaw=np.pi / 2), camera)
    assert T[:3, 3] == pytest.approx([1.0, 2.2, 3.1])
    assert T[:3, 0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-12)


def test_the_eye_is_repeatable_and_its_noise_changes_with_each_frame():
    world = sheets(wall(2.2, -9, 9, -9, 9))

    def look(seed, frames=2, **options):
        eye = Eye(RayRenderer(world, Camera().intrinsics, 10.0), Camera(), seed=seed, **options)
        return [eye.look(pose()) for _ in range(frames)]

    first, again, other = look(1), look(1), look(2)
    assert np.array_equal(first[0], again[0])
    assert np.array_equal(first[1], again[1])
    assert not np.array_equal(first[0], first[1])
    assert not np.array_equal(first[0], other[0])
    assert np.abs(look(1, noise=False)[0] - (2.2 - Camera().x_m)).max() < 1e-5


def test_ideal_images_keep_the_nearest_range():
    eye = Eye(RayRenderer(sheets(wall(0.35, -9, 9, -9, 9)), Camera().intrinsics, 10.0), Camera(), noise=False)
    assert not eye.look(pose()).any()


def test_the_spec_travels_as_json():
    spec = CameraSpec(
        {"family": "hall"}, "pose", "frames", Camera(z_m=0.1), seed=4, noise=False, parent_pid=7
    )
    assert CameraSpec.from_json(spec.to_json()) == spec
    for bad in ("", "[]", "{}", '{"world": {}, "pose_slot": "a", "frame_slot": "b", "colour": 1}'):
        with pytest.raises(BadInput, match="spec cannot be read"):
            CameraSpec.from_json(bad)
