"""The paper's own figures, to print beside ours. Its robot, worlds and weights are not public."""

from __future__ import annotations

from typing import Any

# Table I, training loss and "Goal Reached" [%] of 100 trials, by the networks' names here.
TABLE_1: dict[str, dict[str, dict[str, float]]] = {
    "indoor": {
        "iplanner": {"loss": 1.588, "reached_pct": 86.0},
        "lapn": {"loss": 1.457, "reached_pct": 84.0},
        "spn": {"loss": 1.523, "reached_pct": 88.0},
        "gkpn": {"loss": 1.322, "reached_pct": 91.0},
    },
    "rooms": {  # Matterport3D
        "iplanner": {"loss": 3.671, "reached_pct": 64.0},
        "lapn": {"loss": 3.542, "reached_pct": 68.0},
        "spn": {"loss": 3.320, "reached_pct": 72.0},
        "gkpn": {"loss": 3.221, "reached_pct": 76.0},
    },
    "garage": {
        "iplanner": {"loss": 0.679, "reached_pct": 95.0},
        "lapn": {"loss": 0.723, "reached_pct": 94.0},
        "spn": {"loss": 0.665, "reached_pct": 95.0},
        "gkpn": {"loss": 0.632, "reached_pct": 96.0},
    },
    "forest": {
        "iplanner": {"loss": 0.664, "reached_pct": 94.0},
        "lapn": {"loss": 0.645, "reached_pct": 94.0},
        "spn": {"loss": 0.642, "reached_pct": 95.0},
        "gkpn": {"loss": 0.636, "reached_pct": 96.0},
    },
}

# The same beside our methods: SPN+LAPN is the paper's method, without both it is the baseline.
GOAL_REACHED_PCT: dict[str, dict[str, float]] = {
    family: {"two-stage": rows["gkpn"]["reached_pct"], "iplanner": rows["iplanner"]["reached_pct"]}
    for family, rows in TABLE_1.items()
}

# Table III, real robot, one run each: length on land and in the air [m], time [s], energy [J].
TABLE_3: dict[tuple[str, str], dict[str, Any]] = {
    ("land", "iplanner"): {"land_m": 7.5, "air_m": 0.0, "time_s": 13.7, "energy_j": 1161.44},
    ("land", "mapping"): {"land_m": 10.7, "air_m": 0.0, "time_s": 19.2, "energy_j": 1544.41},
    ("land", "two-stage"): {"land_m": 8.6, "air_m": 0.0, "time_s": 11.8, "energy_j": 1008.70},
    ("air", "mapping"): {"land_m": 3.2, "air_m": 5.8, "time_s": 22.5, "energy_j": 17225.8},
    ("air", "two-stage"): {"land_m": 7.2, "air_m": 1.4, "time_s": 28.7, "energy_j": 11010.7},
}

# Table II, size and work of the networks by the rows' names here; its latencies are of another machine.
TABLE_2: dict[str, dict[str, float]] = {
    "iplanner": {"params_m": 54.3, "flops_g": 20.64},
    "lapn": {"params_m": 45.6, "flops_g": 16.75},
    "spn": {"params_m": 53.2, "flops_g": 21.12},
    "gkpn": {"params_m": 47.7, "flops_g": 17.8},
}
