from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import bench_fakes as fakes
import pytest

from labr_autonomy.clock import SystemClock, pause_s
from labr_autonomy.errors import BadInput
from labr_autonomy.processes import LEAN
from sim.bench.campaign import Stopped
from sim.bench.executors import ProcessExecutor
from sim.bench.jobs import Job
from sim.bench.journal import Journal
from sim.bench.page import navigation_page
from sim.bench.records import Record, result_from_dict
from sim.bench.run import run_bench, write_results
from sim.bench.settings import Place, open_folder

ROOT = Path(__file__).resolve().parents[2]


def fly(folder, executor, settings=None, states=None):
    asked = settings or fakes.settings()
    open_folder(asked, folder, resume=False)
    on_progress = (lambda _: None) if states is None else states.append
    return run_bench(asked, folder, lambda: executor, on_progress)


def by_method(findings, family="indoor"):
    return {r["method"]: r for r in findings.results()["rows"] if r["family"] == family}


def test_every_method_flies_every_task_that_suits_it_after_the_oracle(tmp_path):
    executor, states = fakes.Inline(), []
    findings = fly(tmp_path / "run", executor, states=states)
    assert executor.closed
    for seed in range(4):
        flown = [method for _, s, method in executor.flown if s == seed]
        assert flown[0] == "oracle"
        assert set(flown) == {"oracle", "two-stage", "mapping"} | (set() if seed % 2 else {"iplanner"})
    rows = by_method(findings)
    assert {m: r["trials"] for m, r in rows.items()} == {
        "two-stage": 4,
        "iplanner": 2,
        "mapping": 4,
        "oracle": 4,
    }
    assert rows["iplanner"]["reached_air_pct"] is None
    assert rows["iplanner"]["land_only"]
    assert (states[-1].done, states[-1].total, states[-1].reached) == (14, 14, 14)
    assert states[0].done == 0


def test_tasks_are_kept_as_json_and_not_sampled_again(tmp_path):
    fly(tmp_path / "run", fakes.Inline())
    kept = json.loads((tmp_path / "run" / "tasks" / "indoor-1.json").read_text())
    assert kept["goal_m"] == [4.0, 1.0, 1.5]
    (tmp_path / "run" / "trials.jsonl").unlink()
    seen = []
    fly(tmp_path / "run", fakes.Inline(before=lambda job: seen.append(job.task)))
    assert seen
    assert all(task == fakes.make_task(task.seed) for task in seen)


def test_the_oracle_is_flown_even_where_it_is_not_asked_for(tmp_path):
    findings = fly(tmp_path / "run", fakes.Inline(), fakes.settings(methods=("mapping",)))
    assert list(by_method(findings)) == ["mapping", "oracle"]


def test_a_task_that_the_oracle_does_not_reach_is_listed_and_counts_for_nobody_else(tmp_path):
    executor = fakes.Inline(fakes.fly)
    findings = fly(tmp_path / "run", executor, fakes.settings(seed=fakes.UNREACHABLE, trials=2))
    assert [m for _, s, m in executor.flown if s == fakes.UNREACHABLE] == ["oracle"]
    rows, results = by_method(findings), findings.results()
    assert rows["mapping"]["trials"] == 1
    assert rows["mapping"]["invalid"] == 1
    assert (rows["oracle"]["trials"], rows["oracle"]["reached_pct"]) == (2, 50.0)
    assert results["invalid"] == [
        {
            "family": "indoor",
            "seed": fakes.UNREACHABLE,
            "in_air": True,
            "outcome": "timeout",
            "reason": "no way",
        }
    ]


def test_an_interrupted_benchmark_goes_on_where_it_stopped(tmp_path):
    def interrupt(job):
        if (job.seed, job.method) == (2, "mapping"):
            raise KeyboardInterrupt

    first = fakes.Inline(before=interrupt)
    with pytest.raises(Stopped, match=r"stopped by the operator after \d+ flights.*--out") as stopped:
        fly(tmp_path / "run", first)
    assert stopped.value.exit_code == 5
    assert first.closed
    second = fakes.Inline()
    findings = fly(tmp_path / "run", second)
    assert not set(first.flown) & set(second.flown)
    assert len(first.flown) + len(second.flown) == 14
    whole = fly(tmp_path / "whole", fakes.Inline())
    assert findings.results()["rows"] == whole.results()["rows"]


def test_an_error_is_an_outcome_and_is_tried_again_by_the_next_call(tmp_path):
    asked = fakes.settings(seed=fakes.RAISES, trials=1)
    findings = fly(tmp_path / "run", fakes.Inline(fakes.fly), asked)
    results = findings.results()
    (error,) = results["errors"]
    assert (error["kind"], error["seed"], error["method"]) == ("error", fakes.RAISES, "mapping")
    assert error["error"] == "ValueError: the planner is at a loss"
    rows = by_method(findings)
    assert (rows["mapping"]["trials"], rows["mapping"]["errors"]) == (0, 1)
    assert rows["mapping"]["reached_pct"] is None
    kept = [json.loads(x) for x in (tmp_path / "run" / "trials.jsonl").read_text().splitlines()]
    assert any("Traceback" in r.get("details", "") for r in kept)
    again = fakes.Inline()
    findings = fly(tmp_path / "run", again, asked)
    assert again.flown == [("indoor", fakes.RAISES, "mapping")]
    assert findings.results()["errors"] == []


def test_an_oracle_that_fails_in_the_program_is_reported_once(tmp_path):
    def broken(job):
        raise BadInput("no task can be found", "Take another seed")

    executor = fakes.Inline(broken)
    findings = fly(tmp_path / "run", executor, fakes.settings(trials=2))
    assert len(executor.flown) == 2
    assert [e["error"] for e in findings.results()["errors"]] == [
        "no task can be found. Take another seed"
    ] * 2
    assert by_method(findings)["two-stage"]["trials"] == 0


def test_other_settings_in_the_same_folder_are_refused_and_named(tmp_path):
    fly(tmp_path / "run", fakes.Inline())
    with pytest.raises(BadInput, match="trials was 4 and is 9 now") as error:
        open_folder(fakes.settings(trials=9), tmp_path / "run", resume=False)
    assert "seed" not in str(error.value)


def test_a_folder_of_something_else_is_not_touched(tmp_path):
    (tmp_path / "mine").write_text("x")
    with pytest.raises(BadInput, match="holds no benchmark"):
        open_folder(fakes.settings(), tmp_path, resume=False)
    with pytest.raises(BadInput, match="no benchmark to resume"):
        open_folder(fakes.settings(), tmp_path / "new", resume=True)


def test_resume_without_a_folder_takes_the_latest_of_the_same_question(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BadInput, match="runs holds no benchmark with these settings"):
        open_folder(fakes.settings(), None, resume=True)
    mine = open_folder(fakes.settings(), None, resume=False)
    other = open_folder(fakes.settings(trials=5), None, resume=False)
    assert mine != other
    assert open_folder(fakes.settings(), None, resume=True) == mine


def test_a_torn_last_line_is_dropped_and_its_flight_flown_again(tmp_path):
    fly(tmp_path / "run", fakes.Inline())
    path = tmp_path / "run" / "trials.jsonl"
    raw = path.read_bytes()
    path.write_bytes(raw[:-20])
    again = fakes.Inline()
    findings = fly(tmp_path / "run", again)
    assert len(again.flown) == 1
    assert path.read_bytes().count(b"\n") == raw.count(b"\n")
    assert by_method(findings)["two-stage"]["trials"] == 4


def test_a_line_damaged_in_the_middle_is_said(tmp_path):
    path = tmp_path / "trials.jsonl"
    path.write_bytes(b'{"kind": "flown"\n' + b"{}\n")
    with pytest.raises(BadInput, match="damaged in line 1"):
        Journal(path)


def test_two_benchmarks_do_not_write_one_folder(tmp_path):
    with Journal(tmp_path / "trials.jsonl"), pytest.raises(BadInput, match="another benchmark is writing"):
        Journal(tmp_path / "trials.jsonl")
    with Journal(tmp_path / "trials.jsonl") as free:
        assert free.records == {}


def test_what_is_not_finite_survives_the_journal(tmp_path):
    result = fakes.make_result(goal_error_m=float("nan"), min_clearance_m=0.25)
    with Journal(tmp_path / "trials.jsonl") as journal:
        journal.add(Record("indoor", 1, "mapping", result))
    raw = (tmp_path / "trials.jsonl").read_text()
    assert "NaN" not in raw
    back = result_from_dict(json.loads(raw)["result"])
    assert back.goal_error_m != back.goal_error_m
    assert (back.min_clearance_m, back.track, back.events) == (0.25, result.track, result.events)


def test_a_worker_that_dies_takes_only_its_own_flight_with_it(tmp_path):
    asked = fakes.settings(seed=fakes.CRASHES - 1, trials=3)
    executor = ProcessExecutor(fakes.fly, 2, tmp_path / "workers.log")
    findings = fly(tmp_path / "run", executor, asked)
    errors = {(e["seed"], e["method"]): e["error"] for e in findings.results()["errors"]}
    assert errors == {
        (fakes.CRASHES, "mapping"): "the worker process died (signal SIGSEGV)",
        (fakes.RAISES, "mapping"): "ValueError: the planner is at a loss",
    }
    rows = by_method(findings)
    assert {m: r["trials"] for m, r in rows.items()} == {
        "two-stage": 3,
        "iplanner": 2,
        "mapping": 1,
        "oracle": 3,
    }
    assert "Segmentation fault" in (tmp_path / "workers.log").read_text()


def threads_of_worker(job):
    result = fakes.make_result(sources={name: int(os.environ.get(name, "0")) for name in LEAN})
    os.write(1, b"a library talks\n")
    return fakes.Answer(fakes.make_task(job.seed), result)


def test_workers_compute_with_one_thread_and_keep_stdout_clean(tmp_path, capfd, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    executor = ProcessExecutor(threads_of_worker, 1, tmp_path / "workers.log")
    executor.submit(Job("indoor", {}, 0, "oracle"))
    answer = executor.next_finished().answer
    executor.close()
    assert answer.result.sources == {name: int(value) for name, value in LEAN.items()}
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert capfd.readouterr().out == ""
    assert "a library talks" in (tmp_path / "workers.log").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("end_by", [signal.SIGKILL, signal.SIGINT])
def test_ended_in_mid_run_it_leaves_no_process_and_goes_on(tmp_path, end_by):
    """Workers die with their parent, what was reported is on the disk; Ctrl-C goes to the whole group."""
    marks = tmp_path / "marks"
    marks.mkdir()
    place = Place("indoor", {"family": "indoor", "marks": str(marks)})
    code = (
        "import signal, sys, pathlib; sys.path.insert(0, sys.argv[2])\n"
        "import bench_fakes as f\n"
        "from sim.bench.executors import ProcessExecutor\n"
        "from sim.bench.run import run_bench\n"
        "from sim.bench.settings import Place, open_folder\n"
        "if __name__ == '__main__':\n"
        "    signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "    out = pathlib.Path(sys.argv[1])\n"
        "    s = f.settings(places=(Place('indoor', {'family': 'indoor', 'marks': sys.argv[3]}),))\n"
        "    open_folder(s, out, resume=False)\n"
        "    run_bench(s, out, lambda: ProcessExecutor(f.fly_slowly_and_tell, 2, out / 'log'), lambda _: 0)\n"
    )
    script = tmp_path / "bench_to_kill.py"
    script.write_text(code)
    out = tmp_path / "run"
    arguments = [sys.executable, str(script), str(out), str(Path(__file__).parent), str(marks)]
    env = {**os.environ, "PYTHONPATH": str(ROOT), "BENCH_RUN": str(out)}
    process = subprocess.Popen(arguments, env=env, start_new_session=True, stderr=subprocess.DEVNULL)
    clock = SystemClock()
    due_s = clock.now_s() + 15.0
    mine = f"BENCH_RUN={out}\0"
    while not (marks / "3-oracle").exists():  # both workers hang in the third and fourth oracle's flight
        assert clock.now_s() < due_s
        assert process.poll() is None
        pause_s(0.02)
    assert len(_processes(mine)) >= 3  # itself and two workers
    if end_by is signal.SIGINT:
        os.killpg(process.pid, end_by)
    else:
        process.kill()  # alone: its workers have to notice
    process.wait(10.0)
    asked = fakes.settings(places=(place,))
    open_folder(asked, out, resume=True)
    rest = fakes.Inline()
    findings = run_bench(asked, out, lambda: rest, lambda _: None)
    assert {s for _, s, _ in rest.flown} == {2, 3}
    assert len(findings.records) == 14
    while left := _processes(mine):
        assert clock.now_s() < due_s, left
        pause_s(0.02)


def _processes(with_environment):
    """Processes that were started with a variable."""

    def environment(process):
        try:
            return (process / "environ").read_text()
        except (OSError, UnicodeDecodeError):  # it has ended, or is another's
            return ""

    return [
        p.name for p in Path("/proc").iterdir() if p.name.isdigit() and with_environment in environment(p)
    ]


def test_the_files_of_a_run(tmp_path):
    findings = fly(tmp_path / "run", fakes.Inline(fakes.fly), fakes.settings(seed=4, trials=4))
    results = findings.results()
    write_results(findings.folder, results, navigation_page(results))
    assert json.loads((tmp_path / "run" / "results.json").read_text()) == json.loads(json.dumps(results))
    page = (tmp_path / "run" / "results.md").read_text()
    for words in ("labr-mission bench navigation --family indoor", "## indoor", "Table I", "no way"):
        assert words in page
    assert "iplanner (land)" in page
    assert "the planner is at a loss" in page
    tables = [line for line in page.splitlines() if line.startswith("|")]
    head = None
    for line in tables:  # every line of a table has as many cells as its head
        cells = line.count("|")
        head = cells if line.startswith("| method") or line.startswith("| family") else head
        assert cells == head
