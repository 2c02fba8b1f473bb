"""`labr-mission bench transitions`: its figures, its exit codes, and Ctrl-C."""

import json

import pytest
from click.testing import CliRunner

from labr_autonomy.cli import main
from sim.bench.transitions import trial
from sim.bench.transitions.trial import Hop, draw


@pytest.fixture
def flown(monkeypatch):
    """The command on trials that cost nothing; what a seed does can be changed."""
    does = {}

    def fly(seed, *, whole):
        does.setdefault("whole", []).append(whole)
        change = does.get(seed, {})
        if isinstance(change, BaseException):
            raise change
        values = dict(
            conditions=draw(seed), done=True, reason="", stop_error_m=0.03, landing_error_m=0.05,
            touchdown_mps=0.34, tilt_deg=1.0, time_s=24.0,
        )  # fmt: skip
        return Hop(**{**values, **change})

    monkeypatch.setattr(trial, "fly", fly)
    return does


def run(*words):
    return CliRunner().invoke(main, ["bench", "transitions", "--jobs", "1", *(str(w) for w in words)])


def test_all_done_ends_with_0_and_leaves_every_trial(flown, tmp_path):
    done = run("--trials", 5, "--seed", 10, "--out", tmp_path / "run")
    assert done.exit_code == 0, done.output
    assert "5 of 5 hand-overs done" in done.output
    assert "wanted p99 <= 0.1" in done.output
    kept = json.loads((tmp_path / "run" / "results.json").read_text())
    assert [row["conditions"]["seed"] for row in kept["rows"]] == [10, 11, 12, 13, 14]
    assert kept["command"] == "labr-mission bench transitions --trials 5 --seed 10"


def test_a_failure_is_named_and_ends_with_4(flown, tmp_path):
    flown[3] = {"done": False, "reason": "it never stood again"}
    done = run("--trials", 5, "--out", tmp_path / "run", "--json")
    assert done.exit_code == 4
    answer = json.loads(done.stdout)
    assert (answer["trials"], answer["done"]) == (5, 4)
    assert answer["failed"] == [{"seed": 3, "reason": "it never stood again"}]
    assert "rows" not in answer


def test_ctrl_c_tells_the_figures_so_far_and_ends_with_5(flown, tmp_path):
    flown[2] = KeyboardInterrupt()
    done = run("--trials", 5, "--out", tmp_path / "run")
    assert done.exit_code == 5
    assert "2 of 2 hand-overs done" in done.output
    assert "stopped by the operator after 2 of 5" in done.output
    assert len(json.loads((tmp_path / "run" / "results.json").read_text())["rows"]) == 2
    flown[0] = KeyboardInterrupt()
    done = run("--trials", 5, "--out", tmp_path / "run")
    assert done.exit_code == 5
    assert "before the first" in done.output


def test_whole_flights_are_asked_for(flown, tmp_path):
    done = run("--trials", 2, "--whole", "--out", tmp_path / "run", "--json")
    assert flown["whole"] == [True, True]
    assert json.loads(done.stdout)["command"].endswith("--whole")


def test_bad_input_ends_with_2(flown):
    assert run("--trials", 0).exit_code == 2
