"""Depth against geometry one can work out, and the two renderers against each other in every world."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from labr_autonomy.config import Camera
from labr_autonomy.frames import quaternion_from_rpy
from labr_autonomy.types import Pose
from sim.camera import gl
from sim.camera.gl import GlUnavailable
from sim.camera.process import camera_pose
from sim.camera.renderer import make_renderer
from sim.worlds.build import build_world
from sim.worlds.families.draw import SIZES
from sim.worlds.meshes import box, hull_of_rings
from sim.worlds.world import make_world

SHARED = Path(os.environ.get("LABR_SHARED") or Path(__file__).resolve().parents[2].parent / "shared")
WORLDS = SHARED / "data" / "worlds"
CAMERA = Camera(x_m=0.0, z_m=0.0)
LENS = CAMERA.intrinsics
NEAREST_M = 0.1  # a lens in a body of 0.3 m radius never comes nearer to anything


def egl():
    try:
        return gl._context() is not None
    except GlUnavailable:
        return False


needs_egl = pytest.mark.skipif(not egl(), reason="no EGL on this machine")
both = pytest.mark.parametrize("kind", [pytest.param("gl", marks=needs_egl), "rays"])


def at(x=0.0, y=0.0, z=0.0, roll=0.0, pitch=0.0, yaw=0.0):
    return camera_pose(Pose(np.array([x, y, z]), quaternion_from_rpy(roll, pitch, yaw)), CAMERA)


def rays(T):
    """Directions (h, w, 3) odom with 1 along the optical axis, so that depth is the ray's parameter."""
    u, v = np.meshgrid(np.arange(LENS.width), np.arange(LENS.height))
    local = np.stack([np.ones(u.shape), -(u - LENS.cx) / LENS.fx, -(v - LENS.cy) / LENS.fy], axis=-1)
    return local @ T[:3, :3].T


def rendered(mesh, kind, T):
    renderer = make_renderer(make_world("scene", mesh.vertices_m, mesh.faces, {}), LENS, 10.0, kind=kind)
    depth = renderer.depth(T)
    renderer.close()
    return depth


def check(depth, expected_m, least):
    """Within a millimetre wherever both see something, and the outlines agree to a pixel."""
    seen = (depth > 0) & (expected_m > 0) & (expected_m < 9.99)
    assert seen.mean() > least
    assert np.abs(depth - expected_m)[seen].max() < 1e-3
    assert ((depth > 0) != ((expected_m > 0) & (expected_m <= 10.0))).mean() < 0.01


@both
@pytest.mark.parametrize(
    ("roll", "pitch", "yaw"), [(0, 0, 0), (0.3, 0.2, 0.6), (-0.5, -0.4, -0.9), (0, 0.7, 0)]
)
def test_a_plane_at_an_angle(kind, roll, pitch, yaw):
    wall = box((3.5, 0.0, 0.0), (0.5, 80.0, 80.0))
    T = at(0.2, 1.0, -0.5, roll, pitch, yaw)
    ahead = rays(T)[..., 0]
    expected = np.where(ahead > 1e-6, 2.8 / np.maximum(ahead, 1e-6), 0.0)
    check(rendered(wall, kind, T), np.where(expected <= 10.0, expected, 0.0), 0.2)


@both
@pytest.mark.parametrize("yaw", [0.0, 0.4, -0.7])
def test_a_box(kind, yaw):
    half = np.array([0.5, 0.8, 0.4])
    T = at(-3.0, 0.4, 0.7, 0.1, 0.2, -0.1)
    turn = np.array([[np.cos(yaw), np.sin(yaw), 0], [-np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    along, start = rays(T) @ turn.T, turn @ T[:3, 3]
    first, last = (-half - start) / along, (half - start) / along  # the slab test
    enter, leave = np.minimum(first, last).max(axis=-1), np.maximum(first, last).min(axis=-1)
    check(rendered(box((0, 0, 0), half, yaw), kind, T), np.where(enter < leave, enter, 0.0), 0.04)


@both
def test_a_sphere(kind):
    """Tessellated so that its faces lie at most 0.15 mm within: r (1 - cos(half an angle))^2 about it."""
    radius, count = 0.8, 240
    polar = np.linspace(0.002, np.pi - 0.002, count // 2)[::-1]
    around = np.arange(count) * 2 * np.pi / count
    rings = [
        radius
        * np.column_stack([np.sin(p) * np.cos(around), np.sin(p) * np.sin(around), np.full(count, np.cos(p))])
        for p in polar
    ]
    T = at(-2.5, 0.3, 0.2, 0.0, 0.1, 0.1)
    d, start = rays(T), T[:3, 3]
    a, b, c = (d * d).sum(axis=-1), d @ start, start @ start - radius**2
    root = b * b - a * c
    expected = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, 0.0)
    depth = rendered(hull_of_rings(rings), kind, T)
    facing = root > 0.2 * a * radius**2  # towards the rim a hair within is far along the ray
    check(np.where(facing, depth, 0.0), np.where(facing, expected, 0.0), 0.05)


def disagreement(spec, count=8):
    """Differences [m] of the two renderers over every pixel that both see, away from depth edges."""
    world = build_world(spec, seed=1, worlds_dir=WORLDS)
    gl_renderer, ray_renderer = (make_renderer(world, LENS, 10.0, kind=kind) for kind in ("gl", "rays"))
    rng = np.random.default_rng([len(world.faces), count])
    low, high = world.region_m
    differences = []
    for _ in range(20 * count):
        place = rng.uniform(0.9 * low[:2] + 0.1 * high[:2], 0.1 * low[:2] + 0.9 * high[:2])
        T = at(*place, low[2] + rng.uniform(0.2, 2.0), 0.03, 0.08, rng.uniform(-3.1, 3.1))
        a, b = gl_renderer.depth(T), ray_renderer.depth(T)
        if not b.any() or b[b > 0].min() < NEAREST_M:
            continue
        steps = [np.abs(np.diff(b, axis=k, append=np.take(b, [-1], axis=k))) for k in (0, 1)]
        edge = np.maximum(*steps) > 0.1
        for k in (0, 1):
            edge |= np.roll(edge, 1, axis=k) | np.roll(edge, -1, axis=k)
        differences.append(np.abs(a - b)[~edge])
        if len(differences) == count:
            break
    gl_renderer.close()
    assert len(differences) == count
    return np.concatenate(differences)


MESHES = {
    "small_house.yaml": "aws_small_house",
    "ethz_forest.yaml": "ethz_forest",
    "parking_garage.yaml": "parking_garage",
}


@needs_egl
@pytest.mark.slow
@pytest.mark.parametrize("family", ["hall", *SIZES])
def test_both_renderers_agree_in_every_family(family):
    assert np.percentile(disagreement({"family": family}), 99) <= 0.01


@needs_egl
@pytest.mark.slow
@pytest.mark.parametrize("file", ["workshop.yaml", *MESHES])
def test_both_renderers_agree_in_every_mesh(file):
    if file in MESHES and not (WORLDS / MESHES[file]).is_dir():
        pytest.skip("the third-party meshes are not beside the checkout")
    assert np.percentile(disagreement({"file": file}), 99) <= 0.01
