"""Curves of the report over time, and how its latencies are spread. Drawn like `record.pictures`."""

from __future__ import annotations

import math

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from labr_autonomy.record.pictures import AIR, INK, LAND, STYLE, figure_bytes
from labr_autonomy.record.run_data import RunData
from labr_autonomy.types import Array

POINTS = 600
BINS = 40
LOOPS = {
    "tick_late_s": "set-point tick, late by",
    "plan_cycle_s": "planning cycle",
    "setpoint_age_s": "depth frame to set-point",
}


def energy_curve(data: RunData) -> bytes | None:
    """Joules spent in each mode over time, stacked; SVG."""
    table = columns(data, "energy_land_j", "energy_transition_j", "energy_air_j")
    if table is None:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 2.6), layout="constrained")
        axes = figure.add_subplot()
        axes.grid(True, linewidth=0.6)
        axes.set_axisbelow(True)
        fallen = np.flatnonzero(
            np.diff(np.sum(table[1:], axis=0)) < 0.0
        )  # counted anew when the mission began
        begin = int(fallen[-1]) + 1 if len(fallen) else 0
        seconds, kilojoules = table[0][begin:], np.array(table[1:])[:, begin:] / 1000.0
        names = ("on land", "take-off and landing", "in the air")
        finals = [f"{name} {values[-1]:.2f} kJ" for name, values in zip(names, kilojoules, strict=True)]
        axes.stackplot(
            seconds, kilojoules, labels=finals, colors=(LAND, "#8e9aa8", AIR), alpha=0.88, linewidth=0
        )
        axes.set(xlim=(max(0.0, seconds[0]), seconds[-1]), xlabel="time [s]", ylabel="energy [kJ]")
        axes.set_ylim(bottom=0.0)
        axes.legend(loc="upper left", frameon=False)
        return figure_bytes(figure, "svg")


def battery_curve(data: RunData) -> bytes | None:
    """Voltage of the pack and what was drawn from it, over time; SVG."""
    table = columns(data, "voltage_v", "power_w")
    if table is None:
        return None
    seconds, volts, watts = table
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 2.3), layout="constrained")
        axes = figure.add_subplot()
        axes.grid(True, linewidth=0.6)
        axes.fill_between(seconds, watts, color=LAND, alpha=0.35, linewidth=0)
        axes.set(xlim=(seconds[0], seconds[-1]), xlabel="time [s]", ylabel="power [W]")
        axes.set_ylim(bottom=0.0)
        right = axes.twinx()
        right.plot(seconds, volts, color=AIR, linewidth=1.6)
        right.set_ylabel("voltage [V]", color=AIR)
        right.spines["right"].set_visible(True)
        return figure_bytes(figure, "svg")


def histograms(data: RunData) -> bytes | None:
    """How long each loop took, how often; SVG."""
    known = [(words, data.latencies_s.get(name)) for name, words in LOOPS.items()]
    shown = [(words, values * 1e3) for words, values in known if values is not None and len(values) > 1]
    if not shown:
        return None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 2.3), layout="constrained")
        for axes, (words, values_ms) in zip(
            np.atleast_1d(figure.subplots(1, len(shown))), shown, strict=True
        ):
            p50, p99 = np.percentile(values_ms, [50, 99])
            top = max(float(np.percentile(values_ms, 99.5)), 1e-3)
            axes.hist(np.minimum(values_ms, top), bins=BINS, range=(0.0, top), color="#8e9aa8")
            for value, name, style in ((p50, "p50", "-"), (p99, "p99", "--")):
                axes.axvline(value, color=INK, linewidth=1.0, linestyle=style)
                at, frame = (value, 0.93), ("data", "axes fraction")
                axes.annotate(f" {name} {value:.1f}", at, xycoords=frame, fontsize=7.5)
            axes.set(xlabel=f"{words} [ms]", yticks=[])
            axes.spines["left"].set_visible(False)
        return figure_bytes(figure, "svg")


def columns(data: RunData, *names: str) -> list[Array] | None:
    """Seconds since the beginning and figures of `/battery`, where all are known; None without them."""
    rows = [[m.get(k) for k in ("stamp_s", *names)] for m in data.battery]
    table = np.array([[math.nan if v is None else v for v in row] for row in rows], dtype=np.float64)
    table = table[np.isfinite(table).all(axis=1)] if len(table) else table
    if len(table) < 2:
        return None
    table = table[:: max(1, len(table) // POINTS)]
    table[:, 0] -= data.t0_s
    return list(table.T)
