"""Whether the parts of the paper's network help: differences over trials that all networks were given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from labr_autonomy.types import Array
from sim.bench import statistics

# A part helps by the mean difference of the pairs of networks that differ in it alone.
PARTS: dict[str, tuple[tuple[str, str], ...]] = {
    "SPN": (("spn", "iplanner"), ("gkpn", "lapn")),
    "LAPN": (("lapn", "iplanner"), ("gkpn", "spn")),
    "SPN and LAPN together": (("gkpn", "iplanner"),),
}
_FEW = 2  # trainings of a network below which the chance of training is not in its interval


def effect(part: str, flags: Mapping[str, Array], seed: int) -> dict[str, Any] | None:
    """What a part adds to the share of goals reached; None where no pair of networks differs in it alone.

    Args:
        part: Of `PARTS`.
        flags: By variant (trainings, trials): 1 reached, 0 not, nan not flown; columns are the same trials.
        seed: Of the interval.

    Returns:
        JSON-ready: `part`, `difference_pct` and `difference_pct_ci95` in points of percent, `pairs` of
        networks compared, `trials` that all of them flew, `trainings` of the variant with the fewest.
    """
    pairs = [pair for pair in PARTS[part] if all(name in flags for name in pair)]
    if not pairs:
        return None
    names = list(dict.fromkeys(name for pair in pairs for name in pair))
    common = np.all([np.isfinite(flags[name]).all(axis=0) for name in names], axis=0)
    if not common.any():
        return None
    weights = dict.fromkeys(names, 0.0)
    for better, worse in pairs:
        weights[better] += 100.0 / len(pairs)
        weights[worse] -= 100.0 / len(pairs)
    groups = [flags[name][:, common] for name in names]
    values = [weights[name] for name in names]
    return {
        "part": part,
        "difference_pct": sum(w * float(g.mean()) for g, w in zip(groups, values, strict=True)),
        "difference_pct_ci95": statistics.bootstrap_crossed(groups, values, seed),
        "pairs": [list(pair) for pair in pairs],
        "trials": int(common.sum()),
        "trainings": min(len(g) for g in groups),
    }


def sentence(found: Mapping[str, Any]) -> str:
    """An effect in words, no stronger than its interval allows."""
    pairs = " and ".join(f"{better} - {worse}" for better, worse in found["pairs"])
    low, high = found["difference_pct_ci95"] or (-100.0, 100.0)
    figures = f"{found['difference_pct']:+.1f} points of goals reached [{low:+.1f}, {high:+.1f}]"
    if low <= 0.0 <= high:
        verdict = "no effect that can be told apart from chance"
    else:
        verdict = "it helps" if low > 0.0 else "it harms"
    words = f"{found['part']}: {verdict}; {figures}, {pairs}, over {found['trials']} trials"
    if found["trainings"] < _FEW:
        return f"{words}. A network was trained only once: the chance of training is not in the interval."
    return f"{words} and at least {found['trainings']} trainings of each network."


def sentences(effects: Sequence[Mapping[str, Any]]) -> list[str]:
    """All effects in words; says so where nothing can be compared."""
    return [sentence(found) for found in effects] or [
        "Whether SPN and LAPN help is not told: no two of the networks differ in one of them alone."
    ]
