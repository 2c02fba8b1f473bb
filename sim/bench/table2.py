"""The paper's Table II beside ours: parameters, operations, and what a plan costs on this processor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from labr_autonomy.gkpn.latency import latencies_ms
from labr_autonomy.gkpn.learning.export import load_network
from labr_autonomy.gkpn.networks.counts import counts, counts_of
from labr_autonomy.gkpn.networks.planner import build, examples
from labr_autonomy.gkpn.networks.presets import PAPER
from labr_autonomy.gkpn.onnx_file import onnx_bytes
from labr_autonomy.gkpn.package import ONNX_NAME, packaged_dir, read_verified
from sim.bench.page import number, table, versions_part
from sim.bench.paper import TABLE_2

SHIPPED = "shipped"  # the network that comes with the package
BASELINE = "iplanner"
THREADS = (1, 2)
TITLES = {
    "iplanner": "iPlanner",
    "lapn": "LAPN only",
    "spn": "SPN only",
    "gkpn": "SPN + LAPN",
    SHIPPED: "shipped network",
}


def table2_rows(rounds: int, on_round: Callable[[], None] = lambda: None) -> list[dict[str, Any]]:
    """One row for each network of the paper at its size, and one for ours.

    Args:
        rounds: Turns of each network on the processor, for each number of threads; 0 for sizes alone.
        on_round: Called after each.
    """
    rows: list[dict[str, Any]] = []
    for name, config in PAPER.items():
        params_m, flops_g = counts(config)
        rows.append({"method": name, "params_m": params_m, "flops_g": flops_g, "paper": TABLE_2[name]})
    shipped = load_network(packaged_dir())
    params_m, flops_g = counts_of(shipped, *examples(shipped.config))
    rows.append({"method": SHIPPED, "params_m": params_m, "flops_g": flops_g, "paper": None})
    if rounds:
        models = {name: onnx_bytes(build(c), *examples(c)) for name, c in PAPER.items()}
        models[SHIPPED] = read_verified(packaged_dir(), ONNX_NAME)
        for threads in THREADS:
            times = latencies_ms(models, threads, rounds, on_round)
            slow = float(np.median(times[BASELINE]))
            for row in rows:
                p50, p99 = np.percentile(times[row["method"]], [50, 99])
                row[f"latency_ms_{threads}"] = {"p50": float(p50), "p99": float(p99)}
                row[f"faster_than_iplanner_{threads}"] = slow / float(p50)
    return rows


def table2_page(results: Mapping[str, Any]) -> str:
    """results.md.

    Args:
        results: As in results.json: command, rows, versions.
    """
    head = ["network", "params M", "paper", "FLOPs G", "paper"]
    timed = "latency_ms_1" in results["rows"][0]
    for threads in THREADS if timed else ():
        plural = "s" if threads > 1 else ""
        head += [f"p50 / p99 ms, {threads} thread{plural}", "times as fast as iPlanner"]
    lines = []
    for row in results["rows"]:
        line = [TITLES[row["method"]]]
        for key, digits in (("params_m", 2), ("flops_g", 2)):
            line += [number(row[key], digits), number((row["paper"] or {}).get(key), digits)]
        for threads in THREADS if timed else ():
            found = row[f"latency_ms_{threads}"]
            line.append(f"{found['p50']:.2f} / {found['p99']:.2f}")
            line.append(f"{row[f'faster_than_iplanner_{threads}']:.1f}")
        lines.append(line)
    parts = ["# Table II\n", f"```\n{results['command']}\n```\n", table(head, lines)]
    parts.append(
        "FLOPs are twice the multiplications of convolutions and matrix products for one plan, all included. "
        "The paper's rows take images of 640x384; its layers are not public, and the widths here were "
        "searched so that both of its figures are met. The shipped network takes images of 160x90: a "
        "sixteenth of the pixels is part of its speed. Latencies are of ONNX Runtime in single precision, "
        "the networks taking turns in one process.\n"
    )
    parts.append(versions_part(results))
    return "\n".join(parts)
