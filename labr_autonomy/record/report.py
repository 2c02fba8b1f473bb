"""`report.html`: one file that opens without a network and prints well, made from a run folder alone."""

from __future__ import annotations

import base64
import html
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from labr_autonomy.record import curves, pictures
from labr_autonomy.record.page import PAGE
from labr_autonomy.record.run_data import RunData, read_run

DEPTH_FRAMES = 6
EVENTS_MAX = 80
PAIR_S = 0.3  # a plan belongs to a frame taken this near to its own; points are drawn from the frame's pose
SIDE = f"Height of the body over the way; grey: obstacles within {pictures.NEAR_M} m of it."
PLANNERS_SHOWN = 2
MOVED_M = 0.1  # less than this in a mode is no leg of that mode
OUTCOMES = {
    "success": ("good", "Mission accomplished"),
    "refused": ("warn", "Refused before it began"),
    "aborted": ("warn", "Aborted by the operator"),
    "failsafe": ("bad", "Ended by a failsafe"),
    "failed": ("bad", "Not accomplished"),
}
LOOPS = (
    ("tick_late_ms", "Set-point tick, late by"),
    ("plan_cycle_ms", "Planning cycle"),
    ("setpoint_age_ms", "Depth frame to set-point"),
)


def write_report(run_dir: Path) -> Path:
    """Write `report.html` into a run folder and return its path.

    Raises:
        BadInput: when the folder holds no run.
    """
    data = read_run(run_dir)
    path = run_dir / "report.html"
    path.write_text(render(data), encoding="utf-8")
    return path


def render(data: RunData) -> str:
    """The page."""
    kind, headline = OUTCOMES.get(str(data.summary.get("outcome")), ("warn", "Outcome unknown"))
    mission = data.summary.get("mission") or data.name
    sections = [
        *_pictures(data),
        _legs(data),
        _depth_frames(data),
        _loops(data),
        _events(data),
        _versions(data),
    ]
    return PAGE.substitute(
        title=html.escape(f"{mission} - {headline}"),
        kind=kind,
        headline=html.escape(headline),
        reason=html.escape(_sentence(data)),
        mission=html.escape(str(mission)),
        run=html.escape(data.name),
        tiles="".join(_tiles(data)),
        notes="".join(f'<p class="note">{html.escape(n)}</p>' for n in [*_missed(data), *data.notes]),
        sections="\n".join(s for s in sections if s),
    )


def _sentence(data: RunData) -> str:
    reason = str(data.summary.get("reason") or "").strip()
    if not reason:
        return "The run left no summary." if not data.summary else ""
    return reason[0].upper() + reason[1:] + ("" if reason.endswith((".", "!", "?")) else ".")


def _missed(data: RunData) -> list[str]:
    return [f"Expectation missed: {sentence}" for sentence in data.summary.get("expect_missed") or ()]


def _tiles(data: RunData) -> Iterator[str]:
    s = data.summary
    joules = [s.get(f"energy_{k}_j") for k in ("land", "air", "transition")]
    known = [j for j in joules if j is not None]
    errors = [e for e in s.get("goal_errors_m") or () if e is not None]
    rows: tuple[tuple[str, str, str], ...] = (
        ("duration", _figure(s.get("duration_s"), "s", 1), ""),
        ("on land", _figure(s.get("land_m"), "m", 1), "land"),
        ("in the air", _figure(s.get("air_m"), "m", 1), "air"),
        ("energy", _figure(sum(known) / 1000.0 if known else None, "kJ", 1), ""),
        ("contacts", _figure(s.get("contacts"), "", 0), "bad" if s.get("contacts") else ""),
        ("least clearance", _figure(s.get("min_clearance_m"), "m", 2), ""),
        ("worst goal error", _figure(max(errors) if errors else None, "m", 2), ""),
    )
    met = (s.get("truth") or {}).get("movers")
    if met:
        struck = s["truth"].get("struck_while_standing")
        rows += (("movers", str(met), ""), ("struck while standing", _figure(struck, "", 0), ""))
    for label, value, colour in rows:
        yield f'<div class="tile {colour}"><b>{value}</b><span>{label}</span></div>'


def _pictures(data: RunData) -> Iterator[str]:
    drawn = (
        ("Top view", "From above; the numbers are the mission's items.", pictures.top_view(data)),
        ("Side view", SIDE, pictures.side_view(data)),
        ("Energy", "What each mode has spent so far.", curves.energy_curve(data)),
        ("Battery", "Voltage (line), and the power drawn (area).", curves.battery_curve(data)),
    )
    for title, caption, svg in drawn:
        if svg is not None:
            image = _image(svg, "image/svg+xml", f"{title}: {caption}")
            yield f"<section><h2>{title}</h2><p>{caption}</p>{image}</section>"


def _legs(data: RunData) -> str:
    rows = []
    for i, leg in enumerate(data.summary.get("legs") or ()):
        goal = leg.get("goal_m")
        rows.append(
            (
                str(int(leg.get("index", 0)) + 1),
                str(leg.get("label", "")),
                str(leg.get("outcome", "")),
                ", ".join(f"{v:.2f}" for v in goal) if goal else "-",
                _mode(leg),
                _planned_by(data, i),
                _figure(leg.get("start_s"), "", 1),
                _figure(leg.get("duration_s"), "", 1),
                _figure(leg.get("land_m"), "", 2),
                _figure(leg.get("air_m"), "", 2),
                _figure(leg.get("energy_j"), "", 0),
                _figure(leg.get("goal_error_m"), "", 2),
            )
        )
    heads = (
        "#",
        "item",
        "outcome",
        "goal [m]",
        "mode",
        "planned by",
        "begin [s]",
        "took [s]",
        "land [m]",
        "air [m]",
        "energy [J]",
        "error [m]",
    )
    return _section("Legs", "", _table(heads, rows, words=6)) if rows else ""


def _mode(leg: dict[str, Any]) -> str:
    """By which means a leg was travelled."""
    modes = [name for name in ("land", "air") if (leg.get(f"{name}_m") or 0.0) > MOVED_M]
    return " + ".join(modes) or "-"


def _planned_by(data: RunData, index: int) -> str:
    """Who proposed the paths of a leg, and in which share of its plans."""
    ends = data.summary.get("leg_ends_mono_s") or ()
    if index >= len(ends):
        return "-"
    end_s = float(ends[index])
    begin_s = end_s - float(data.summary["legs"][index].get("duration_s") or 0.0)
    sources = [str(p.get("source")) for p in data.plans if begin_s <= float(p["stamp_s"]) < end_s]
    counted = Counter(sources).most_common(PLANNERS_SHOWN)
    return ", ".join(f"{name}\u00a0{100.0 * n / len(sources):.0f}\u00a0%" for name, n in counted) or "-"


def _depth_frames(data: RunData) -> str:
    frames = list(_chosen_frames(data))
    if not frames:
        return ""
    cells = []
    for depth, plan in frames:
        image = _image(pictures.depth_view(depth, plan), "image/png", "Depth frame with key points")
        network = (plan or {}).get("network") or {}
        mu = network.get("mu")
        words = [f"{depth['stamp_s'] - data.t0_s:.1f} s"]
        if mu is not None:
            unused = mu >= pictures.MU_LIMIT
            style, verdict = ("bad", ", not used") if unused else ("", "")
            words.append(f'<span class="{style}">&mu; {mu:.2f}{verdict}</span>')
        if plan and plan.get("source"):
            words.append(f"follows {html.escape(str(plan['source']))}")
        cells.append(f"<figure>{image}<figcaption>{' &middot; '.join(words)}</figcaption></figure>")
    caption = (
        'What the camera saw and where the network would go: <i class="dot land"></i> driven to, '
        '<i class="dot air"></i> flown to; &mu; is the probability that the path collides.'
    )
    return (
        f'<section><h2>Depth frames</h2><p>{caption}</p><div class="frames">{"".join(cells)}</div></section>'
    )


def _chosen_frames(data: RunData) -> Iterator[tuple[dict[str, Any], dict[str, Any] | None]]:
    """Frames spread over the run, each with the plan nearest to it; those with key points come first."""
    plans = sorted(data.plans, key=lambda p: p.get("frame_stamp_s") or 0.0)
    stamps = np.array([p.get("frame_stamp_s") or 0.0 for p in plans])
    pairs = []
    for depth in data.depths:
        near = int(np.argmin(np.abs(stamps - depth["stamp_s"]))) if len(stamps) else -1
        fits = near >= 0 and abs(stamps[near] - depth["stamp_s"]) < PAIR_S
        pairs.append((depth, plans[near] if fits else None))
    with_points = [p for p in pairs if p[1] and p[1].get("network")]
    pool = with_points if len(with_points) >= DEPTH_FRAMES else pairs
    if pool:
        for i in np.unique(np.linspace(0, len(pool) - 1, DEPTH_FRAMES).astype(int)):
            yield pool[i]


def _loops(data: RunData) -> str:
    rows = []
    for key, label in LOOPS:
        values = data.summary.get(key)
        if isinstance(values, dict):
            rows.append((label, *(_figure(values.get(p), "", 1) for p in ("p50", "p99", "max"))))
    drawn = curves.histograms(data)
    picture = "" if drawn is None else _image(drawn, "image/svg+xml", "Histograms of the loops' latencies")
    return _section("Loops", "", picture + _table(("[ms]", "p50", "p99", "max"), rows)) if rows else ""


def _events(data: RunData) -> str:
    rows = [
        (f"{m['stamp_s'] - data.t0_s:.1f}", _event_words(m))
        for m in sorted([*data.events, *data.modes], key=lambda m: float(m["stamp_s"]))
    ]
    if not rows:
        return ""
    left_out = f"The first {EVENTS_MAX} of {len(rows)}." if len(rows) > EVENTS_MAX else ""
    return _section("What happened", left_out, _table(("time [s]", "event"), rows[:EVENTS_MAX], words=2))


def _event_words(message: dict[str, Any]) -> str:
    if "text" in message:
        level = str(message.get("level", ""))
        return str(message["text"]) if level in ("", "info") else f"{level}: {message['text']}"
    why = f": {message['why']}" if message.get("why") else ""
    return f"{message.get('mode', '')}, {message.get('phase', '')}{why}"


def _versions(data: RunData) -> str:
    versions = data.summary.get("versions")
    if not isinstance(versions, dict):
        return ""
    listed = " &middot; ".join(
        f"{html.escape(str(k))} {html.escape(str(v))}" for k, v in sorted(versions.items())
    )
    seed = data.summary.get("seed")
    return _section(
        "Made with",
        "",
        f"<p>{listed}{'' if seed is None else f' &middot; seed {html.escape(str(seed))}'}</p>",
    )


def _section(title: str, caption: str, body: str) -> str:
    return f"<section><h2>{title}</h2>{f'<p>{caption}</p>' if caption else ''}{body}</section>"


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]], words: int = 1) -> str:
    """A table; the first `words` columns are text, the rest figures."""

    def cells(tag: str, row: Sequence[str]) -> str:
        return "".join(
            f'<{tag} class="{"word" if i < words else "figure"}">{html.escape(value)}</{tag}>'
            for i, value in enumerate(row)
        )

    body = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return f"<table><thead><tr>{cells('th', heads)}</tr></thead><tbody>{body}</tbody></table>"


def _image(data: bytes, kind: str, text: str) -> str:
    return (
        f'<img alt="{html.escape(text)}" src="data:{kind};base64,{base64.b64encode(data).decode("ascii")}">'
    )


def _figure(value: Any, unit: str, digits: int) -> str:
    if not isinstance(value, (int, float)):
        return "-"
    return f"{value:.{digits}f}{f'&thinsp;{unit}' if unit else ''}"
