"""Table I from trained networks: what is compared, what is refused, and what is said of chance."""

from __future__ import annotations

import json
import shutil

import bench_fakes as fakes
import numpy as np
import pytest
from click.testing import CliRunner

from labr_autonomy import cli
from labr_autonomy.errors import BadInput
from labr_autonomy.gkpn.package import ONNX_NAME, TENSORS_NAME, write_manifest
from sim.bench import run, statistics
from sim.bench.alone.trained import VARIANTS, find_trained
from sim.bench.effects import effect, sentence, sentences
from sim.bench.paper import GOAL_REACHED_PCT, TABLE_1

onnx = pytest.importorskip("onnx")


def model(height, width):
    """A file with the inputs and outputs of a planning network."""
    value, real = onnx.helper.make_tensor_value_info, onnx.TensorProto.FLOAT
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("Identity", ["goal"], ["points"])],
        "fake",
        [value("depth", real, [1, 1, height, width]), value("goal", real, [1, 3])],
        [value("points", real, [1, 3])],
    )
    made = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=8)
    return made.SerializeToString()


def put(runs, name, seed=0, *, loss=2.0, size=(90, 160), folder=None, **facts):
    """One weights' folder."""
    into = runs / (folder or f"{name}-s{seed}")
    into.mkdir(parents=True)
    (into / ONNX_NAME).write_bytes(model(*size))
    values = {"name": name, "training": {"seed": seed, "loss": loss, "steps": 100}}
    (into / TENSORS_NAME).write_bytes(b"not looked at")
    write_manifest(into, values | facts)
    return into


@pytest.fixture
def runs(tmp_path):
    """All four variants, two trainings each."""
    folder = tmp_path / "trained"
    for number, variant in enumerate(VARIANTS):
        for seed in (0, 1):
            put(folder, f"{variant}-160", seed, loss=4.0 - number + 0.5 * seed)
    return folder


# ---------------------------------------------------------------- the command
def work(job):
    """SPN reaches all; LAPN changes nothing; without SPN every third trial touches something."""
    hits = (
        job.method != "oracle" and "spn" not in job.method and "gkpn" not in job.method and job.seed % 3 == 0
    )
    answer = fakes.fly_well(job)
    return answer if not hits else type(answer)(answer.task, fakes.make_result(outcome="contact"))


@pytest.fixture
def table1(monkeypatch, tmp_path):
    """`labr-mission bench table1 ...` with flights of no cost."""
    monkeypatch.chdir(tmp_path)
    state = {}

    def make(*_, **__):
        state["executor"] = fakes.Inline(state["work"])
        return state["executor"]

    monkeypatch.setattr(run, "make_executor", make)

    def call(*arguments, work=work):
        state["work"] = work
        done = CliRunner().invoke(cli.main, ["bench", "table1", *(str(a) for a in arguments)])
        return done, state.get("executor")

    return call


@pytest.mark.slow
def test_the_table_sets_networks_beside_the_paper_and_says_what_helps(table1, runs, tmp_path):
    out = tmp_path / "run"
    asked = ("--runs", runs, "--family", "rooms,forest", "--trials", 9, "--seed", 0, "--out", out, "--json")
    done, executor = table1(*asked)
    assert done.exit_code == 0, done.output
    results = json.loads(done.stdout)
    assert results == json.loads((out / "results.json").read_text())
    assert results["input"] == {"width": 160, "height": 90}
    assert len(executor.flown) == 2 * 9 * (1 + 8)
    rows = {(row["family"], row["variant"]): row for row in results["rows"]}
    assert list(rows) == [(family, variant) for family in ("rooms", "forest") for variant in VARIANTS]
    plain, ours = rows["rooms", "iplanner"], rows["rooms", "gkpn"]
    assert (plain["spn"], plain["lapn"], ours["spn"], ours["lapn"]) == (False, False, True, True)
    assert plain["trials"] == ours["trials"] == 18
    assert plain["loss"] == 4.25
    assert plain["reached_pct"] == pytest.approx(200.0 / 3.0)
    assert plain["contact_pct"] == pytest.approx(100.0 / 3.0)
    assert plain["reached_pct_ci95"][0] < 66.7 < plain["reached_pct_ci95"][1] < 100.0
    assert ours["reached_pct"] == 100.0
    assert ours["reached_pct_ci95"][0] < 100.0  # not certain for all that
    assert plain["paper"] == {"loss": 3.671, "reached_pct": 64.0}
    spn, lapn, both = results["effects"]
    assert spn["difference_pct"] == pytest.approx(100.0 / 3.0)
    assert lapn["difference_pct"] == pytest.approx(0.0)
    assert both["pairs"] == [["gkpn", "iplanner"]]
    page = (out / "results.md").read_text()
    assert "SPN: it helps; +33.3 points of goals reached [" in page
    assert "LAPN: no effect that can be told apart from chance; +0.0 points" in page
    assert "images of 160x90" in page
    assert "| SPN + LAPN | yes | yes | 2 | 1.250 | 3.221 | 18 | 100 [82, 100] | 76 | 100 | 100 |" in page
    assert plain["reached_land_pct"] == pytest.approx(60.0)  # seeds 0 and 6 of 0, 2, 4, 6, 8
    assert plain["reached_air_pct"] == 75.0  # seed 3 of 1, 3, 5, 7
    assert plain["timeout_pct"] == 0.0


@pytest.mark.slow
def test_it_goes_on_where_it_was_stopped_and_refuses_other_weights(table1, runs, tmp_path):
    asked = ("--runs", runs, "--family", "rooms", "--trials", 3, "--out", tmp_path / "run")

    def stop(job):
        if job.seed == 1 and "gkpn" in job.method:
            raise KeyboardInterrupt
        return work(job)

    done, before = table1(*asked, work=stop)
    assert done.exit_code == 5
    done, after = table1(*asked)
    assert done.exit_code == 0, done.output
    assert not set(before.flown[:-1]) & set(after.flown)  # the last one was stopped on its way
    assert len(after.flown) > 0
    put(runs, "gkpn-160", 0, folder="again", size=(90, 160))
    shutil.rmtree(runs / "gkpn-160-s0")
    done, _ = table1(*asked)
    assert done.exit_code == 2
    assert "holds a benchmark with other settings" in done.stderr


@pytest.mark.slow
def test_a_flight_in_which_the_program_fails_is_in_no_figure(table1, runs, tmp_path):
    def fails(job):
        if job.seed == 2 and job.method.endswith("spn-160-s1"):
            raise ValueError("at a loss")
        return work(job)

    out = tmp_path / "run"
    done, _ = table1("--runs", runs, "--family", "rooms", "--trials", 4, "--out", out, work=fails)
    assert done.exit_code == 1
    assert "program failed in 1 of" in done.stderr
    results = json.loads((out / "results.json").read_text())
    trials = {row["variant"]: row["trials"] for row in results["rows"]}
    assert trials == {"iplanner": 8, "lapn": 8, "spn": 6, "gkpn": 8}
    assert results["effects"][0]["trials"] == 3  # SPN is judged over what all four have flown
    assert "Flights in which the program failed" in (out / "results.md").read_text()


# ---------------------------------------------------------------- what is compared
def test_networks_are_found_in_the_order_of_the_paper(runs):
    trained = find_trained(runs)
    assert [(t.variant, t.seed) for t in trained] == [(v, s) for v in VARIANTS for s in (0, 1)]
    assert trained[0].method == f"network@{runs / 'iplanner-160-s0'}"
    assert (trained[0].height, trained[0].width) == (90, 160)


def test_resolutions_are_not_mixed(runs):
    put(runs, "gkpn", 7, size=(384, 640))
    with pytest.raises(BadInput, match=r"images of 160x90 and .*gkpn-s7 of 640x384") as refused:
        find_trained(runs)
    assert str(refused.value).count(". ") == 1


@pytest.mark.parametrize(
    ("facts", "words"),
    [
        ({"name": "two-heads-160"}, "'two-heads-160', which is no row of Table I"),
        (
            {"name": "gkpn-160", "training": {"seed": 0, "loss": 1.0, "steps": 1}},
            "both gkpn trained with seed 0",
        ),
        ({"name": "gkpn-160", "training": {"seed": 5, "steps": 1}}, "does not tell the training's loss"),
        ({"name": "gkpn-160", "training": {"seed": None, "loss": 1.0}}, "does not tell the training's seed"),
    ],
)
def test_networks_that_cannot_be_compared_are_refused(runs, facts, words):
    put(runs, folder="other", **({"seed": 9} | facts))
    with pytest.raises(BadInput, match=words):
        find_trained(runs)


def test_an_empty_folder_is_refused(table1, tmp_path):
    done, _ = table1("--runs", tmp_path, "--family", "rooms")
    assert done.exit_code == 2
    assert "holds no trained network" in done.stderr


def test_the_paper_says_in_both_places_the_same():
    assert GOAL_REACHED_PCT["indoor"] == {"two-stage": 91.0, "iplanner": 86.0}
    assert set(TABLE_1) == {"indoor", "rooms", "garage", "forest"}
    assert all(set(rows) == set(VARIANTS) for rows in TABLE_1.values())


# ---------------------------------------------------------------- chance
def coins(share, shape=(3, 200), seed=0):
    return (np.random.default_rng(seed).random(shape) < share).astype(float)


def test_an_effect_is_told_apart_from_chance_only_when_it_can_be():
    found = effect("SPN", {"iplanner": coins(0.5), "spn": coins(0.9, seed=1)}, 0)
    assert "it helps" in sentence(found)
    assert found["pairs"] == [["spn", "iplanner"]]
    assert found["difference_pct"] == pytest.approx(40.0, abs=8.0)
    harm = effect("SPN", {"iplanner": coins(0.9), "spn": coins(0.5, seed=1)}, 0)
    assert "it harms" in sentence(harm)
    none = effect("LAPN", {"iplanner": coins(0.5), "lapn": coins(0.52, seed=2)}, 0)
    assert "no effect that can be told apart from chance" in sentence(none)
    once = effect("LAPN", {"iplanner": coins(0.5, (1, 200)), "lapn": coins(0.9, (1, 200), seed=1)}, 0)
    assert "trained only once: the chance of training is not in the interval" in sentence(once)
    assert effect("LAPN", {"iplanner": coins(0.5), "gkpn": coins(0.5)}, 0) is None
    assert sentences([]) == [
        "Whether SPN and LAPN help is not told: no two of the networks differ in one of them alone."
    ]


def test_an_effect_of_one_trial_is_never_certain():
    one = {"iplanner": np.zeros((2, 1)), "gkpn": np.ones((2, 1))}
    assert "told apart from chance" in sentence(effect("SPN and LAPN together", one, 0))


def test_the_chance_of_training_widens_the_interval_and_shared_trials_narrow_it():
    hard = coins(0.5, (1, 300))
    same = statistics.bootstrap_crossed([np.repeat(hard, 3, axis=0)] * 2, [1.0, -1.0], 0)
    assert same == (0.0, 0.0)  # the same flights differ in nothing, whichever are drawn
    apart = statistics.bootstrap_crossed([coins(0.5, (1, 300)), coins(0.5, (1, 300), seed=1)], [1.0, -1.0], 0)
    assert apart[1] - apart[0] > 0.1
    uneven = np.concatenate([np.zeros((1, 300)), np.ones((1, 300))])
    low, high = statistics.bootstrap_crossed([uneven], [1.0], 0)
    assert (low, high) == (0.0, 1.0)  # of two trainings one always fails: nothing is known of a third
    assert statistics.bootstrap_crossed([np.ones((3, 1))], [1.0], 0) is None
