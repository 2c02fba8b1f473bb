from __future__ import annotations

import numpy as np

from sim.bench.camera_rate import FRAMES, _walk, camera_rate
from sim.worlds.meshes import flat
from sim.worlds.world import make_world


def test_rows_say_what_was_measured_where():
    mesh = flat((-4, -4), (4, 4), 0.0)
    world = make_world("floor", mesh.vertices_m, mesh.faces, {})
    (row,) = camera_rate({"a floor": world}, renderer="rays", frames=6)
    assert row["world"] == "a floor"
    assert row["renderer"] == "embree"
    assert row["triangles"] == len(mesh.faces)
    assert 0.0 < row["frame_p50_ms"] <= row["frame_p99_ms"]
    assert row["rate_hz"] > 0.9e3 / row["frame_p99_ms"] * 0.9


def test_the_walk_stays_in_the_region_and_repeats():
    mesh = flat((-4, -2), (4, 2), 1.0)
    world = make_world("floor", mesh.vertices_m, mesh.faces, {})
    walk = np.array([pose.position_m for pose in _walk(world, FRAMES, 3)])
    assert (np.abs(walk[:, :2]) <= [3.2, 1.6]).all()
    assert np.ptp(walk[:, 0]) > 2.0
    assert (walk[:, 2] == 1.5).all()
    assert np.array_equal(walk, [pose.position_m for pose in _walk(world, FRAMES, 3)])
