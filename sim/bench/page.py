"""`results.md`: the results of a navigation benchmark for a person."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from sim.bench.air_goals import NEAR_M
from sim.bench.methods import ORACLE, find_method, in_order
from sim.bench.paper import GOAL_REACHED_PCT

Row = Mapping[str, Any]
NOTHING = "-"

_AVERAGED = """\
Shares count every trial of the row. Time, metres, joules and clearance are means over the trials that \
reached the goal (true position within 0.5 m); energy / oracle is the mean ratio over the trials that both \
this method and the oracle reached; SPL is success weighted by path length over all trials of the row. \
Clearance is the smallest of each trial, its mean. Planning time covers every cycle of every trial, on one \
thread. Brackets are 95 % intervals: bootstrap percentile, or Wilson's where all or none succeeded."""


def number(value: float | None, digits: int, scale: float = 1.0) -> str:
    """A figure, or a dash where there is none."""
    return NOTHING if value is None else f"{value * scale:.{digits}f}"


def with_interval(row: Row, key: str, digits: int, scale: float = 1.0) -> str:
    """A figure and its interval, if it has one."""
    shown = number(row[key], digits, scale)
    interval = row.get(f"{key}_ci95")
    if interval is None:
        return shown
    low, high = (number(v, digits, scale) for v in interval)
    return f"{shown} [{low}, {high}]"


def table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """A Markdown table; the first column is text, the others are figures."""
    rule = ["---", *["---:"] * (len(head) - 1)]
    return "\n".join(f"| {' | '.join(line)} |" for line in (head, rule, *lines)) + "\n"


def versions_part(results: Mapping[str, Any]) -> str:
    """The last part of a page: what it was made with."""
    found = ", ".join(f"{name} {version}" for name, version in sorted(results["versions"].items()))
    return f"## Versions\n\n{found}\n"


def navigation_page(results: Mapping[str, Any]) -> str:
    """The whole file.

    Args:
        results: As in results.json.
    """
    rows: Sequence[Row] = results["rows"]
    families = list(dict.fromkeys(row["family"] for row in rows))
    parts = ["# Navigation benchmark\n", f"```\n{results['command']}\n```\n", _AVERAGED + "\n"]
    for family in families:
        parts += _family(family, [row for row in rows if row["family"] == family])
    parts += _by_kind(rows)
    parts += _movers(rows)
    parts += _baselines(rows)
    parts += _beside_the_paper(rows)
    parts += _left_out(results)
    parts += _replays(rows)
    parts.append(versions_part(results))
    return "\n".join(parts)


def _family(family: str, rows: Sequence[Row]) -> list[str]:
    shares = [
        [
            row["method"] + (" (land)" if row["land_only"] else ""),
            str(row["trials"]),
            with_interval(row, "reached_pct", 0),
            number(row["reached_land_pct"], 0),
            number(row["reached_air_pct"], 0),
            number(row["contact_pct"], 0),
            number(row["timeout_pct"], 0),
            number(row["stopped_pct"], 0),
            with_interval(row, "spl", 2),
        ]
        for row in rows
    ]
    costs = [
        [
            row["method"] + (" (land)" if row["land_only"] else ""),
            with_interval(row, "time_s", 1),
            with_interval(row, "land_m", 1),
            with_interval(row, "air_m", 1),
            with_interval(row, "energy_j", 2, 1e-3),
            " / ".join(number(row[f"energy_{k}_j"], 2, 1e-3) for k in ("land", "air", "transition")),
            with_interval(row, "energy_over_oracle", 2),
            with_interval(row, "min_clearance_m", 2),
            " / ".join(number(row["plan_cycle_ms"][k], 0) for k in ("p50", "p99", "max")),
        ]
        for row in rows
    ]
    share_head = ["method", "trials", "reached %", "land %", "air %", "contact %", "timeout %", "stopped %"]
    cost_head = ["method", "time s", "driven m", "flown m", "energy kJ", "land / air / between kJ"]
    cost_head += ["energy / oracle", "clearance m", "plan p50 / p99 / max ms"]
    return [f"## {family}\n", table([*share_head, "SPL"], shares), table(cost_head, costs)]


def _by_kind(rows: Sequence[Row]) -> list[str]:
    """Energy by kind of goal, and where flights to goals in the air begin."""
    lines = [
        [
            f"{row['family']}, {row['method']}",
            with_interval(row, "energy_over_oracle_land", 2),
            with_interval(row, "energy_over_oracle_air", 2),
            number(row["driven_share_air_pct_p50"], 0),
            f"{number(row['take_off_m_p50'], 1)} / {number(row['take_off_m_max'], 1)}",
            number(row["take_off_near_pct"], 0),
        ]
        for row in rows
    ]
    head = ["family, method", "energy / oracle, land goals", "energy / oracle, air goals"]
    head += ["driven share % p50", "take-off to goal m p50 / max", f"within {NEAR_M:g} m %"]
    return [
        "## Land goals and air goals\n",
        table(head, lines),
        "Driven share and take-off are those of reached goals in the air: metres on wheels over all metres, "
        "and the distance on the level from where the last flight began to the goal.\n",
    ]


def _movers(rows: Sequence[Row]) -> list[str]:
    """How the methods got on with people and boxes, where there were any."""
    met = [row for row in rows if row["movers"]]
    if not met:
        return []
    lines = [
        [
            f"{row['family']}, {row['method']}",
            number(row["movers"], 1),
            number(row["contact_pct"], 0),
            number(row["unseen_contact_pct"], 0),
            str(row["struck"]),
        ]
        for row in met
    ]
    return [
        "## Movers\n",
        table(
            ["family, method", "movers a trial", "contact %", "out of view %", "struck while standing"], lines
        ),
        "People and boxes walk to and fro across the way at 0.6 to 1.5 m/s; as many as fit on tracks of "
        "their own, up to the number asked for. They do not give way to a robot that moves. A person stops "
        "short of a robot that stands, a box does not look. A contact with a mover counts as "
        "any other, unless the robot had stood still for the last second: that is counted apart, as struck "
        "while standing, and the flight goes on. Out of view are contacts with a mover that the camera had "
        "not been looking at for a second. The oracle flies without movers.\n",
    ]


def _baselines(rows: Sequence[Row]) -> list[str]:
    used = [find_method(name) for name in in_order(row["method"] for row in rows)]
    return ["## Methods\n", *[f"- {m.name}: {m.sentence}." for m in used], ""]


def _beside_the_paper(rows: Sequence[Row]) -> list[str]:
    lines = [
        [f"{row['family']}, {row['method']}", with_interval(row, "reached_pct", 0), f"{paper:.0f}"]
        for row in rows
        if (paper := GOAL_REACHED_PCT.get(row["family"], {}).get(row["method"])) is not None
    ]
    if not lines:
        return []
    return [
        "## Beside the paper\n",
        table(["family, method", "reached % here", "reached % in Table I"], lines),
        "The paper's worlds, goals and weights are not public; its iPlanner is the row without SPN and LAPN, "
        "its rooms are Matterport3D. Ours are other worlds with goals on the floor and in the air.\n",
    ]


def _left_out(results: Mapping[str, Any]) -> list[str]:
    parts = []
    if results["invalid"]:
        parts.append("## Trials that do not count: the oracle did not reach the goal\n")
        parts += [
            f"- {i['family']} seed {i['seed']}: {i['outcome']}, {i['reason']}" for i in results["invalid"]
        ]
        parts.append("")
    if results["errors"]:
        parts.append("## Trials in which the program failed\n")
        parts += [f"- {e['family']} seed {e['seed']}, {e['method']}: {e['error']}" for e in results["errors"]]
        parts.append(
            "\nThey are in no figure. The same command with --out on this folder tries them again.\n"
        )
    return parts


def _replays(rows: Sequence[Row]) -> list[str]:
    worst = [row for row in rows if row["worst_seeds"] and row["method"] != ORACLE]
    if not worst:
        return []
    lines = [
        f"- {row['family']}, {row['method']}: seeds {', '.join(str(s) for s in row['worst_seeds'])}"
        for row in worst
    ]
    return [
        "## To look at first\n",
        *lines,
        "\nEach can be seen again: `labr-mission sim --family FAMILY --seed SEED --method METHOD --show` "
        "(`--world FILE.yaml` for a mesh world, and the same `--difficulty`).\n",
    ]
