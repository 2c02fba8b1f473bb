"""What many hand-overs add up to, beside what is wanted. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sim.bench.statistics import wilson
from sim.bench.transitions.trial import Hop

STOP_P99_M = 0.10  # wanted at most
TOUCHDOWN_MAX_MPS = 0.4


def summary(hops: Sequence[Hop]) -> dict[str, Any]:
    """JSON-ready figures; `met` says whether all that is wanted was reached.

    Args:
        hops: At least one.
    """
    done = sum(hop.done for hop in hops)
    stop, touchdown = _spread([h.stop_error_m for h in hops]), _spread([h.touchdown_mps for h in hops])
    low, high = wilson(done, len(hops))
    met = {
        "all_done": done == len(hops),
        "stop_error": stop["p99"] is not None and stop["p99"] <= STOP_P99_M,
        "touchdown": touchdown["max"] is not None and touchdown["max"] <= TOUCHDOWN_MAX_MPS,
    }
    return {
        "trials": len(hops),
        "done": done,
        "done_pct_ci95": [100.0 * low, 100.0 * high],
        "stop_error_m": stop,
        "landing_error_m": _spread([h.landing_error_m for h in hops]),
        "touchdown_mps": touchdown,
        "tilt_deg": _spread([h.tilt_deg for h in hops]),
        "time_s": _spread([h.time_s for h in hops if h.done]),
        "wanted": {"stop_error_p99_m": STOP_P99_M, "touchdown_max_mps": TOUCHDOWN_MAX_MPS},
        "met": met,
        "failed": [{"seed": h.conditions.seed, "reason": h.reason} for h in hops if not h.done],
    }


def lines(found: dict[str, Any]) -> list[str]:
    """The same for a person."""

    def row(name: str, key: str, unit: str, wanted: str) -> str:
        p50, p99, most = (
            "-" if found[key][k] is None else f"{found[key][k]:.3f}" for k in ("p50", "p99", "max")
        )
        return f"{name:22s} p50 {p50}   p99 {p99}   max {most} {unit}{wanted}"

    low, high = found["done_pct_ci95"]
    out = [
        f"{found['done']} of {found['trials']} hand-overs done ({low:.1f} to {high:.1f} %, 95 % interval)",
        row("stop error", "stop_error_m", "m", f"   (wanted p99 <= {STOP_P99_M:g})"),
        row("landing error", "landing_error_m", "m", ""),
        row("touch-down speed", "touchdown_mps", "m/s", f"   (wanted max <= {TOUCHDOWN_MAX_MPS:g})"),
        row("tilt at touch-down", "tilt_deg", "deg", ""),
        row("time", "time_s", "s", ""),
    ]
    return out + [f"  seed {f['seed']}: {f['reason']}" for f in found["failed"]]


def _spread(values: Sequence[float | None]) -> dict[str, float | None]:
    known = [v for v in values if v is not None]
    if not known:
        return {"p50": None, "p99": None, "max": None}
    p50, p99 = np.percentile(known, [50, 99])
    return {"p50": float(p50), "p99": float(p99), "max": max(known)}
