"""The pictures beside results.md: ways of all methods, failures, and the bars of the summary."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from labr_autonomy.record.pictures import FAINT, INK, LAND
from sim.bench.methods import ORACLE, find_method, in_order
from sim.bench.paper import GOAL_REACHED_PCT
from sim.bench.pictures import STYLE, draw_depth, draw_top, key, last_depth, png
from sim.bench.rows import Flight, flights, worst
from sim.bench.run import Findings
from sim.worlds.build import rebuild_world
from sim.worlds.world import World

SHOWN = 4  # trials side by side
FAILURES = 8  # in the gallery of one place
COLOURS = {"two-stage": LAND, "iplanner": "#7b5ea7", "mapping": "#2a9d8f", ORACLE: FAINT}
OTHERS = ("#d98e04", "#b5485d", "#4a6fa5", "#8a6d3b", "#5f8a3a", "#a34fa0")  # networks, in turn


def draw_navigation(findings: Findings, results: Mapping[str, Any]) -> None:
    """Write every picture into the run folder and name them at the end of results.md.

    Args:
        findings: Of the run.
        results: As in results.json.
    """
    _keep(findings, {"summary.png": summary_bars(results["rows"]), **_by_place(findings)})


def draw_ways(findings: Findings) -> None:
    """The same without the summary."""
    _keep(findings, _by_place(findings))


def _by_place(findings: Findings) -> dict[str, bytes | None]:
    """Ways and failures of every place, by file name."""
    pictures: dict[str, bytes | None] = {}
    for place in findings.settings.places:
        flown = {
            method: flights(place.name, method, findings.tasks, findings.records, gated=findings.gated)
            for method in dict.fromkeys((*findings.settings.methods, ORACLE))
        }
        pictures[f"ways-{place.name}.png"] = ways(flown, place.name)
        pictures[f"failures-{place.name}.png"] = failures(flown, place.name)
    return pictures


def _keep(findings: Findings, pictures: Mapping[str, bytes | None]) -> None:
    drawn = {name: data for name, data in pictures.items() if data is not None}
    for name, data in drawn.items():
        (findings.folder / name).write_bytes(data)
    with (findings.folder / "results.md").open("a", encoding="utf-8") as page:
        page.write("\n## Pictures\n\n" + "".join(f"![{name[:-4]}]({name})\n\n" for name in drawn))


def ways(flown: Mapping[str, Sequence[Flight]], place: str) -> bytes | None:
    """Methods by rows, the same few trials by columns; PNG, or None where nothing was flown."""
    seeds = sorted({f.task.seed for counted in flown.values() for f in counted})[:SHOWN]
    methods = [m for m, counted in flown.items() if counted]
    if not seeds:
        return None
    worlds: dict[int, World] = {}
    with mpl.rc_context(STYLE):
        size = (2.6 * len(seeds) + 0.4, 2.75 * len(methods) + 0.6)
        figure = Figure(figsize=size, layout="constrained")
        grid = figure.subplots(len(methods), len(seeds), squeeze=False)
        for line, method in zip(grid, methods, strict=True):
            by_seed = {f.task.seed: f for f in flown[method]}
            for axes, seed in zip(line, seeds, strict=True):
                flight = by_seed.get(seed)
                if flight is None:
                    axes.set_axis_off()
                    axes.set_title(f"{find_method(method).title}, seed {seed}: not flown")
                    continue
                _panel(axes, flight, worlds, f"{find_method(method).title}, seed {seed}")
        figure.suptitle(place)
        figure.legend(handles=key(), loc="outside lower center", ncols=6, frameon=False, fontsize=7)
        return png(figure)


def failures(flown: Mapping[str, Sequence[Flight]], place: str) -> bytes | None:
    """Failed trials: where they ended, and what the camera sees there; PNG, or None without failures."""
    failed = [
        (method, flight)
        for method, counted in flown.items()
        for flight in worst([f for f in counted if not f.reached], most=FAILURES)
    ]
    order = {method: i for i, method in enumerate(in_order(flown))}
    nth: dict[str, int] = {}
    ranked = []
    for method, flight in failed:  # the worst of each method first, then the second worst of each
        nth[method] = nth.get(method, 0) + 1
        ranked.append((nth[method], order[method], method, flight))
    shown = [entry[2:] for entry in sorted(ranked, key=lambda entry: entry[:2])[:FAILURES]]
    if not shown:
        return None
    worlds: dict[int, World] = {}
    with mpl.rc_context(STYLE):
        columns = min(4, len(shown))
        lines = -(-len(shown) // columns)
        figure = Figure(figsize=(2.9 * columns, 4.6 * lines + 0.6), layout="constrained")
        grid = figure.subplots(2 * lines, columns, squeeze=False, height_ratios=[2.8, 1.6] * lines)
        for axes in grid.flat:
            axes.set_axis_off()
        for i, (method, flight) in enumerate(shown):
            top, eye = (grid[2 * (i // columns) + k, i % columns] for k in (0, 1))
            top.set_axis_on()
            _panel(top, flight, worlds, f"{find_method(method).title}, seed {flight.task.seed}", near=True)
            depth = last_depth(worlds[flight.task.seed], flight.result)
            if depth is not None:
                draw_depth(eye, depth)
                eye.set_title("depth at the end, along the last motion", fontsize=6)
        figure.suptitle(f"{place}: failures")
        figure.legend(handles=key(), loc="outside lower center", ncols=3, frameon=False, fontsize=7)
        return png(figure)


def _panel(axes: Axes, flight: Flight, worlds: dict[int, World], title: str, *, near: bool = False) -> None:
    seed = flight.task.seed
    if seed not in worlds:
        worlds[seed] = rebuild_world(flight.task.world)
    draw_top(axes, worlds[seed], flight.task, flight.result, near=near)
    axes.set_title(f"{title}\n{flight.result.outcome}, {flight.result.energy_j / 1e3:.1f} kJ")


def summary_bars(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """Goals reached and energy over the oracle by place and method, the paper's figures as marks; PNG."""
    families = list(dict.fromkeys(row["family"] for row in rows))
    methods = in_order(row["method"] for row in rows)
    colours = colours_of(methods)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(max(6.5, 2.2 * len(families) + 2.5), 5.6), layout="constrained")
        reached, energy = figure.subplots(2, 1)
        for axes, key_ in ((reached, "reached_pct"), (energy, "energy_over_oracle")):
            axes.grid(True, axis="y", linewidth=0.6)
            axes.set_axisbelow(True)
            axes.set_xticks(range(len(families)), families)
            for number, method in enumerate(methods):
                place = number - (len(methods) - 1) / 2.0
                _bars(axes, key_, rows, families, method, place, len(methods), colours[method])
        reached.set(ylabel="goals reached [%]", ylim=(0.0, 109.0))
        energy.set(ylabel="energy / oracle's energy")
        energy.axhline(1.0, color=INK, linewidth=0.8)
        reached.plot([], [], "D", ms=4, mfc="white", mec=INK, ls="", label="paper, Table I")
        figure.legend(
            *reached.get_legend_handles_labels(), loc="outside upper center", ncols=5, frameon=False
        )
        return png(figure)


def colours_of(methods: Sequence[str]) -> dict[str, str]:
    """A colour for each method; networks alone have no colour of their own."""
    others = [method for method in methods if method not in COLOURS]
    return COLOURS | {method: OTHERS[i % len(OTHERS)] for i, method in enumerate(others)}


def _bars(
    axes: Axes,
    key_: str,
    rows: Sequence[Mapping[str, Any]],
    families: Sequence[str],
    method: str,
    place: float,
    count: int,
    colour: str,
) -> None:
    """The bars of one method over all places, with their intervals."""
    found = {row["family"]: row for row in rows if row["method"] == method}
    width = 0.8 / count
    labelled = False
    for i, family in enumerate(families):
        row = found.get(family)
        if row is None or row[key_] is None:
            continue
        x, value = i + place * width, float(row[key_])
        label = None if labelled else find_method(method).title + (", land only" if row["land_only"] else "")
        axes.bar(x, value, width * 0.92, color=colour, label=label)
        labelled = True
        interval = row[f"{key_}_ci95"]
        if interval is not None:
            spread = np.abs(np.array(interval) - value)[:, None]
            axes.errorbar(x, value, yerr=spread, color=INK, linewidth=0.9, capsize=2)
        paper = GOAL_REACHED_PCT.get(family, {}).get(method)
        if key_ == "reached_pct" and paper is not None:
            axes.plot(x, paper, "D", ms=4, mfc="white", mec=INK, zorder=5)
