from __future__ import annotations

import dataclasses
import io

import bench_fakes as fakes
import numpy as np
import pytest
from matplotlib import image

from sim.bench import gallery, pictures
from sim.bench.jobs import Answer
from sim.bench.run import run_bench, write_results
from sim.bench.settings import open_folder
from sim.worlds.meshes import box, flat, merged
from sim.worlds.world import make_world

PATH = [(-4.0, 0.0), (-3.0, 1.5), (-1.0, 2.5), (1.0, 2.5), (3.0, 1.6), (4.0, 1.0)]


def pixels(png):
    return image.imread(io.BytesIO(png))[:, :, :3]


def share_of(png, colour):
    """Share of pixels of nearly a colour [per mille]."""
    rgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    return 1000.0 * float((np.abs(pixels(png) - rgb).max(axis=2) < 0.06).mean())


def fly(job):
    """Round through the hall; mapping stops half-way, iplanner meets a wall in odd seeds."""
    task = job.task or dataclasses.replace(
        fakes.make_task(job.seed), world={"family": "hall", "size_m": [12.0, 8.0], "seed": 4, "clear_m": []}
    )
    count = {"mapping": 3, "iplanner": 4}.get(job.method, len(PATH))
    flown = [int(task.in_air and i >= len(PATH) - 2) for i in range(count)]
    track = [
        (float(i), x, y, 1.2 if f else 0.12, f)
        for i, ((x, y), f) in enumerate(zip(PATH, flown, strict=False))
    ]
    outcome = {"mapping": "stopped", "iplanner": "contact"}.get(job.method, "reached")
    energy_j = 1000.0 if job.method == "oracle" else 1400.0 + 100.0 * (job.seed % 3)
    return Answer(task, fakes.make_result(track=track, outcome=outcome, energy_land_j=energy_j))


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench") / "run"
    settings = fakes.settings(trials=3)
    open_folder(settings, folder, resume=False)
    findings = run_bench(settings, folder, lambda: fakes.Inline(fly), lambda _: None)
    results = findings.results()
    write_results(folder, results, "# Page\n")
    gallery.draw_navigation(findings, results)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("name", ["summary.png", "ways-indoor.png", "failures-indoor.png"])
def test_every_picture_is_there_and_named_in_the_page(drawn, name):
    assert f"]({name})" in (drawn / "results.md").read_text()
    assert pixels((drawn / name).read_bytes()).std() > 0.05


@pytest.mark.slow
def test_ways_show_driven_flown_and_walls(drawn):
    png = (drawn / "ways-indoor.png").read_bytes()
    for colour in (pictures.LAND, pictures.AIR, pictures.WALL, pictures.BAD):
        assert share_of(png, colour) > 0.1, colour


@pytest.mark.slow
def test_failures_show_what_the_camera_sees(drawn):
    png = (drawn / "failures-indoor.png").read_bytes()
    assert share_of(png, pictures.BAD) > 0.1
    assert share_of(png, "#2b2f36") > 0.5  # beyond the camera's range


def test_without_failures_there_is_no_gallery():
    assert gallery.failures({"mapping": []}, "indoor") is None
    assert gallery.ways({"mapping": []}, "indoor") is None


def test_the_cut_of_a_box_is_its_outline_and_the_floor_is_not_drawn():
    mesh = merged([flat((-3, -3), (3, 3), 0.0), box((1.0, 0.0, 0.5), (0.5, 0.25, 0.5))])
    world = make_world("w", mesh.vertices_m, mesh.faces, {})
    segments = pictures.outlines(world, np.array([0.0]))
    assert np.abs(segments[..., 0] - 1.0).max() == pytest.approx(0.5)
    assert np.abs(segments[..., 1]).max() == pytest.approx(0.25)
    lengths = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    assert lengths.sum() == pytest.approx(len(pictures.CUTS_M) * 3.0)


def test_what_hangs_above_the_robot_is_not_cut():
    mesh = box((0.0, 0.0, 1.0), (0.5, 0.5, 0.3))
    world = make_world("w", mesh.vertices_m, mesh.faces, {})
    assert pictures.outlines(world, np.array([0.0])).shape == (0, 2, 2)
    assert len(pictures.outlines(world, np.array([0.7]))) > 0


def test_the_last_depth_looks_along_the_last_motion():
    mesh = merged([flat((-5, -5), (5, 5), 0.0), box((0.0, 3.0, 1.0), (2.0, 0.1, 1.0))])
    world = make_world("w", mesh.vertices_m, mesh.faces, {})
    track = [(0.0, 0.0, -1.0, 0.12, 0), (1.0, 0.0, 0.0, 0.12, 0), (2.0, 0.0, 0.0, 0.12, 0)]
    depth = pictures.last_depth(world, fakes.make_result(track=track))
    height, width = depth.shape
    assert depth[height // 2, width // 2] == pytest.approx(2.9 - 0.14, abs=0.01)
    assert pictures.last_depth(world, fakes.make_result(track=track[1:])) is None
    assert pictures.last_depth(world, fakes.make_result(track=[])) is None


def test_a_trial_without_a_way_in_a_world_that_asks_for_more_is_drawn_too():
    task = fakes.make_task(4)
    task.world.update(start=[-4.0, 0.0, 0.0, 0.0], goals=[[4.0, 1.0]])
    png = pictures.trial_picture(task, fakes.make_result(track=[], outcome="stopped"), "t")
    assert share_of(png, pictures.WALL) > 0.1
