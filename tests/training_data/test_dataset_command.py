"""`labr-mission dataset`: whole folders, going on with them, and what it refuses."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from labr_autonomy.cli import main
from labr_autonomy.errors import BadInput
from labr_autonomy.gkpn.shards import MANIFEST, read_folder, read_shard
from sim.training_data import folder as folders

FEW = ("--family", "hall,rooms", "--views", "4", "--goals", "2", "--size", "32", "18")

pytestmark = pytest.mark.slow


def run(*words):
    return CliRunner().invoke(main, ["dataset", *(str(word) for word in words)])


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    return folder, run(folder, *FEW, "--scenes", 3, "--jobs", 1, "--json")


def test_it_makes_what_it_says(made):
    folder, done = made
    assert done.exit_code == 0
    answer = json.loads(done.stdout)
    assert (answer["made"], answer["kept"]) == (3, 0)
    counts = answer["counts"]
    assert (counts["scenes"], counts["views"], counts["goals"]) == (3, 12, 24)
    shards = [read_shard(path) for path in read_folder(folder)]
    assert sorted(shard.seed for shard in shards) == [1_000_000, 1_000_001, 1_000_002]
    assert {shard.family for shard in shards} <= {"hall", "rooms"}
    assert all(shard.images_mm.shape == (4, 18, 32) for shard in shards)
    assert counts["hard_share"] == pytest.approx(np.mean([s.hard.mean() for s in shards]), abs=1e-4)
    assert counts["air_share"] == pytest.approx(np.mean([s.in_air.mean() for s in shards]), abs=1e-4)
    assert answer["settings"]["camera"]["width"] == 424


def test_two_processes_make_the_same_bytes(made, tmp_path):
    folder, _ = made
    done = run(tmp_path, *FEW, "--scenes", 3, "--jobs", 2, "--quiet")
    assert done.exit_code == 0
    assert done.stderr == ""
    assert json.loads((tmp_path / MANIFEST).read_text()) == json.loads((folder / MANIFEST).read_text())


def test_it_goes_on_where_it_was_stopped_and_makes_damaged_shards_anew(made, tmp_path):
    folder, _ = made
    names = [path.name for path in read_folder(folder)]
    first = json.loads(run(tmp_path, *FEW, "--scenes", 2, "--jobs", 1, "--json").stdout)
    assert first["made"] == 2
    there = [path.name for path in read_folder(tmp_path)]
    damaged, whole = (tmp_path / name for name in there)
    damaged.write_bytes(damaged.read_bytes()[:-5])
    (tmp_path / ".hall-9.npz.1.part").write_bytes(b"half")
    stamp = whole.stat().st_mtime_ns
    again = json.loads(run(tmp_path, *FEW, "--scenes", 3, "--jobs", 1, "--json").stdout)
    assert (again["made"], again["kept"]) == (2, 1)
    assert whole.stat().st_mtime_ns == stamp
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*names, MANIFEST])
    assert (tmp_path / MANIFEST).read_text() == (folder / MANIFEST).read_text()


def test_a_stop_in_the_middle_leaves_whole_shards_that_are_kept(made, tmp_path, monkeypatch):
    folder, _ = made
    real, turns = folders.build_scene, []

    def stopped(*arguments):
        turns.append(arguments)
        if len(turns) == 2:
            raise KeyboardInterrupt
        return real(*arguments)

    monkeypatch.setattr(folders, "build_scene", stopped)
    assert run(tmp_path, *FEW, "--scenes", 3, "--jobs", 1).exit_code == 5
    assert len(read_folder(tmp_path)) == 1
    monkeypatch.setattr(folders, "build_scene", real)
    again = json.loads(run(tmp_path, *FEW, "--scenes", 3, "--jobs", 1, "--json").stdout)
    assert (again["made"], again["kept"]) == (2, 1)
    assert (tmp_path / MANIFEST).read_text() == (folder / MANIFEST).read_text()


def test_a_scene_that_offers_nothing_is_passed_over_and_named(tmp_path, monkeypatch):
    real = folders.build_scene

    def barren(name, spec, seed, *rest):
        if seed % 2:
            raise BadInput("the world offers no walk", "Take another.")
        return real(name, spec, seed, *rest)

    monkeypatch.setattr(folders, "build_scene", barren)
    answer = json.loads(run(tmp_path, *FEW, "--scenes", 2, "--jobs", 1, "--json").stdout)
    assert answer["counts"]["scenes"] == 1
    assert "1000001.npz" in answer["skipped"][0]["file"]
    nothing = run(tmp_path / "none", *FEW, "--scenes", 1, "--seed", 1_000_001, "--jobs", 1)
    assert nothing.exit_code == 2
    assert "no scene could be made: the world offers no walk" in nothing.stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--goals", 3), "with 'goals' 2, not 3"),
        (("--seed", 1_000_500), "with 'seed' 1000000, not 1000500"),
        (("--size", 160, 90), "with 'height' 18, not 90"),
        (("--family", "hall"), "with 'worlds' "),
        (("--scenes", 2), "3 scenes, more than are asked for"),
    ],
)
def test_a_folder_of_other_settings_is_refused_and_left_alone(made, words, said):
    folder, _ = made
    before = (folder / MANIFEST).read_bytes()
    done = run(folder, *FEW, "--scenes", 3, *words)
    assert done.exit_code == 2
    assert said in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert (folder / MANIFEST).read_bytes() == before


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--seed", 5), "one of the benchmark's worlds"),
        (("--family", "castle"), "no world family 'castle'"),
        (("--seed", 2**31 - 1, "--scenes", 2), "last scene's seed"),
        (("--family", ""), "no world is named"),
        (("--world", "nowhere.yaml"), "nowhere.yaml"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(tmp_path, words, said):
    done = run(tmp_path / "data", *words)
    assert done.exit_code == 2
    assert said in done.stderr
    assert not (tmp_path / "data").exists()


def test_a_small_seed_is_allowed_on_demand_and_in_mesh_worlds(tmp_path):
    assert run(tmp_path / "a", *FEW, "--scenes", 1, "--seed", 5, "--any-seed", "--jobs", 1).exit_code == 0
    words = ("--world", "workshop.yaml", "--scenes", 1, "--seed", 5, "--views", 4, "--goals", 2, "--jobs", 1)
    done = run(tmp_path / "b", *words)
    assert done.exit_code == 0
    assert "1 scenes (1 made, 0 kept), 4 views, 8 goals" in done.stdout
    assert [read_shard(path).family for path in read_folder(tmp_path / "b")] == ["workshop"]
