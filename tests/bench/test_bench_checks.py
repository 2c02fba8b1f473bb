"""`bench crosscheck` and `bench camera` from arguments to exit codes; what they call is replaced."""

import json

import bench_fakes as fakes
import pytest
from click.testing import CliRunner

from labr_autonomy import cli
from sim.bench import camera_rate, crosscheck, tasks
from sim.bench.crosscheck import Pair
from sim.bench.settings import Place
from sim.worlds import build

REACHED = ("reached", "reached")


@pytest.fixture
def call(monkeypatch, tmp_path):
    """The command, with given pairs in place of flights."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tasks, "sample_task", lambda spec, seed, robot: fakes.make_task(seed))

    def run(pairs, *arguments):
        monkeypatch.setattr(crosscheck, "cross_check", lambda asked, robot, folder: iter(pairs))
        return CliRunner().invoke(cli.main, ["bench", "crosscheck", *arguments])

    return run


def pair(seed, factor):
    return Pair("indoor", seed, False, REACHED, (10.0, 10.0 * factor), (20.0, 20.0), (1000.0, 1000.0))


def test_agreement_ends_well_and_is_kept(call, tmp_path):
    done = call([pair(k, 1.02) for k in range(5)], "--trials", "3", "--out", str(tmp_path / "cc"))
    assert done.exit_code == 0, done.output
    assert "3 of 3 trials reached both ways" in done.stdout
    kept = json.loads((tmp_path / "cc" / "crosscheck.json").read_text())
    assert len(kept["rows"]) == 3
    assert kept["agrees"]


def test_disagreement_ends_with_4_and_machines_get_json(call):
    done = call([pair(k, 1.3) for k in range(3)], "--trials", "3", "--json")
    assert done.exit_code == 4
    assert json.loads(done.stdout)["path_m"]["median_difference"] == pytest.approx(1.0 - 1.0 / 1.3)


def test_an_unknown_family_is_refused(call):
    done = call([], "--family", "cave")
    assert done.exit_code == 2
    assert "no world family 'cave'" in done.stderr


def test_the_camera_is_timed_in_a_world_of_each_kind(monkeypatch):
    def rate(worlds, renderer, frames):
        return [
            {"world": name, "triangles": 7, "renderer": renderer, "frame_p50_ms": 2.0, "frame_p99_ms": 3.0,
             "rate_hz": float(frames)}
            for name in worlds
        ]  # fmt: skip

    monkeypatch.setattr(camera_rate, "camera_rate", rate)
    monkeypatch.setattr(build, "build_world", lambda spec, seed: object())
    monkeypatch.setattr("sim.bench.settings.world_place", lambda path, _: Place(path.stem, {}))
    done = CliRunner().invoke(cli.main, ["bench", "camera", "--frames", "12", "--json"])
    assert done.exit_code == 0, done.output
    rows = json.loads(done.stdout)["rows"]
    assert [row["world"] for row in rows] == ["indoor", "rooms", "garage", "forest", "workshop"]
    assert {row["rate_hz"] for row in rows} == {12.0}
