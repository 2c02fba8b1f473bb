"""The paper's Table I beside ours: the network alone, with and without SPN and LAPN."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labr_autonomy.types import Array
from sim.bench import statistics
from sim.bench.alone.trained import VARIANTS, Trained
from sim.bench.effects import PARTS, effect, sentences
from sim.bench.page import number, table, versions_part, with_interval
from sim.bench.paper import TABLE_1
from sim.bench.rows import flights
from sim.bench.run import Findings
from sim.bench.settings import Place, Settings

TITLES = {"iplanner": "iPlanner", "lapn": "LAPN only", "spn": "SPN only", "gkpn": "SPN + LAPN"}
_REACHED = "reached"
_OUTCOMES = (_REACHED, "contact", "timeout")


def table1_settings(
    trained: Sequence[Trained], places: tuple[Place, ...], trials: int, seed: int, arguments: tuple[str, ...]
) -> Settings:
    """The question: every trained network alone through the same trials.

    Args:
        trained: All networks.
        places: Families.
        trials: In each of them, for each network.
        seed: Of the first.
        arguments: Of the command.
    """
    return Settings("table1", places, tuple(t.method for t in trained), trials, seed, arguments)


def table1_results(findings: Findings, trained: Sequence[Trained]) -> dict[str, Any]:
    """results.json: `rows` by family and variant, `effects` of SPN and LAPN, `networks`, `input`."""
    whole = findings.results()
    flags = {
        outcome: {
            place.name: _flags(findings, trained, place.name, outcome) for place in findings.settings.places
        }
        for outcome in _OUTCOMES
    }
    rows = [
        _row(place.name, variant, trained, flags, _in_air(findings, place.name), findings.settings.seed)
        for place in findings.settings.places
        for variant in VARIANTS
        if any(t.variant == variant for t in trained)
    ]
    everywhere = _joined(list(flags[_REACHED].values()))
    effects = [effect(part, everywhere, findings.settings.seed) for part in PARTS]
    return {
        **{key: whole[key] for key in ("command", "seed", "versions", "invalid", "errors", "settings")},
        "input": {"width": trained[0].width, "height": trained[0].height},
        "rows": rows,
        "effects": [found for found in effects if found is not None],
        "networks": [
            {"variant": t.variant, "seed": t.seed, "loss": t.loss, "steps": t.steps, "method": t.method}
            for t in trained
        ],
    }


def _flags(findings: Findings, trained: Sequence[Trained], place: str, outcome: str) -> dict[str, Array]:
    """By variant (trainings, trials): 1 where a flight ended so, 0 where not, nan where none counts."""
    seeds = list(findings.settings.seeds)
    found: dict[str, list[Array]] = {}
    for one in trained:
        line = np.full(len(seeds), np.nan)
        for flight in flights(place, one.method, findings.tasks, findings.records):
            line[flight.task.seed - seeds[0]] = float(flight.result.outcome == outcome)
        found.setdefault(one.variant, []).append(line)
    return {variant: np.stack(lines) for variant, lines in found.items()}


def _in_air(findings: Findings, place: str) -> NDArray[np.bool_]:
    """Which of the trials have a goal in the air; False for those that no task was found for."""
    tasks = [findings.tasks.get((place, seed)) for seed in findings.settings.seeds]
    return np.array([task is not None and task.in_air for task in tasks], dtype=np.bool_)


def _joined(places: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    """The trials of all families side by side."""
    return {variant: np.hstack([place[variant] for place in places]) for variant in places[0]}


def _row(
    family: str,
    variant: str,
    trained: Sequence[Trained],
    flags: Mapping[str, Mapping[str, Mapping[str, Array]]],
    in_air: NDArray[np.bool_],
    seed: int,
) -> dict[str, Any]:
    """One variant in one family; `in_air` (trials,) tells which goals are in the air."""
    own = [t for t in trained if t.variant == variant]
    row: dict[str, Any] = {
        "family": family,
        "variant": variant,
        "spn": variant in ("spn", "gkpn"),
        "lapn": variant in ("lapn", "gkpn"),
        "trainings": len(own),
        "loss": statistics.mean([t.loss for t in own]),
        "paper": TABLE_1.get(family, {}).get(variant),
    }
    for outcome in _OUTCOMES:
        lines = flags[outcome][family][variant]
        flown = np.isfinite(lines).all(axis=0)  # trials that every training of it has flown
        whole = lines[:, flown]
        row["trials"] = int(whole.size)
        row[f"{outcome}_pct"] = statistics.share_pct(whole.ravel() > 0.5)
        row[f"{outcome}_pct_ci95"] = _interval_pct(whole, seed)
        if outcome == _REACHED:
            for kind, these in (("land", flown & ~in_air), ("air", flown & in_air)):
                row[f"reached_{kind}_pct"] = statistics.share_pct(lines[:, these].ravel() > 0.5)
    return row


def _interval_pct(flags: Array, seed: int) -> statistics.Interval | None:
    """Of the share of a variant; Wilson's where all flights ended alike and every resample is the same."""
    if flags.size and 0.0 < float(flags.mean()) < 1.0:
        return statistics.bootstrap_crossed([flags], [100.0], seed)
    return statistics.share_interval_pct(flags.ravel() > 0.5, seed)


def table1_page(results: Mapping[str, Any]) -> str:
    """results.md.

    Args:
        results: As in results.json.
    """
    size = results["input"]
    head = ["network", "SPN", "LAPN", "trainings", "training loss", "paper", "flights"]
    head += ["goal reached %", "paper", "land %", "air %", "contact %", "timeout %"]
    parts = ["# Table I\n", f"```\n{results['command']}\n```\n"]
    for family in dict.fromkeys(row["family"] for row in results["rows"]):
        lines = [_line(row) for row in results["rows"] if row["family"] == family]
        parts += [f"## {family}\n", table(head, lines)]
    parts += ["## Do SPN and LAPN help\n", *[f"- {line}" for line in sentences(results["effects"])], ""]
    parts.append(
        f"All networks take images of {size['width']}x{size['height']} and were trained on the same data: "
        "one training over all kinds of world, so that the loss is the same in every family. Each flies "
        "alone: its key points as a spline that is followed, and iPlanner's rule of fear; no map of "
        "obstacles, no refiner, no recovery. Flights count all trainings of a network on the tasks that the "
        "oracle reached; goals are on the floor and in the air. Brackets are 95 % bootstrap intervals that "
        "resample trials, the same for all networks, and the trainings of each network; Wilson's where all "
        "flights ended alike. The paper trained and flew at another resolution, in other worlds: its losses "
        "stand beside ours for their order alone, and its rooms are Matterport3D.\n"
    )
    parts += _left_out(results)
    parts.append(versions_part(results))
    return "\n".join(parts)


def _line(row: Mapping[str, Any]) -> list[str]:
    paper = row["paper"] or {}
    return [
        TITLES[row["variant"]],
        "yes" if row["spn"] else "no",
        "yes" if row["lapn"] else "no",
        str(row["trainings"]),
        number(row["loss"], 3),
        number(paper.get("loss"), 3),
        str(row["trials"]),
        with_interval(row, "reached_pct", 0),
        number(paper.get("reached_pct"), 0),
        number(row["reached_land_pct"], 0),
        number(row["reached_air_pct"], 0),
        with_interval(row, "contact_pct", 0),
        with_interval(row, "timeout_pct", 0),
    ]


def _left_out(results: Mapping[str, Any]) -> list[str]:
    if not results["errors"]:
        return []
    lines = [f"- {e['family']} seed {e['seed']}, {e['method']}: {e['error']}" for e in results["errors"]]
    return ["## Flights in which the program failed\n", *lines, "", "Their trials are in no figure.\n"]
