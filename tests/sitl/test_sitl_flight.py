"""A whole mission through the command line: every seam real, the simulator at their ends."""

import contextlib
import json
import subprocess

import numpy as np
import pytest
import trimesh
from sitl_rig import alive, family, leftovers, start_flight, write_mission

from labr_autonomy.record.mcap_reader import read_log
from labr_autonomy.record.summary import read_summary

pytestmark = [pytest.mark.sitl, pytest.mark.timeout(180)]

FIGURES = ("tick_late_ms", "plan_cycle_ms", "setpoint_age_ms")


def test_it_drives_takes_off_lands_and_drives_home_and_leaves_nothing_behind(tmp_path):
    before = leftovers()
    mission = write_mission(
        tmp_path, "goto: {x: 0.5, y: 1.0}", "goto: {x: 1.5, y: 2.0, z: 1.2}", "land: {}", "return: {}"
    )
    process = start_flight(mission, tmp_path, "--json")
    seen = set()
    while process.poll() is None:
        seen.update(family(process.pid))
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=0.5)
    log = (tmp_path / "fly.log").read_text()
    assert process.returncode == 0, log
    run = next(p for p in tmp_path.iterdir() if p.is_dir())
    summary = read_summary(run)
    assert json.loads(log.splitlines()[-1])["outcome"] == summary["outcome"] == "success"
    assert summary["contacts"] == 0
    assert summary["land_m"] >= 3.0
    assert summary["air_m"] >= 1.0
    assert len(summary["goal_errors_m"]) == 3
    assert max(summary["goal_errors_m"]) < 0.5
    assert min(summary["energy_land_j"], summary["energy_air_j"], summary["energy_transition_j"]) > 0.0
    for name in FIGURES:
        assert summary[name]["p50"] is not None
        assert summary[name]["p99"] >= summary[name]["p50"]
    for name in ("mission.yaml", "air.tlog", "ground.tlog", "report.html", "robot.yaml"):
        assert (run / name).stat().st_size > 0
    topics = {topic for topic, _ in read_log(run / "flight.mcap")}
    assert {"/odometry", "/setpoint", "/plan", "/mode", "/event", "/depth", "/battery"} <= topics
    assert len(seen) >= 3  # simulator, camera, planner
    assert not [pid for pid in seen if alive(pid)]
    assert leftovers() == before


def test_a_goal_inside_an_obstacle_is_refused_before_anything_moves(tmp_path):
    floor = trimesh.creation.box((14.0, 10.0, 0.1)).apply_translation((0, 0, -0.05))
    crate = trimesh.creation.box((1.0, 1.0, 1.0)).apply_translation((0.5, 1.0, 0.5))
    world = trimesh.util.concatenate([floor, crate])
    np.savez(tmp_path / "crate.npz", V=world.vertices.astype(np.float32), F=world.faces.astype(np.int32))
    mission = write_mission(tmp_path, "goto: {x: 0.5, y: 1.0}")
    mission.write_text(mission.read_text().replace("{family: hall, size_m: [14, 10]}", "{mesh: crate.npz}"))
    process = start_flight(mission, tmp_path, "--worlds", str(tmp_path))
    assert process.wait(timeout=120) == 3
    run = next(p for p in tmp_path.iterdir() if p.is_dir())
    summary = read_summary(run)
    assert summary["outcome"] == "refused"
    assert "inside an obstacle" in summary["reason"]
    assert summary["land_m"] == 0.0
    assert "Traceback" not in (tmp_path / "fly.log").read_text()


def test_a_goal_outside_the_fence_is_refused_before_anything_moves(tmp_path):
    process = start_flight(write_mission(tmp_path, "goto: {x: 8.5, y: 0.0}"), tmp_path)
    assert process.wait(timeout=120) == 3
    assert "outside fence" in (tmp_path / "fly.log").read_text()
