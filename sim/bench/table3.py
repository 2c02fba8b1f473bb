"""The paper's Table III beside ours: its two tasks, many seeds of noise, three methods and the oracle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from labr_autonomy.config import RobotConfig
from sim.bench.methods import METHODS, find_method, in_order
from sim.bench.page import NOTHING, number, table, versions_part, with_interval
from sim.bench.paper import TABLE_3
from sim.bench.scenes import SCENES, scene_task
from sim.bench.settings import Place, Settings
from sim.lockstep.trial import Task

TITLES = {"land": "Land navigation", "air": "Land-air navigation"}


def table3_settings(
    methods: tuple[str, ...], trials: int, seed: int, robot: dict[str, Any] | None
) -> Settings:
    """The question: two places, each one fixed scene.

    Args:
        methods: Names.
        trials: Seeds of noise for each task.
        seed: The first of them.
        robot: Fields of RobotConfig; None for the standard robot.
    """
    arguments = ("--trials", str(trials), "--method", ",".join(methods), "--seed", str(seed))
    places = tuple(Place(name, {"table3": name, "world_seed": SCENES[name].world_seed}) for name in SCENES)
    return Settings("table3", places, methods, trials, seed, arguments, robot)


def table3_tasks(settings: Settings) -> dict[tuple[str, int], Task]:
    """Every task by place and seed; the scenes are built once."""
    robot = RobotConfig() if settings.robot is None else RobotConfig(**settings.robot)
    tasks: dict[tuple[str, int], Task] = {}
    for place in settings.places:
        task = scene_task(place.name, settings.seed, robot)
        tasks.update({(place.name, seed): replace(task, seed=seed) for seed in settings.seeds})
    return tasks


def with_paper(results: dict[str, Any]) -> dict[str, Any]:
    """The results with the paper's own figures in each row, `paper`, null where it has none."""
    rows = [{**row, "paper": TABLE_3.get((row["family"], row["method"]))} for row in results["rows"]]
    return {**results, "rows": rows}


def table3_page(results: Mapping[str, Any]) -> str:
    """results.md.

    Args:
        results: As in results.json.
    """
    parts = ["# Table III\n", f"```\n{results['command']}\n```\n"]
    head = ["method", "reached", "length land / air m", "time s", "energy J", "energy / oracle"]
    head += ["paper: land / air m", "paper: time s", "paper: energy J"]
    for name, title in TITLES.items():
        lines = [_line(row) for row in results["rows"] if row["family"] == name]
        parts += [f"## {title}\n", table(head, lines)]
    parts.append(
        "Length, time and energy are means over the flights that reached the goal, brackets their 95 % "
        "bootstrap intervals over seeds of noise and disturbance. The paper flew each task once, in a "
        "laboratory and with a robot that are not public: its columns stand beside ours for their order and "
        "their ratios, not for their amounts. Its Yang is iPlanner and its Zhou the mapping-based planner; "
        "iPlanner cannot be sent to a goal in the air.\n"
    )
    used = [find_method(name) for name in in_order([*METHODS, *(row["method"] for row in results["rows"])])]
    parts += ["## Methods\n", *[f"- {m.name}: {m.sentence}." for m in used], ""]
    if results["errors"]:
        parts.append("## Flights in which the program failed\n")
        parts += [f"- {e['family']} seed {e['seed']}, {e['method']}: {e['error']}" for e in results["errors"]]
        parts.append("")
    parts.append(versions_part(results))
    return "\n".join(parts)


def _line(row: Mapping[str, Any]) -> list[str]:
    flown = row["trials"] > 0
    paper = row["paper"] or {}
    lengths = f"{with_interval(row, 'land_m', 1)} / {with_interval(row, 'air_m', 1)}"
    share = row["reached_pct"]
    reached = f"{round(share * row['trials'] / 100.0)} of {row['trials']}" if flown else NOTHING
    theirs = f"{number(paper['land_m'], 1)} / {number(paper['air_m'], 1)}" if paper else NOTHING
    return [
        row["method"],
        reached,
        lengths,
        with_interval(row, "time_s", 1),
        with_interval(row, "energy_j", 0),
        with_interval(row, "energy_over_oracle", 2),
        theirs,
        number(paper.get("time_s"), 1),
        number(paper.get("energy_j"), 0),
    ]
