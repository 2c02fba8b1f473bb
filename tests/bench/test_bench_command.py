from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import bench_fakes as fakes
import numpy as np
import pytest
from click.testing import CliRunner

from labr_autonomy import cli
from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput
from sim.bench import jobs, methods, run
from sim.bench.settings import world_place

ROW_KEYS = {  # design.md, "Contracts", and what the benchmark adds
    *("family", "method", "trials", "reached_pct", "contact_pct", "timeout_pct", "time_s", "land_m", "air_m"),
    *("energy_j", "energy_over_oracle", "spl", "min_clearance_m", "plan_cycle_ms", "stopped_pct", "invalid"),
    *("energy_land_j", "energy_air_j", "energy_transition_j", "reached_land_pct", "reached_air_pct"),
    *("worst_seeds", "errors", "reached_pct_ci95", "energy_j_ci95", "energy_over_oracle_ci95", "spl_ci95"),
}


@pytest.fixture
def bench(monkeypatch, tmp_path):
    """`labr-mission bench ...` with flights of no cost, in an empty working directory."""
    monkeypatch.chdir(tmp_path)
    state = {"work": fakes.fly_well, "before": None}
    monkeypatch.setattr(run, "make_executor", lambda *_, **__: fakes.Inline(state["work"], state["before"]))

    def call(*arguments, work=fakes.fly_well, before=None):
        state.update(work=work, before=before)
        return CliRunner().invoke(cli.main, ["bench", *(str(a) for a in arguments)])

    return call


def test_json_holds_the_contract(bench):
    done = bench(
        "navigation", "--family", "indoor,forest", "--trials", 7, "--json", "--no-pictures", work=_survivable
    )
    assert done.exit_code == 1  # two flights of each family failed in the program
    results = json.loads(done.stdout)
    assert set(results) >= {"command", "seed", "versions", "rows"}
    assert [(r["family"], r["method"]) for r in results["rows"]] == [
        (f, m) for f in ("indoor", "forest") for m in methods.METHODS
    ]
    for row in results["rows"]:
        assert row.keys() >= ROW_KEYS
        assert set(row["plan_cycle_ms"]) == {"p50", "p99", "max"}
    mapping = next(r for r in results["rows"] if (r["family"], r["method"]) == ("indoor", "mapping"))
    assert mapping["trials"] == 3 + 1  # of 7: one is invalid, two died; the last of the rest is a contact
    assert mapping["reached_pct"] == 75.0
    assert mapping["contact_pct"] == 25.0
    assert mapping["energy_over_oracle"] == 1.5
    assert mapping["energy_over_oracle_ci95"] == [1.5, 1.5]
    assert mapping["spl"] == pytest.approx(0.75 * 0.9)
    assert mapping["min_clearance_worst_m"] == -0.01
    assert mapping["worst_seeds"][0] == fakes.FAILS
    assert "program failed in" in done.stderr


def _survivable(job):
    if job.seed == fakes.CRASHES:
        raise ValueError("no crash in this process")
    return fakes.fly(job)


def test_a_good_run_prints_a_table_and_names_the_folder(bench, tmp_path):
    done = bench("navigation", "--family", "rooms", "--trials", 3, "--out", tmp_path / "run", "--no-pictures")
    assert done.exit_code == 0, done.output
    assert "two-stage" in done.stdout
    assert "iplanner (land)" in done.stdout
    assert str(tmp_path / "run" / "results.md") in done.stdout
    assert "11/11 flights, 11 reached (100 %)" in done.stderr
    assert (tmp_path / "run" / "results.md").is_file()
    assert not list((tmp_path / "run").glob("*.png"))


def test_without_out_a_folder_is_made_in_runs_and_resume_finds_it(bench, tmp_path):
    arguments = ("navigation", "--family", "rooms", "--trials", 2, "--no-pictures")
    assert bench(*arguments).exit_code == 0
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.endswith("-bench-navigation")
    done = bench(*arguments, "--resume", before=lambda job: pytest.fail(f"flown again: {job}"))
    assert done.exit_code == 0, done.output
    assert list((tmp_path / "runs").iterdir()) == [folder]


def test_ctrl_c_keeps_what_is_done_and_says_how_to_go_on(bench, tmp_path):
    def interrupt(job):
        if job.seed == 1:
            raise KeyboardInterrupt

    arguments = (
        "navigation",
        "--family",
        "indoor",
        "--trials",
        3,
        "--out",
        tmp_path / "run",
        "--no-pictures",
    )
    done = bench(*arguments, before=interrupt)
    assert done.exit_code == 5
    assert done.stderr.splitlines()[-1].startswith("labr-mission: stopped by the operator after")
    assert "Continue by the same command with --out" in done.stderr
    assert not (tmp_path / "run" / "results.json").exists()
    assert bench(*arguments, "--resume").exit_code == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("navigation",), "no world is named"),
        (("navigation", "--family", "moon"), "no world family 'moon'"),
        (("navigation", "--family", "indoor,indoor"), "two worlds are called 'indoor'"),
        (("navigation", "--family", "indoor", "--method", "magic"), "no method 'magic'"),
        (("navigation", "--family", "indoor", "--method", ""), "no method is named"),
        (("navigation", "--world", "nowhere.yaml"), "nowhere.yaml"),
        (("navigation", "--family", "indoor", "--out", "nowhere", "--resume"), "no benchmark to resume"),
        (("table3", "--method", "magic"), "no method 'magic'"),
        (("navigation", "--world", "w.yaml", "--difficulty", "0.2"), "--difficulty is of generated worlds"),
    ],
)
def test_bad_input_is_one_sentence_and_code_2(bench, arguments, words):
    done = bench(*arguments)
    assert done.exit_code == 2
    assert words in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    as_json = bench(*arguments, "--json")
    assert as_json.exit_code == 2
    assert words in json.loads(as_json.stdout)["error"]["what"]


def test_differing_settings_are_named(bench, tmp_path):
    first = ("navigation", "--family", "indoor", "--trials", 2, "--out", tmp_path / "run", "--no-pictures")
    assert bench(*first).exit_code == 0
    done = bench(*first, "--seed", 5)
    assert done.exit_code == 2
    assert "seed was 0 and is 5 now" in done.stderr


def write_floor(folder):
    """A floor of 12 x 12 m as a mesh file."""
    corners = np.array([[0, 0, 0], [12, 0, 0], [12, 12, 0], [0, 12, 0]], dtype=np.float32)
    np.savez(folder / "house.npz", V=corners, F=np.array([[0, 1, 2], [0, 2, 3]]))


def test_a_world_file_becomes_a_place_of_its_name(bench, tmp_path):
    write_floor(tmp_path)
    path = tmp_path / "mine.yaml"
    path.write_text(
        "version: 1\nname: my house\nmesh: house.npz\nstart: {x: 1, y: 2, yaw_deg: 180}\n"
        "goals: [{x: 3, y: 4}, {x: 5, y: 6, z: 1.5}]\nbounds: [[0, 0, 0], [9, 9, 3]]\n"
    )
    place = world_place(path, None)
    assert place.name == "my-house"
    said = {key: place.spec[key] for key in ("mesh", "bounds", "start", "goals")}
    assert said == {
        "mesh": "house.npz",
        "bounds": [[0.0, 0.0, 0.0], [9.0, 9.0, 3.0]],
        "start": [1.0, 2.0, pytest.approx(np.pi), 0.0],
        "goals": [[3.0, 4.0], [5.0, 6.0, 1.5]],
    }
    done = bench("navigation", "--world", path, "--trials", 2, "--json", "--no-pictures")
    results = json.loads(done.stdout)
    assert {row["family"] for row in results["rows"]} == {"my-house"}
    assert f"--world {path}" in results["command"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("version: 1\nname: w\nmesh: gone.npz\n", "gone.npz"),
        ("version: 1\nname: w\nmesh: house.npz\nscale: -1\n", "w.yaml:4:8"),
        ("version: 1\nname: w\nmesh: house.npz\ngoal: [1, 2]\n", "w.yaml:4:1"),
        ("version: 1\nname: w\nmesh: house.npz\nstart: {x: 50, y: 1}\n", "start"),
    ],
)
def test_a_wrong_world_file_is_said_with_its_place(tmp_path, text, words):
    write_floor(tmp_path)
    (tmp_path / "w.yaml").write_text(text)
    with pytest.raises(BadInput) as error:
        world_place(tmp_path / "w.yaml", None)
    assert words in str(error.value)


def test_a_world_that_comes_along_is_named_without_a_path(bench):
    done = bench("navigation", "--world", "workshop.yaml", "--trials", 1, "--json", "--no-pictures")
    assert {row["family"] for row in json.loads(done.stdout)["rows"]} == {"workshop"}


def test_another_robot_reaches_the_workers(bench, tmp_path):
    robot = tmp_path / "robot.yaml"
    robot.write_text("version: 1\nname: heavy\nbody: {mass_kg: 5.0}\n")
    seen = []
    arguments = ("navigation", "--family", "indoor", "--trials", 1, "--robot", robot, "--no-pictures")
    assert bench(*arguments, before=lambda job: seen.append(job.robot["body"]["mass_kg"])).exit_code == 0
    assert set(seen) == {5.0}


def test_table3_flies_both_tasks_and_shows_the_papers_figures(bench, tmp_path):
    done = bench("table3", "--trials", 2, "--out", tmp_path / "run", "--no-pictures", "--json")
    assert done.exit_code == 0, done.output
    rows = {(r["family"], r["method"]): r for r in json.loads(done.stdout)["rows"]}
    assert {k: r["trials"] for k, r in rows.items() if r["trials"] != 2} == {("air", "iplanner"): 0}
    assert rows["land", "two-stage"]["paper"]["energy_j"] == 1008.70
    assert rows["air", "iplanner"]["paper"] is None
    page = (tmp_path / "run" / "results.md").read_text()
    assert "## Land-air navigation" in page
    assert "7.2 / 1.4 | 28.7 | 11011 |" in page


def test_a_flight_of_table3_that_misses_counts_even_where_the_oracle_misses_too(bench):
    def miss(job):
        return fakes.Answer(job.task, fakes.make_result(outcome="timeout", reason="late"))

    done = bench("table3", "--trials", 2, "--no-pictures", "--json", work=miss)
    results = json.loads(done.stdout)
    assert results["invalid"] == []
    assert {r["timeout_pct"] for r in results["rows"] if r["trials"]} == {100.0}


def test_help_of_bench_imports_nothing_heavy():
    code = (
        "import sys\n"
        "sys.argv = ['labr-mission', 'bench', 'navigation', '--help']\n"
        "from labr_autonomy.cli import main\n"
        "try:\n    main()\nexcept SystemExit as e:\n    assert e.code == 0\n"
        "heavy = {'numpy', 'scipy', 'sim', 'rich', 'matplotlib', 'pydantic', 'ray', 'numba'}\n"
        "print('HEAVY', *sorted(heavy & {m.partition('.')[0] for m in sys.modules}))\n"
    )
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=root, check=True)
    assert done.stdout.splitlines()[-1] == "HEAVY"


@pytest.fixture
def sim(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    asked = []

    def fly_job(job):
        asked.append(job)
        return fakes.fly_well(job)

    monkeypatch.setattr(jobs, "fly_job", fly_job)

    def call(*arguments):
        return CliRunner().invoke(cli.main, ["sim", *(str(a) for a in arguments)]), asked

    return call


def test_sim_flies_one_trial_again_and_tells_how_it_went(sim, tmp_path):
    done, (job,) = sim("--family", "garage", "--seed", 8, "--method", "mapping", "--difficulty", 0.25)
    assert done.exit_code == 0, done.output
    assert (job.place, job.seed, job.method) == ("garage", 8, "mapping")
    assert job.spec == {"family": "garage", "difficulty": 0.25}
    for words in ("garage, seed 8, mapping", "outcome  reached", "10.0 m driven", "1.50 kJ", "20.0 s  ends"):
        assert words in done.stdout
    assert not (tmp_path / "runs").exists()


def test_sim_show_writes_a_picture_and_says_where(sim, tmp_path):
    done, _ = sim("--family", "garage", "--show")
    assert done.exit_code == 0, done.output
    (path,) = (tmp_path / "runs").glob("*-sim-garage-0-two-stage/trial.png")
    assert f"picture: {path.relative_to(tmp_path)}" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "takes one of MISSION, --family and --world"),
        (("m.yaml", "--family", "indoor"), "takes one of MISSION"),
        (("m.yaml", "--show"), "are of a trial"),
        (("--family", "indoor,forest"), "2 families are named"),
        (("--family", "indoor", "--method", "magic"), "no method 'magic'"),
    ],
)
def test_sim_says_what_does_not_go_together(sim, arguments, words):
    done, asked = sim(*arguments)
    assert done.exit_code == 2
    assert words in done.stderr
    assert asked == []


def test_many_events_leave_out_the_middle(sim):
    from sim.bench.report_lines import describe

    result = dataclasses.replace(fakes.make_result(), events=[(float(i), f"event {i}") for i in range(40)])
    lines = [x for x in describe(fakes.make_task(1), result, events=5) if "event" in x or "more" in x]
    assert [x.split("  ")[-1].strip() for x in lines] == [
        "event 0",
        "event 1",
        "... 35 more ...",
        "event 37",
        "event 38",
        "event 39",
    ]


def test_the_registry_makes_only_what_it_knows():
    assert [m.name for m in methods.find_methods("oracle, two-stage")] == ["two-stage", "oracle"]
    with pytest.raises(BadInput, match="no planner for the method 'x'"):
        methods.make_planner("x", None, None)
    assert not methods.METHODS["iplanner"].suits(True)
    assert methods.METHODS["mapping"].suits(True)
    assert [m.name for m in methods.find_methods("no-memory,oracle,no-network")] == [
        "oracle",
        "no-network",
        "no-memory",
    ]
    assert not methods.ABLATIONS.keys() & {m.name for m in methods.find_methods("all")}


def test_without_the_energy_term_a_metre_flown_costs_its_time():
    config = RobotConfig()
    prices = [
        methods.make_planner(name, config, None)._ways._energy.metre_in_air()
        for name in ("two-stage", "no-energy")
    ]
    assert prices[0] > 4.0
    assert prices[1] == pytest.approx(config.land.speed_mps / config.air.speed_mps)
